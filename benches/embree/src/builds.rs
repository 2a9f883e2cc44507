//! Builds in turns: Embree's beside ours in new memory, beside kept memory of the builder, and over an accelerator that is replaced: by lists
//! that this first rebuild makes, and by the lists that it has kept.

use std::path::Path;

use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::{CpuBackend, InstructionSet};

use crate::Problem;
use crate::embree::Embree;
use crate::turns::{cpu_time, median};

/// What is built, and with whom.
pub(crate) struct Task<'a> {
    pub library: &'a Path,
    pub isa: Option<&'a str>,
    pub set: InstructionSet,
    pub pool: &'a rayon::ThreadPool,
    pub mesh: Mesh<'a>,
    pub positions: &'a [[f32; 3]],
    pub indices: &'a [[u32; 3]],
    pub rounds: usize,
}

impl Task<'_> {
    /// Prints Embree's median time, and for a preset the medians of four builds and of their times over Embree's of the same
    /// round: the first of a builder, the next one, one in the memory of an accelerator, which makes the lists that builds give back, and
    /// one more there, which finds these lists. Then bytes; and where ours has AVX-512, what the first and the last of these take by AVX2 over
    /// that, in turns too.
    ///
    /// # Errors
    /// Where someone does not build.
    pub(crate) fn measure(&self, preset: Preset) -> Result<(), Problem> {
        let options = BuildOptions::from(preset.config());
        let mut seconds: [Vec<f64>; 5] = Default::default();
        let mut narrower: [Vec<f64>; 2] = Default::default();
        let mut bytes = (0, 0);
        for _ in 0..self.rounds.max(1) {
            let before = self.embree()?;
            let ours;
            (ours, bytes) = self.ours(self.set, &options)?;
            let embree = 0.5 * (before + self.embree()?);
            for (all, one) in seconds.iter_mut().zip([embree].into_iter().chain(ours)) {
                all.push(one);
            }
            if self.set == InstructionSet::Avx512 {
                let (by_avx2, _) = self.ours(InstructionSet::Avx2, &options)?;
                for (all, number) in narrower.iter_mut().zip([0, 3]) {
                    all.push(by_avx2[number] / ours[number]);
                }
            }
        }
        let [embree, others @ ..] = &seconds;
        print!("  build {:<9}", preset.name());
        print!("  Embree {:.1} ms", 1e3 * median(embree.iter().copied()));
        for (name, ours) in ["first", "next", "rebuild", "kept"].into_iter().zip(others) {
            let ratio = median(ours.iter().zip(embree).map(|(ours, embree)| ours / embree));
            print!("  {name} {:.1} ms, {ratio:.2}", 1e3 * median(ours.iter().copied()));
        }
        let (peak, held) = bytes;
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        print!(
            "  peak {:.1} MiB, finished {:.1} MiB, {:.2}",
            mib(peak),
            mib(held),
            peak as f64 / held as f64
        );
        if !narrower[0].is_empty() {
            let [first, kept] = narrower.map(|ratios| median(ratios.into_iter()));
            print!("  AVX2 over AVX-512: first {first:.2}, kept {kept:.2}");
        }
        println!();
        Ok(())
    }

    /// Seconds of the four builds of ours, then the peak of accounted memory and the bytes of the finished structure.
    fn ours(
        &self,
        set: InstructionSet,
        options: &BuildOptions<'_>,
    ) -> Result<([f64; 4], (u64, u64)), Problem> {
        let backend = CpuBackend::with_instruction_set(set);
        let build = || self.pool.install(|| backend.build(&self.mesh, options));
        let (first, mut built) = timed(build)?;
        let tree = built.tree();
        let held = size_of_val(&tree.nodes[..]) + size_of_val(&tree.references[..]);
        let bytes = (built.summary().peak_bytes, held as u64 + built.query_bytes());
        // Dropped within neither time: memory is returned before it is made anew.
        drop(built);
        let (next, again) = timed(build)?;
        built = again;
        let mut rebuild = || self.pool.install(|| backend.rebuild(&mut built, &self.mesh, options));
        let (over, ()) = timed(&mut rebuild)?;
        let (kept, ()) = timed(&mut rebuild)?;
        Ok(([first, next, over, kept], bytes))
    }

    /// Seconds that Embree takes from its own vertices to a scene that is ready.
    fn embree(&self) -> Result<f64, Problem> {
        Ok(Embree::build(self.library, self.isa, self.positions, self.indices)?.build_seconds)
    }
}

fn timed<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<(f64, T), E> {
    let before = cpu_time();
    let done = work()?;
    Ok(((cpu_time() - before).as_secs_f64(), done))
}

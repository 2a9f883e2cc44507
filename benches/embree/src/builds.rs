//! Builds in turns: Embree's beside ours in new memory, beside kept memory of the builder, and over an accelerator that is replaced: by lists
//! that this first rebuild makes, and by the lists that it has kept.

use std::path::Path;

use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_cpu::{CpuBackend, InstructionSet};

use crate::Problem;
use crate::embree::Embree;
use crate::turns::{Took, median, took};

/// What is built, and with whom.
pub(crate) struct Task<'a> {
    pub library: &'a Path,
    pub isa: Option<&'a str>,
    /// Of Embree, and of the pool.
    pub threads: usize,
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
    /// one more there, which finds these lists; on several threads the time that passed, too. Then bytes; and where ours has AVX-512, what
    /// the first and the last of these take by AVX2 over that, in turns too.
    ///
    /// # Errors
    /// Where someone does not build.
    pub(crate) fn measure(&self, preset: Preset) -> Result<(), Problem> {
        let options = BuildOptions::from(preset.config());
        let mut rounds: [Vec<Took>; 5] = Default::default();
        let mut narrower: [Vec<f64>; 2] = Default::default();
        let mut bytes = (0, 0);
        for _ in 0..self.rounds.max(1) {
            let before = self.embree()?;
            let ours;
            (ours, bytes) = self.ours(self.set, &options)?;
            let after = self.embree()?;
            let mean = |of: fn(&Took) -> f64| 0.5 * (of(&before) + of(&after));
            let embree = Took { cpu: mean(|took| took.cpu), wall: mean(|took| took.wall) };
            for (all, one) in rounds.iter_mut().zip([embree].into_iter().chain(ours)) {
                all.push(one);
            }
            if self.set == InstructionSet::Avx512 {
                let (by_avx2, _) = self.ours(InstructionSet::Avx2, &options)?;
                for (all, number) in narrower.iter_mut().zip([0, 3]) {
                    all.push(by_avx2[number].cpu / ours[number].cpu);
                }
            }
        }
        print!("  build {:<9}", preset.name());
        print_times(&rounds, |took| took.cpu);
        if self.threads > 1 {
            print!("  time that passed:");
            print_times(&rounds, |took| took.wall);
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

    /// What the four builds of ours took, then the peak of accounted memory and the bytes of the finished structure.
    fn ours(
        &self,
        set: InstructionSet,
        options: &BuildOptions<'_>,
    ) -> Result<([Took; 4], (u64, u64)), Problem> {
        let backend = CpuBackend::with_instruction_set(set);
        let build = || self.pool.install(|| backend.build(&self.mesh, options));
        let (first, built) = took(build);
        let mut built = built?;
        let bytes = (built.summary().peak_bytes, crate::bytes_of(&*built));
        // Dropped within neither time: memory is returned before it is made anew.
        drop(built);
        let (next, again) = took(build);
        built = again?;
        let mut rebuild = || self.pool.install(|| backend.rebuild(&mut built, &self.mesh, options));
        let (over, done) = took(&mut rebuild);
        done?;
        let (kept, done) = took(&mut rebuild);
        done?;
        Ok(([first, next, over, kept], bytes))
    }

    /// What Embree takes from its own vertices to a scene that is ready.
    fn embree(&self) -> Result<Took, Problem> {
        let how = (self.isa, self.threads);
        Ok(Embree::build(self.library, how, self.positions, self.indices)?.build)
    }
}

/// Medians: Embree's, then of each of ours, and of its time over Embree's of the same round.
fn print_times([embree, others @ ..]: &[Vec<Took>; 5], of: fn(&Took) -> f64) {
    print!("  Embree {:.1} ms", 1e3 * median(embree.iter().map(of)));
    for (name, ours) in ["first", "next", "rebuild", "kept"].into_iter().zip(others) {
        let ratio = median(ours.iter().zip(embree).map(|(ours, embree)| of(ours) / of(embree)));
        print!("  {name} {:.1} ms, {ratio:.2}", 1e3 * median(ours.iter().map(of)));
    }
}

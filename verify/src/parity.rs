//! Both backends over one scene: the build step by step, the finished trees, and rays.

use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::build::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::build::schedule;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::tree::digest::Digest;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_wgpu::{DeviceTree, Effort, Queries, WgpuBackend, WgpuExecutor};
use thiserror::Error;

/// Rays of a batch.
const BATCH: usize = 1 << 16;

/// What a comparison of CPU and GPU found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Comparison {
    /// Dispatches after which all that was written was compared, and found equal.
    pub dispatches: u32,
    /// The first kernel, buffer and index that differ.
    pub difference: Option<Difference>,
    /// The digests of the trees that both backends build in the way users build them.
    pub digests: [Digest; 2],
    /// What the build asked of the device.
    pub effort: Effort,
    /// Rays traced through both, for the closest hit and for any hit.
    pub rays: u64,
    /// Rays of which an answer of the GPU differs in some bit.
    pub unequal: u64,
    /// Rays of which the driver left one of the two traversals, or both, unfinished. What it left
    /// unfinished was not compared.
    pub unfinished: u64,
    /// The first of them, in words that allow to repeat it.
    pub first_unequal: Option<String>,
}

impl Comparison {
    /// True when nothing of what was compared differs; [`Comparison::unfinished`] says how many rays
    /// were not, or not in full.
    pub fn is_bitwise(&self) -> bool {
        self.difference.is_none() && self.digests[0] == self.digests[1] && self.unequal == 0
    }
}

/// Why a comparison did not come to an end.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ParityError {
    /// A backend could not build.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// A backend could not answer.
    #[error(transparent)]
    Query(#[from] QueryError),
}

/// Compares the CPU with a device over a scene. The device needs memory for the worst case that the
/// configuration allows, as far as its limits let it have that. `progress` is called with the number
/// of rays of every batch.
///
/// # Errors
/// A configuration or a scene that one of them cannot build, or a device that fails.
pub fn compare(
    gpu: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    rays: &[Ray],
    query: &QueryOptions<'_>,
    progress: &dyn Fn(u64),
) -> Result<Comparison, ParityError> {
    let (dispatches, difference) = in_step(gpu, mesh, options)?;
    let expected = CpuBackend::new().build(mesh, options)?;
    let built = gpu.build_on_device(mesh, options)?;
    let tree = built.tree.read(gpu.gpu()).map_err(BuildError::from)?;
    let digests = [expected.tree().digest(), tree.digest()];
    let effort = built.effort;
    let mut comparison = Comparison {
        dispatches,
        difference,
        digests,
        effort,
        rays: rays.len() as u64,
        unequal: 0,
        unfinished: 0,
        first_unequal: None,
    };
    for batch in rays.chunks(BATCH) {
        let cpu = Answers::on_cpu(expected.as_ref(), batch, query)?;
        let gpu = Answers::on_gpu(gpu.queries(), &built.tree, batch, query)?;
        comparison.add(batch, &cpu, &gpu);
        progress(batch.len() as u64);
    }
    Ok(comparison)
}

/// Runs both executors step by step.
fn in_step(
    gpu: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
) -> Result<(u32, Option<Difference>), BuildError> {
    let config = &options.config;
    let preset = config.preset();
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(*mesh, *config, set, Buffers::default(), options.max_memory)?;
    gpu.with_executor(mesh, config, |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        let ran = schedule::build(&mut lockstep, planes);
        let dispatches = lockstep.dispatches();
        match ran {
            Ok(()) => Ok((dispatches, None)),
            Err(LockstepError::Differs(difference)) => Ok((difference.dispatch, Some(difference))),
            Err(LockstepError::First(error)) => Err(error),
            Err(LockstepError::Second(error)) => Err(error.into()),
        }
    })?
}

/// The answers of a batch; `None` where the driver left the ray unfinished.
struct Answers {
    closest: Vec<Option<Hit>>,
    any: Vec<Option<bool>>,
}

impl Answers {
    fn on_cpu(
        accelerator: &dyn Accelerator,
        rays: &[Ray],
        query: &QueryOptions<'_>,
    ) -> Result<Answers, QueryError> {
        let (mut closest, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
        accelerator.closest_hits(rays, &mut closest, query)?;
        accelerator.any_hits(rays, &mut any, query)?;
        Ok(Answers { closest: marked(closest, &[]), any: marked(any, &[]) })
    }

    /// From the device alone: its accelerator would answer unfinished rays on the CPU.
    fn on_gpu(
        queries: &Queries,
        tree: &DeviceTree,
        rays: &[Ray],
        query: &QueryOptions<'_>,
    ) -> Result<Answers, QueryError> {
        let (mut closest, mut any) = (vec![Hit::MISS; rays.len()], vec![false; rays.len()]);
        let not_closest = queries.closest_hits_marking(tree, rays, &mut closest, query)?;
        let not_any = queries.any_hits_marking(tree, rays, &mut any, query)?;
        Ok(Answers {
            closest: marked(closest, &not_closest.unfinished),
            any: marked(any, &not_any.unfinished),
        })
    }
}

/// The answers without those at the places in `unfinished`.
fn marked<T>(answers: Vec<T>, unfinished: &[usize]) -> Vec<Option<T>> {
    let mut marked: Vec<Option<T>> = answers.into_iter().map(Some).collect();
    for &place in unfinished {
        marked[place] = None;
    }
    marked
}

/// A hit as words, so that zeros of either sign differ.
fn bits(hit: Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

/// Whether both are there and differ.
fn differ<T: PartialEq>(cpu: Option<T>, gpu: Option<T>) -> bool {
    matches!((cpu, gpu), (Some(cpu), Some(gpu)) if cpu != gpu)
}

impl Comparison {
    /// Counts what differs in a batch, and what is unfinished.
    fn add(&mut self, rays: &[Ray], cpu: &Answers, gpu: &Answers) {
        for (i, ray) in rays.iter().enumerate() {
            let closest = [cpu.closest[i], gpu.closest[i]];
            let any = [cpu.any[i], gpu.any[i]];
            self.unfinished += u64::from(closest[1].is_none() || any[1].is_none());
            let [of_cpu, of_gpu] = closest.map(|hit| hit.map(bits));
            if !differ(of_cpu, of_gpu) && !differ(any[0], any[1]) {
                continue;
            }
            self.unequal += 1;
            self.first_unequal.get_or_insert_with(|| {
                format!(
                    "{ray:?}: {}, any hit {}, on the CPU; {}, any hit {}, on the GPU",
                    told(closest[0]),
                    told(any[0]),
                    told(closest[1]),
                    told(any[1])
                )
            });
        }
    }
}

/// An answer in words.
fn told<T: std::fmt::Debug>(answer: Option<T>) -> String {
    answer.map_or_else(|| "unfinished".into(), |answer| format!("{answer:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unfinished_answers_are_neither_equal_nor_different() {
        let hit = |t| Hit { t, triangle: 3, u: 0.25, v: 0.5 };
        let rays = [Ray::new([0.0; 3], [0.0, 0.0, 1.0]); 5];
        let cpu = Answers { closest: vec![Some(hit(0.0)); 5], any: vec![Some(true); 5] };
        let gpu = Answers {
            closest: vec![Some(hit(0.0)), Some(hit(-0.0)), None, None, Some(hit(0.0))],
            any: vec![Some(true), Some(true), Some(true), Some(false), None],
        };
        let mut found = Comparison {
            dispatches: 1,
            difference: None,
            digests: [CpuBackend::new()
                .build_tree(&Mesh::soup(&[]).unwrap(), &BuildOptions::default())
                .unwrap()
                .0
                .digest(); 2],
            effort: Effort::default(),
            rays: 5,
            unequal: 0,
            unfinished: 0,
            first_unequal: None,
        };
        found.add(&rays[..1], &cpu, &gpu);
        assert!(found.is_bitwise());
        found.add(&rays, &cpu, &gpu);
        assert_eq!((found.unequal, found.unfinished), (2, 3));
        assert!(!found.is_bitwise());
        assert!(found.first_unequal.unwrap().contains("t: -0.0"));
    }
}

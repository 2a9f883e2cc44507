//! Both backends over one scene: the build step by step, the finished trees, and rays.

use splitplane_core::backend::{Accelerator, Backend, BuildError, BuildOptions, QueryError};
use splitplane_core::digest::Digest;
use splitplane_core::lockstep::{Difference, Lockstep, LockstepError};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::schedule;
use splitplane_cpu::buffers::Buffers;
use splitplane_cpu::{CpuBackend, CpuExecutor, InstructionSet};
use splitplane_wgpu::{Effort, WgpuBackend, WgpuExecutor};
use thiserror::Error;

/// Rays of a batch.
const BATCH: usize = 1 << 16;

/// What a comparison of CPU and GPU found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Parity {
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
    /// Answers that differ in some bit.
    pub unequal: u64,
    /// The first of them, in words that allow to repeat it.
    pub first_unequal: Option<String>,
}

impl Parity {
    /// True when nothing differs.
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
    options: &BuildOptions,
    rays: &[Ray],
    query: &QueryOptions,
    progress: &dyn Fn(u64),
) -> Result<Parity, ParityError> {
    let (dispatches, difference) = in_step(gpu, mesh, options)?;
    let expected = CpuBackend::new().build(mesh, options)?;
    let built = gpu.build_on_device(mesh, options)?;
    let tree = built.tree.read(gpu.gpu()).map_err(BuildError::from)?;
    let digests = [expected.tree().digest(), tree.digest()];
    let effort = built.effort;
    let accelerator = gpu.build_accelerator(mesh, options)?;
    let mut parity = Parity {
        dispatches,
        difference,
        digests,
        effort,
        rays: rays.len() as u64,
        unequal: 0,
        first_unequal: None,
    };
    for batch in rays.chunks(BATCH) {
        parity.compare_rays(expected.as_ref(), &accelerator, batch, query)?;
        progress(batch.len() as u64);
    }
    Ok(parity)
}

/// Runs both executors step by step.
fn in_step(
    gpu: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions,
) -> Result<(u32, Option<Difference>), BuildError> {
    let config = &options.config;
    let set = InstructionSet::detect();
    let cpu: CpuExecutor<'_> =
        CpuExecutor::new(*mesh, *config, set, Buffers::default(), options.max_memory)?;
    gpu.with_executor(mesh, config, |gpu: WgpuExecutor<'_>| {
        let mut lockstep = Lockstep::new(cpu, gpu);
        let ran = schedule::build(&mut lockstep);
        let dispatches = lockstep.dispatches();
        match ran {
            Ok(()) => Ok((dispatches, None)),
            Err(LockstepError::Differs(difference)) => Ok((difference.dispatch, Some(difference))),
            Err(LockstepError::First(error)) => Err(error),
            Err(LockstepError::Second(error)) => Err(error.into()),
        }
    })?
}

impl Parity {
    fn compare_rays(
        &mut self,
        expected: &dyn Accelerator,
        found: &dyn Accelerator,
        rays: &[Ray],
        query: &QueryOptions,
    ) -> Result<(), QueryError> {
        let mut hits = [vec![Hit::MISS; rays.len()], vec![Hit::MISS; rays.len()]];
        let mut any = [vec![false; rays.len()], vec![false; rays.len()]];
        for (side, accelerator) in [expected, found].into_iter().enumerate() {
            accelerator.closest_hits(rays, &mut hits[side], query)?;
            accelerator.any_hits(rays, &mut any[side], query)?;
        }
        let bits = |hit: &Hit| [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()];
        for (i, ray) in rays.iter().enumerate() {
            let [cpu, gpu] = [&hits[0][i], &hits[1][i]];
            if bits(cpu) == bits(gpu) && any[0][i] == any[1][i] {
                continue;
            }
            self.unequal += 1;
            self.first_unequal.get_or_insert_with(|| {
                format!(
                    "{ray:?}: {cpu:?}, any hit {}, on the CPU; {gpu:?}, any hit {}, on the GPU",
                    any[0][i], any[1][i]
                )
            });
        }
        Ok(())
    }
}

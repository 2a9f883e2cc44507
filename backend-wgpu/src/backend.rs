//! The GPU as a backend.

use std::sync::{Arc, Mutex};

use splitplane_core::backend::{BuildError, BuildOptions};
use splitplane_core::config::BuildConfig;
use splitplane_core::kernel::Kernel;
use splitplane_core::mesh::Mesh;

use crate::build::buffers::Buffers;
use crate::build::capacities::Capacities;
use crate::build::executor::Looking;
use crate::build::kernels::Kernels;
use crate::build::pending::{Pooled, first_counters};
use crate::build::{PendingBuild, WgpuExecutor};
use crate::gpu::Gpu;

/// What a backend, its builds and its trees share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub gpu: Gpu,
    pub kernels: Kernels,
    pool: Mutex<Vec<Pooled>>,
}

/// Sets of build buffers kept for later: one for a build in each of two frames.
const POOLED: usize = 2;

impl Shared {
    pub fn new(gpu: Gpu, kernels: Kernels) -> Shared {
        Shared { gpu, kernels, pool: Mutex::new(Vec::new()) }
    }

    pub fn take_buffers(&self) -> Option<Pooled> {
        self.pool.lock().ok()?.pop()
    }

    pub fn keep_buffers(&self, pooled: Pooled) {
        if let Ok(mut pool) = self.pool.lock()
            && pool.len() < POOLED
        {
            pool.push(pooled);
        }
    }
}

/// The GPU backend: builds trees on one device and answers rays there.
#[derive(Debug)]
pub struct WgpuBackend {
    shared: Arc<Shared>,
}

impl WgpuBackend {
    /// A backend on this device.
    pub fn new(gpu: Gpu) -> WgpuBackend {
        WgpuBackend { shared: Arc::new(Shared::new(gpu, Kernels::default())) }
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.shared.gpu
    }

    /// A backend in which one build kernel has another text: for tests that plant faults.
    #[doc(hidden)]
    pub fn with_replaced_kernel(gpu: Gpu, kernel: Kernel, source: String) -> WgpuBackend {
        let kernels = Kernels::with_replaced(kernel, source);
        WgpuBackend { shared: Arc::new(Shared::new(gpu, kernels)) }
    }

    /// Calls `run` with an executor over fresh buffers that submits every step and can be looked at
    /// in between: for [`splitplane_core::lockstep::Lockstep`].
    ///
    /// # Errors
    /// A configuration out of range, or a device that cannot hold the scene.
    pub fn with_executor<T>(
        &self,
        mesh: &Mesh<'_>,
        config: &BuildConfig,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, BuildError> {
        config.validate()?;
        let gpu = &self.shared.gpu;
        let triangles = mesh.len() as u32;
        let capacities =
            Capacities::roomy(triangles, config).within(&gpu.device().limits(), None, config)?;
        let mut buffers = Buffers::new(gpu)?;
        buffers.reserve(gpu, &capacities, false)?;
        let first_index = buffers.upload(gpu, mesh)?;
        buffers.write_parameters(gpu, &capacities.parameters(config, first_index));
        let counters = first_counters(triangles);
        let held = buffers.get(splitplane_core::kernel::Buffer::Counters);
        gpu.queue().write_buffer(held, 0, bytemuck::bytes_of(&counters));
        let kernels = &self.shared.kernels;
        let executor = WgpuExecutor::new(gpu, kernels, &mut buffers, capacities, Looking::Always);
        Ok(run(executor))
    }

    /// Submits a build and returns at once.
    ///
    /// # Errors
    /// As for [`splitplane_core::backend::Backend::build`].
    pub fn submit_build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<PendingBuild, BuildError> {
        PendingBuild::submit(Arc::clone(&self.shared), mesh, options, false, false)
    }

    #[doc(hidden)]
    pub fn build_tree(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<(splitplane_core::tree::KdTree, crate::build::pending::Effort), BuildError> {
        let mut pending =
            PendingBuild::submit(Arc::clone(&self.shared), mesh, options, true, false)?;
        let built = pending.wait()?;
        Ok((built.tree.expect("asked for"), built.effort))
    }
}

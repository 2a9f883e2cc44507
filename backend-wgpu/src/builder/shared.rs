//! What the builds of a device share: its kernels, its queries, and the buffers of earlier builds.

use std::num::NonZeroU32;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use splitplane_core::config::BuildConfig;

use super::buffers::Buffers;
use super::capacities::Capacities;
use crate::device::Pipelines;
use crate::device::gpu::Gpu;
use crate::query::Queries;

/// What the builds of a backend share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub gpu: Arc<Gpu>,
    pub pipelines: Arc<Pipelines>,
    pub queries: Arc<Queries>,
    pool: Mutex<Vec<Pooled>>,
    /// Most workgroups of a dispatch of a build; 0 for no limit.
    max_workgroups: AtomicU32,
}

/// Sets of build buffers kept for later: one for a build in each of two frames.
const POOLED: usize = 2;

impl Shared {
    pub(crate) fn new(gpu: Gpu) -> Shared {
        Shared::with(gpu, Pipelines::default())
    }

    /// With these kernels.
    pub(crate) fn with(gpu: Gpu, pipelines: Pipelines) -> Shared {
        let (gpu, pipelines) = (Arc::new(gpu), Arc::new(pipelines));
        let queries = Queries::sharing(Arc::clone(&gpu), Arc::clone(&pipelines));
        let (pool, max_workgroups) = (Mutex::new(Vec::new()), AtomicU32::new(0));
        Shared { gpu, pipelines, queries: Arc::new(queries), pool, max_workgroups }
    }

    /// Limits the workgroups of every later dispatch of a build; `None` lifts the limit.
    pub(crate) fn limit_workgroups(&self, most: Option<NonZeroU32>) {
        self.max_workgroups.store(most.map_or(0, NonZeroU32::get), Ordering::Relaxed);
    }

    /// Most workgroups of a dispatch of a build, if there is a limit.
    pub(crate) fn max_workgroups(&self) -> Option<NonZeroU32> {
        NonZeroU32::new(self.max_workgroups.load(Ordering::Relaxed))
    }

    /// Buffers of an earlier build, if there are any. A poisoned lock means that another thread
    /// panicked; its buffers are not needed.
    pub(crate) fn take_buffers(&self) -> Option<Pooled> {
        self.pool.lock().ok()?.pop()
    }

    /// Keeps buffers for the next build.
    pub(crate) fn keep_buffers(&self, pooled: Pooled) {
        if let Ok(mut pool) = self.pool.lock()
            && pool.len() < POOLED
        {
            pool.push(pooled);
        }
    }
}

/// Buffers between builds, and what the last build needed.
#[derive(Debug)]
pub(crate) struct Pooled {
    pub buffers: Buffers,
    pub capacities: Capacities,
    pub triangles: u32,
    pub config: BuildConfig,
    pub levels: u32,
    /// Whether the middle stage was void, in the last build or in one before of as many triangles by the same configuration.
    pub middle_was_void: bool,
    /// Levels that a further build records beyond these.
    pub spare_levels: u32,
}

//! The pipelines of the queries, each compiled when it is first used.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use splitplane_core::ray::{Accuracy, QueryOptions};
use splitplane_core::traverse::Query;

use super::batch::FIRST_RAYS;
use super::error::DeviceQueryError;
use super::staging::Staging;
use crate::error::GpuError;
use crate::gpu::Gpu;
use crate::parity::Parity;

/// The kernels of the queries, in the order of `splitplane_shaders::QUERIES`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum QueryKernel {
    ClosestHit,
    ClosestHitFast,
    ClosestHitExact,
    AnyHit,
    AnyHitFast,
    AnyHitExact,
    TriangleLimits,
}

impl QueryKernel {
    /// The kernel that answers a query.
    pub(super) fn of(query: Query, options: &QueryOptions<'_>) -> QueryKernel {
        match (query, options.accuracy) {
            (Query::Closest, Accuracy::Fast) => QueryKernel::ClosestHitFast,
            (Query::Closest, Accuracy::Watertight) => QueryKernel::ClosestHit,
            (Query::Closest, Accuracy::Exact) => QueryKernel::ClosestHitExact,
            (Query::Any, Accuracy::Fast) => QueryKernel::AnyHitFast,
            (Query::Any, Accuracy::Watertight) => QueryKernel::AnyHit,
            (Query::Any, Accuracy::Exact) => QueryKernel::AnyHitExact,
        }
    }
}

/// A device with the pipelines of the queries and reusable staging memory. One serves any number
/// of trees and threads.
#[derive(Debug)]
pub struct Queries {
    gpu: Arc<Gpu>,
    pipelines: [OnceLock<wgpu::ComputePipeline>; 7],
    /// Staging memory that no batch is using.
    pub(super) staging: Mutex<Vec<Staging>>,
    /// Whether bounds of error hold on the device.
    certain: AtomicBool,
    /// Rays of the first slice of the next batch: what the device was fit for lately.
    pub(super) slice_rays: AtomicU32,
}

impl Queries {
    /// Queries on a device. Compiles nothing yet. Accuracy `exact` is refused until
    /// [`Queries::set_parity`] says that the device may be trusted with it; a
    /// [`WgpuBackend`](crate::WgpuBackend) that was tested has said so.
    pub fn new(gpu: Arc<Gpu>) -> Queries {
        Queries {
            gpu,
            pipelines: Default::default(),
            staging: Mutex::default(),
            certain: AtomicBool::new(false),
            slice_rays: AtomicU32::new(FIRST_RAYS),
        }
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Whether bounds of error hold on the device, so that it may tell exact hits: only after a
    /// self-test found that it rounds as the CPU does.
    pub fn is_certain(&self) -> bool {
        self.certain.load(Ordering::Relaxed)
    }

    /// Says what a self-test found of the device. With [`Parity::Bitwise`] it may tell exact hits.
    pub fn set_parity(&self, parity: &Parity) {
        self.certain.store(parity.is_bitwise(), Ordering::Relaxed);
    }

    /// Refuses accuracy `exact` on a device whose arithmetic nobody has tested, or that failed.
    pub(super) fn may_answer(&self, options: &QueryOptions<'_>) -> Result<(), DeviceQueryError> {
        if options.accuracy == Accuracy::Exact && !self.is_certain() {
            return Err(DeviceQueryError::Uncertain);
        }
        Ok(())
    }

    /// The pipeline of a kernel, compiled by the first call.
    pub(super) fn pipeline(&self, kernel: QueryKernel) -> Result<&wgpu::ComputePipeline, GpuError> {
        let place = &self.pipelines[kernel as usize];
        if let Some(pipeline) = place.get() {
            return Ok(pipeline);
        }
        let shader = &splitplane_shaders::QUERIES[kernel as usize];
        let compiled = self.gpu.pipeline(shader.name, &shader.source())?;
        // Two threads may compile at once; the first to finish stays.
        Ok(place.get_or_init(|| compiled))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_stand_as_in_the_table() {
        for (kernel, name) in [
            (QueryKernel::ClosestHit, "closest_hit"),
            (QueryKernel::ClosestHitFast, "closest_hit_fast"),
            (QueryKernel::ClosestHitExact, "closest_hit_exact"),
            (QueryKernel::AnyHit, "any_hit"),
            (QueryKernel::AnyHitFast, "any_hit_fast"),
            (QueryKernel::AnyHitExact, "any_hit_exact"),
            (QueryKernel::TriangleLimits, "triangle_limits"),
        ] {
            assert_eq!(splitplane_shaders::QUERIES[kernel as usize].name, name);
        }
        assert_eq!(splitplane_shaders::QUERIES.len(), 7);
    }
}

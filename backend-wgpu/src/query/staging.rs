//! Device memory for batches that come from the host, kept for the next batch.

use std::sync::Mutex;

use splitplane_core::kernel::QueryKernel;
use splitplane_core::layout::BatchUniform;
use splitplane_core::ray::Hit;

use super::layout::{DEFERRED_USAGE, RAY_BYTES};
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// Most unused sets that are kept.
const KEPT: usize = 4;
/// Least capacity of a set, so that small batches share sets; less where answers are long.
const LEAST_RAYS: u32 = 1 << 10;

/// The buffers of one slice of a batch.
#[derive(Debug)]
pub(super) struct Staging {
    /// Its capacity in rays.
    pub(super) capacity: u32,
    pub(super) batch: wgpu::Buffer,
    pub(super) rays: wgpu::Buffer,
    pub(super) results: wgpu::Buffer,
    pub(super) readback: wgpu::Buffer,
    pub(super) deferred: wgpu::Buffer,
    /// What kernels need besides, where they need anything.
    pub(super) scratch: Option<wgpu::Buffer>,
}

/// The sets that no batch is using.
#[derive(Debug, Default)]
pub(super) struct StagingPool(Mutex<Vec<Staging>>);

impl StagingPool {
    /// A set with capacity for `rays` rays, with results and scratch memory of `each` bytes: a kept one, else a new one with up to twice
    /// that capacity, but at most `most`.
    pub(super) fn take(
        &self,
        gpu: &Gpu,
        rays: u32,
        most: u32,
        [each, scratch_each]: [u64; 2],
    ) -> Result<Staging, GpuError> {
        // A poisoned lock means that another thread panicked between two statements that cannot
        // leave the list inconsistent.
        let mut kept = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let suits = |set: &Staging| {
            let scratch = set.scratch.as_ref().map_or(0, wgpu::Buffer::size);
            set.capacity >= rays
                && set.results.size() >= u64::from(rays) * each
                && scratch >= u64::from(rays) * scratch_each
        };
        let place = (0..kept.len())
            .filter(|&place| suits(&kept[place]))
            .min_by_key(|&place| kept[place].capacity);
        if let Some(place) = place {
            return Ok(kept.swap_remove(place));
        }
        drop(kept);
        use wgpu::BufferUsages as Usage;
        let least = (u64::from(LEAST_RAYS) * RAY_BYTES / each.max(1)).min(u64::from(LEAST_RAYS));
        let capacity = rays.max(least as u32).next_power_of_two().min(most.max(rays));
        let bytes = |each: u64| u64::from(capacity) * each;
        let result_bytes = bytes(each.max(size_of::<Hit>() as u64));
        Ok(Staging {
            capacity,
            batch: gpu.buffer(
                "batch",
                size_of::<BatchUniform>() as u64,
                Usage::UNIFORM | Usage::COPY_DST,
            )?,
            rays: gpu.buffer("rays", bytes(RAY_BYTES), Usage::STORAGE | Usage::COPY_DST)?,
            results: gpu.buffer("results", result_bytes, Usage::STORAGE | Usage::COPY_SRC)?,
            readback: gpu.buffer(
                "results, read back",
                result_bytes,
                Usage::MAP_READ | Usage::COPY_DST,
            )?,
            deferred: gpu.buffer(
                "deferred rays",
                QueryKernel::deferred_bytes(capacity),
                DEFERRED_USAGE,
            )?,
            scratch: match scratch_each {
                0 => None,
                each => Some(gpu.buffer("scratch of rays", bytes(each), Usage::STORAGE)?),
            },
        })
    }

    /// Keeps a set whose work is done and that is not mapped.
    pub(super) fn keep(&self, set: Staging) {
        let mut kept = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        kept.push(set);
        if kept.len() > KEPT {
            // The smallest is the cheapest to recreate.
            let smallest = (0..kept.len()).min_by_key(|&place| kept[place].capacity);
            smallest.map(|place| kept.swap_remove(place));
        }
    }
}

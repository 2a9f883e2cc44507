//! Times of kernels, by timestamps that the device writes around each dispatch.

use splitplane_core::kernel::{Kernel, KernelSet};
use wgpu::BufferUsages as Usage;

use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// How long a kernel took in a build, or in other work, over all its dispatches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelTime<K = Kernel> {
    /// The kernel.
    pub kernel: K,
    /// How often it was dispatched.
    pub dispatches: u32,
    /// Nanoseconds on the device.
    pub nanoseconds: f64,
}

/// Most dispatches that are timed: two timestamps each, and query sets are limited to 4,096.
const MOST: u32 = 2048;

/// Collects timestamps of a set's kernels.
#[derive(Debug)]
pub struct Profile<K: KernelSet> {
    set: wgpu::QuerySet,
    kernels: Vec<K::Kernel>,
}

impl<K: KernelSet> Profile<K> {
    /// `None` on a device without timestamps.
    pub fn new(gpu: &Gpu) -> Option<Profile<K>> {
        let device = gpu.device();
        device.features().contains(wgpu::Features::TIMESTAMP_QUERY).then(|| Profile {
            set: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("kernel times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MOST,
            }),
            kernels: Vec::new(),
        })
    }

    /// The timestamps of the next dispatch.
    pub(super) fn next(
        &mut self,
        kernel: K::Kernel,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let index = self.kernels.len() as u32;
        if index == MOST {
            return None;
        }
        self.kernels.push(kernel);
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(2 * index),
            end_of_pass_write_index: Some(2 * index + 1),
        })
    }

    /// Reads the times, after the work was submitted. Waits for the device.
    ///
    /// # Errors
    /// The device's.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<KernelTime<K::Kernel>>, GpuError> {
        let count = 2 * self.kernels.len() as u32;
        let bytes = 8 * u64::from(count);
        let resolved = gpu.buffer("times", bytes, Usage::QUERY_RESOLVE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("times", bytes, Usage::COPY_DST | Usage::MAP_READ)?;
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.resolve_query_set(&self.set, 0..count, &resolved, 0);
        encoder.copy_buffer_to_buffer(&resolved, 0, &staging, 0, bytes);
        gpu.submit([encoder.finish()])?;
        let ticks: Vec<u64> = gpu
            .read_mapped(&staging, bytes)?
            .chunks_exact(8)
            .map(|tick| u64::from_le_bytes(tick.try_into().expect("eight bytes")))
            .collect();
        let period = f64::from(gpu.queue().get_timestamp_period());
        let none = |kernel| KernelTime { kernel, dispatches: 0, nanoseconds: 0.0 };
        let mut times: Vec<KernelTime<K::Kernel>> =
            K::KERNELS.iter().map(|row| none(row.kernel)).collect();
        for (kernel, pair) in self.kernels.iter().zip(ticks.chunks_exact(2)) {
            let time = &mut times[K::kernel_index(*kernel)];
            time.dispatches += 1;
            time.nanoseconds += pair[1].saturating_sub(pair[0]) as f64 * period;
        }
        times.retain(|time| time.dispatches > 0);
        Ok(times)
    }
}

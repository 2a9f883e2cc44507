//! The device that counts: the one that is measured, with a binding more than WebGPU promises.

use splitplane::gpu::device::Instrument;
use splitplane::gpu::{Gpu, WgpuBackend};
use wgpu::BufferUsages as Usage;

use super::rewrite;
use super::tally::WORDS;
use crate::Failure;
use crate::device::read_back;

/// A backend whose kernels count, and the buffer that they count in.
pub(crate) struct Counter {
    pub backend: WgpuBackend,
    buffer: wgpu::Buffer,
}

impl Counter {
    /// On another device of the same adapter, given as many workgroups as hardware is.
    pub(crate) fn like(gpu: &Gpu) -> Result<Counter, Failure> {
        let gpu = another(gpu)?;
        let bytes = 4 * WORDS as u64;
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let buffer = gpu.buffer("counted", bytes, usage)?;
        let instrument = Instrument { rewrite: rewrite::counting, buffer: buffer.clone() };
        Ok(Counter { backend: WgpuBackend::instrumented(gpu, instrument), buffer })
    }

    pub(crate) fn clear(&self) {
        self.backend.gpu().queue().write_buffer(&self.buffer, 0, &[0; 4 * WORDS]);
    }

    /// What was counted since it was cleared, once all that was submitted is done.
    pub(crate) fn read(&self) -> Result<Vec<u32>, splitplane::gpu::GpuError> {
        let bytes = read_back(self.backend.gpu(), &self.buffer, 4 * WORDS as u64)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

/// Storage buffers of a stage that kernels may bind, and one more.
const STORAGE_BUFFERS: u32 = 9;

/// A device of the same adapter. It has no features: kernels that choose by what a device offers take the portable
/// way, so that what is counted is the same everywhere.
fn another(gpu: &Gpu) -> Result<Gpu, Failure> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let used = gpu.info();
    let same = |adapter: &wgpu::Adapter| {
        let info = adapter.get_info();
        (&info.name, info.backend, info.device_type) == (&used.name, used.backend, used.device_type)
    };
    let adapter = adapters.into_iter().find(same).ok_or("the adapter is gone")?;
    let offered = adapter.limits();
    if offered.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS {
        return Err(format!("counting needs {STORAGE_BUFFERS} storage buffers in a stage").into());
    }
    let required_limits = wgpu::Limits {
        max_storage_buffers_per_shader_stage: STORAGE_BUFFERS,
        max_buffer_size: offered.max_buffer_size,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_compute_workgroup_storage_size: offered.max_compute_workgroup_storage_size,
        ..wgpu::Limits::default()
    };
    let description = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&description))?;
    let gpu = Gpu::borrow(device, queue).with_timeout(crate::PATIENCE);
    Ok(gpu.with_driver_limits(crate::PATIENCE, u64::MAX).as_hardware())
}

//! Buffers of the device, copied to host memory.

use splitplane_wgpu::{Gpu, GpuError};
use wgpu::BufferUsages as Usage;

/// The usages of a buffer that is read back.
pub(super) const READBACK: Usage = Usage::COPY_DST.union(Usage::MAP_READ);

/// The first bytes of a buffer, after all that was submitted. Waits for the device.
///
/// # Errors
/// The device's.
pub(super) fn read(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
    let staging = gpu.buffer("readback", bytes, READBACK)?;
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
    let recorded = gpu.guard(|| encoder.finish())?;
    gpu.submit([recorded])?;
    gpu.read_mapped(&staging, bytes)
}

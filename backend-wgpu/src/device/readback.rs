//! Buffers of the device, copied to host memory.

use wgpu::BufferUsages as Usage;

use crate::device::gpu::Gpu;
use crate::device::wait::{Wait, blocking};
use crate::error::GpuError;

/// The usages of a buffer that is read back.
pub const READBACK: Usage = Usage::COPY_DST.union(Usage::MAP_READ);

/// A part of a buffer with the usage `COPY_SRC`, after all that was submitted. Waits for the device.
///
/// # Errors
/// The device's.
pub fn read(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    offset: u64,
    bytes: u64,
) -> Result<Vec<u8>, GpuError> {
    blocking(read_by(Wait::Blocking, gpu, buffer, offset, bytes))
}

/// As [`read`], waiting in either way.
#[doc(hidden)]
pub async fn read_by(
    wait: Wait,
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    offset: u64,
    bytes: u64,
) -> Result<Vec<u8>, GpuError> {
    // A browser would not have done it when this returns.
    wait.check()?;
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let from = gpu.mark();
    let staging = gpu.buffer("readback", bytes, READBACK)?;
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, bytes);
    let recorded = gpu.guard(|| encoder.finish())?;
    gpu.submit([recorded])?;
    gpu.read_mapped_by(wait, from, &staging, bytes).await
}

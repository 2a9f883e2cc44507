//! The range of coordinates and sizes of triangles that lie on the device.

use splitplane_core::kernel::{QueryBuffer, QueryKernel, QueryUniform, RayQueries, Slot};
use splitplane_core::layout::TriangleCount;
use splitplane_core::query::intersect::Limits;
use splitplane_shaders::TriangleTest;

use super::pipelines::{Queries, triangles_of};
use crate::device::kernel_set::Bound;
use crate::device::once;
use crate::device::scope::checked;
use crate::error::GpuError;

/// Bytes of its result: four floats.
pub(crate) const LIMITS_BYTES: u64 = 16;

impl Queries {
    /// The limits of the first `count` triangles of a buffer of snapped corners, nine `f32` per
    /// triangle; those of dropped triangles do not count. Equal, bit for bit, to the union of
    /// [`Limits::of`] over the triangles kept. Waits for the device.
    ///
    /// # Errors
    /// A device that fails.
    pub fn triangle_limits(
        &self,
        triangles: &wgpu::Buffer,
        count: u32,
    ) -> Result<Limits, GpuError> {
        if count == 0 {
            return Ok(Limits::NONE);
        }
        let gpu = self.gpu();
        let readback = checked(gpu, "the limits of the triangles", || {
            use wgpu::BufferUsages as Usage;
            let usage = Usage::MAP_READ | Usage::COPY_DST;
            let readback = gpu.buffer("triangle limits, read back", LIMITS_BYTES, usage)?;
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            let result = (&readback, 0);
            self.record_triangle_limits(&mut encoder, triangles, count, result, &mut None)?;
            gpu.submit([encoder.finish()])?;
            Ok(readback)
        })?;
        Ok(limits_from(&gpu.read_mapped(&readback, LIMITS_BYTES)?))
    }

    /// Records the kernel, and a copy of its result to a place in another buffer. `kept` are its own small buffers, for
    /// the next time: what uses them must have been submitted before.
    pub(crate) fn record_triangle_limits(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        triangles: &wgpu::Buffer,
        count: u32,
        (result, place): (&wgpu::Buffer, u64),
        kept: &mut Option<[wgpu::Buffer; 2]>,
    ) -> Result<(), GpuError> {
        use wgpu::BufferUsages as Usage;
        let gpu = self.gpu();
        let [uniform, limits] = match kept.take() {
            Some(kept) => kept,
            None => {
                let usage = Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC;
                [
                    gpu.buffer("triangle count", 16, Usage::UNIFORM | Usage::COPY_DST)?,
                    gpu.buffer("triangle limits", LIMITS_BYTES, usage)?,
                ]
            }
        };
        let none = Limits::NONE;
        let start = [none.greatest, none.least, none.longest, none.shortest];
        let parameters = TriangleCount { count, zero: 0 };
        gpu.write(&uniform, 0, bytemuck::bytes_of(&parameters));
        gpu.write(&limits, 0, bytemuck::cast_slice(&start));
        let variant = self.variant(TriangleTest::Watertight, triangles);
        let whole = wgpu::Buffer::as_entire_buffer_binding;
        let find = |bound: &Bound<RayQueries>| match bound.slot {
            Slot::Uniform(QueryUniform::TriangleCount) => Some(whole(&uniform)),
            Slot::Storage(binding) => match binding.buffer {
                QueryBuffer::Triangles => Some(triangles_of(bound, &variant, triangles)),
                QueryBuffer::Limits => Some(whole(&limits)),
                _ => None,
            },
            Slot::Uniform(_) => None,
        };
        let kernel = (QueryKernel::TriangleLimits, &variant);
        once::record(gpu, &self.pipelines, encoder, kernel, count, find)?;
        encoder.copy_buffer_to_buffer(&limits, 0, result, place, LIMITS_BYTES);
        *kept = Some([uniform, limits]);
        Ok(())
    }
}

/// Limits from the bytes of a result.
pub(crate) fn limits_from(bytes: &[u8]) -> Limits {
    let word = |i: usize| bytemuck::pod_read_unaligned::<f32>(&bytes[4 * i..4 * i + 4]);
    Limits { greatest: word(0), least: word(1), longest: word(2), shortest: word(3) }
}

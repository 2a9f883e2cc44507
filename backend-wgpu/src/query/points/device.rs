//! A tree of points in device memory.

use splitplane_core::kernel::{PointQueries, PointQueryKernel};
use splitplane_core::points::tree::PointTree;
use wgpu::BufferUsages as Usage;

use super::super::tree::can_be_bound;
use crate::device::gpu::Gpu;
use crate::device::host;
use crate::device::scope::checked;
use crate::device::{DeviceSet, Text};
use crate::error::GpuError;

/// Points that are padded at a time.
const PIECE: usize = 1 << 14;

impl DeviceSet for PointQueries {
    type Variant = ();

    fn text(kernel: PointQueryKernel, (): &()) -> Text {
        let shader = &splitplane_shaders::POINTS[kernel as usize];
        Text { name: shader.name, parts: shader.parts.into() }
    }
}

/// The buffers of a tree: 8 bytes a node, 16 a point and 4 for its index.
#[derive(Debug)]
pub(super) struct DevicePoints {
    pub(super) nodes: wgpu::Buffer,
    pub(super) points: wgpu::Buffer,
    pub(super) indices: wgpu::Buffer,
    /// Bound where all points count.
    pub(super) unfiltered: wgpu::Buffer,
    /// How many points.
    pub(super) count: u32,
    /// The height of the root.
    pub(super) height: u32,
}

/// A point or a query as devices have it.
pub(super) fn padded<const N: usize>(point: [f32; N]) -> [f32; 4] {
    let mut out = [0.0; 4];
    for (own, x) in out.iter_mut().zip(point) {
        *own = x;
    }
    out
}

impl DevicePoints {
    /// Bytes of the buffers of so many points.
    pub(super) fn bytes_of(points: usize) -> u64 {
        points as u64 * 20 + points as u64 / 2
    }

    pub(super) fn upload<const N: usize>(
        gpu: &Gpu,
        tree: &PointTree<N>,
    ) -> Result<DevicePoints, GpuError> {
        checked(gpu, "the upload of points", || {
            let made = |what: &str, bytes: usize| {
                let bytes = (bytes as u64).next_multiple_of(16).max(16);
                can_be_bound(gpu, what, bytes)?;
                gpu.buffer(what, bytes, Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC)
            };
            let device = DevicePoints {
                nodes: made("the nodes of a point tree", size_of_val(tree.nodes()))?,
                points: made("the points", 16 * tree.len())?,
                indices: made("the indices of points", size_of_val(tree.indices()))?,
                unfiltered: made("no filter", 16)?,
                count: tree.len() as u32,
                height: tree.height(),
            };
            let write = |buffer, bytes: &[u8]| {
                if !bytes.is_empty() {
                    gpu.write(buffer, 0, bytes);
                }
            };
            write(&device.nodes, bytemuck::cast_slice(tree.nodes()));
            write(&device.indices, bytemuck::cast_slice(tree.indices()));
            for (some, points) in (0..).zip(tree.points().chunks(PIECE)) {
                let mut words = host::room(points.len(), "points to send")?;
                words.extend(points.iter().map(|&point| padded(point)));
                gpu.write(&device.points, some * 16 * PIECE as u64, bytemuck::cast_slice(&words));
            }
            Ok(device)
        })
    }
}

//! A tree of points in device memory.

use splitplane_core::kernel::{PointQueries, PointQueryKernel};
use splitplane_core::points::tree::{PointNode, PointTree};
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
    /// The box around all points, as bits.
    pub(super) bounds: [[u32; 4]; 2],
}

/// A point or a query as devices have it.
pub(super) fn padded<const N: usize>(point: [f32; N]) -> [f32; 4] {
    let mut out = [0.0; 4];
    for (own, x) in out.iter_mut().zip(point) {
        *own = x;
    }
    out
}

/// The box around all points as devices have it.
pub(super) fn bounds_of<const N: usize>(tree: &PointTree<N>) -> [[u32; 4]; 2] {
    tree.bounds().map(|side| padded(side).map(f32::to_bits))
}

/// Writes nodes as searches read them: the plane, and the mark in place of the axis.
pub(super) fn write_nodes<const N: usize>(
    gpu: &Gpu,
    tree: &PointTree<N>,
    to: &wgpu::Buffer,
) -> Result<(), GpuError> {
    let nodes = tree.nodes();
    for (some, nodes) in (0..).zip(nodes.chunks(PIECE)) {
        let mut words = host::room(nodes.len(), "nodes to send")?;
        let marks = tree.marks().get(some * PIECE..).unwrap_or_default();
        let mark = |at: usize, axis| marks.get(at).map_or(axis, |mark| mark.0);
        let word = |(at, node): (usize, &PointNode)| [node.plane.to_bits(), mark(at, node.axis)];
        words.extend(nodes.iter().enumerate().map(word));
        gpu.write(to, (some * 8 * PIECE) as u64, bytemuck::cast_slice(&words));
    }
    Ok(())
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
                bounds: bounds_of(tree),
            };
            let write = |buffer, bytes: &[u8]| {
                if !bytes.is_empty() {
                    gpu.write(buffer, 0, bytes);
                }
            };
            write_nodes(gpu, tree, &device.nodes)?;
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

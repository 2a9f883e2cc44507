//! Compressed wide nodes beside a tree in device memory.

use splitplane_core::query::compressed::CompressedNodes;
use splitplane_core::ray::{Accuracy, QueryOptions};
use splitplane_core::tree::KdTreeView;
use splitplane_core::triangle::Triangle;

use super::pipelines::Queries;
use super::tree::{Compressed, DeviceTree, can_be_bound};
use crate::device::scope::checked;
use crate::error::GpuError;

impl DeviceTree {
    /// Makes [compressed nodes](splitplane_core::query::compressed) on the host and puts them beside the tree: batches of
    /// accuracy `watertight` then go through them, with the same hits, bit for bit, in fewer and wider steps. Rays that a
    /// lean kernel defers, other accuracies and hosts' own shaders still use the tree. `tree` and `triangles` (snapped
    /// corners, dropped triangles included) must be what is on the device.
    ///
    /// They take up to 4 bytes a reference, and 80 a node, besides. Where all rays of a scene go through the tree itself,
    /// because its coordinates leave the range of lean kernels, none are made.
    ///
    /// # Errors
    /// More nodes or references than the device can bind or than such nodes can name, or a device that fails.
    ///
    /// # Panics
    /// If the tree has another number of nodes or triangles.
    pub fn compress(
        &mut self,
        queries: &Queries,
        tree: &KdTreeView<'_>,
        triangles: &[Triangle],
    ) -> Result<(), GpuError> {
        assert_eq!(tree.nodes.len(), self.node_count() as usize, "another tree");
        assert_eq!(triangles.len(), self.triangle_count() as usize, "triangles of another mesh");
        if self.scene_scale().wide {
            return Ok(());
        }
        self.names_references()?;
        let (gpu, what) = (queries.gpu(), "the references of compressed nodes");
        let made = CompressedNodes::new(tree, triangles, self.scene_scale());
        let made = made.ok_or_else(|| GpuError::Refused(what.into()))?;
        let filled = |what: &str, bytes: &[u8]| {
            can_be_bound(gpu, what, bytes.len() as u64)?;
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            let buffer = gpu.buffer(what, bytes.len() as u64, usage)?;
            gpu.queue().write_buffer(&buffer, 0, bytes);
            Ok(buffer)
        };
        let compressed = checked(gpu, "the upload of compressed nodes", || {
            Ok(Compressed {
                nodes: filled("compressed nodes", bytemuck::cast_slice(&made.nodes))?,
                references: filled(what, bytemuck::cast_slice(&made.references))?,
            })
        })?;
        self.set_compressed(compressed);
        Ok(())
    }

    /// The compressed nodes that a batch with these options goes through.
    pub(super) fn compressed_for(&self, options: &QueryOptions<'_>) -> Option<&Compressed> {
        self.compressed().filter(|_| options.accuracy == Accuracy::Watertight)
    }
}

//! The typed arena that kernels work on, kept between builds.

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::{
    Chunk, ChunkBins, ChunkBounds, ChunkSides, Counters, Decision, Extent, LargeNode, MiddleRoot,
    Reference, Sides, SmallRoot, TopNode,
};
use splitplane_core::tree::node::KdNode;
use splitplane_core::triangle::Triangle;

use super::subtrees::Subtrees;
use crate::memory::bytes_of;

/// One vector for each of [`splitplane_core::kernel::Buffer`]. Vectors only grow; the live length is
/// in the counters.
#[derive(Debug, Default)]
pub struct Buffers {
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) references: Vec<Reference>,
    pub(crate) next_references: Vec<Reference>,
    pub(crate) small_references: Vec<Reference>,
    pub(crate) active_nodes: Vec<LargeNode>,
    pub(crate) next_nodes: Vec<LargeNode>,
    pub(crate) node_bounds: Vec<Aabb>,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) chunk_counts: Vec<Sides>,
    /// Scratch memory of `scatter_references`.
    pub(crate) chunk_offsets: Vec<Sides>,
    pub(crate) chunk_bounds: Vec<ChunkBounds>,
    pub(crate) reference_sides: Vec<ChunkSides>,
    pub(crate) chunk_bins: Vec<ChunkBins>,
    pub(crate) decisions: Vec<Decision>,
    pub(crate) top_nodes: Vec<TopNode>,
    pub(crate) level_starts: Vec<u32>,
    pub(crate) small_roots: Vec<SmallRoot>,
    pub(crate) small_sizes: Vec<Extent>,
    pub(crate) middle_roots: Vec<MiddleRoot>,
    pub(crate) middle_references: Vec<Reference>,
    pub(crate) middle_nodes: Vec<TopNode>,
    pub(crate) middle_leaves: Vec<SmallRoot>,
    pub(crate) middle_sizes: Vec<Extent>,
    pub(crate) top_sizes: Vec<Extent>,
    pub(crate) top_addresses: Vec<Extent>,
    pub(crate) small_addresses: Vec<Extent>,
    pub(crate) nodes: Vec<KdNode>,
    pub(crate) leaf_references: Vec<u32>,
    pub(crate) counters: Counters,
    pub(crate) root_bounds: Aabb,
    /// Not part of the schedule: the subtrees that `build_small` measured, kept for `emit_small`.
    pub(crate) subtrees: Vec<Subtrees>,
    /// Not part of the schedule: references of two levels of a middle root, for each part of the grid.
    pub(crate) middle_levels: Vec<Reference>,
    /// Not part of the schedule: how many references splits have added.
    pub(crate) growth: u64,
}

impl Buffers {
    /// Frees all but corners and the finished tree.
    pub(in crate::build) fn keep_finished(&mut self) {
        let Buffers { triangles, nodes, leaf_references, counters, root_bounds, .. } =
            core::mem::take(self);
        let finished = (triangles, nodes, leaf_references);
        (self.triangles, self.nodes, self.leaf_references) = finished;
        (self.counters, self.root_bounds) = (counters, root_bounds);
    }

    /// Bytes of what [`Buffers::keep_finished`] keeps.
    pub(in crate::build) fn finished_bytes(&self) -> u64 {
        bytes_of(&self.triangles) + bytes_of(&self.nodes) + bytes_of(&self.leaf_references)
    }

    /// Bytes of all vectors.
    pub fn bytes(&self) -> u64 {
        use bytes_of as of;
        of(&self.triangles)
            + of(&self.references)
            + of(&self.next_references)
            + of(&self.small_references)
            + of(&self.active_nodes)
            + of(&self.next_nodes)
            + of(&self.node_bounds)
            + of(&self.chunks)
            + of(&self.chunk_counts)
            + of(&self.chunk_offsets)
            + of(&self.chunk_bounds)
            + of(&self.reference_sides)
            + of(&self.chunk_bins)
            + of(&self.decisions)
            + of(&self.top_nodes)
            + of(&self.level_starts)
            + of(&self.small_roots)
            + of(&self.small_sizes)
            + of(&self.middle_roots)
            + of(&self.middle_references)
            + of(&self.middle_nodes)
            + of(&self.middle_leaves)
            + of(&self.middle_sizes)
            + of(&self.top_sizes)
            + of(&self.top_addresses)
            + of(&self.small_addresses)
            + of(&self.nodes)
            + of(&self.leaf_references)
            + of(&self.middle_levels)
            + self.subtrees.iter().map(Subtrees::bytes).sum::<u64>()
    }
}

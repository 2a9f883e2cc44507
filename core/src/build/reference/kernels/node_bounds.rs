use super::range;
use crate::aabb::Aabb;
use crate::layout::{ChunkBounds, LargeNode};

/// The tight bounds of an active node: of all its references, as they are clipped.
///
/// They are the union of `ChunkBounds` over the parent's chunks, on the node's side: a segmented
/// reduction (Zhou et al. 2008, Algorithm 2). `chunk_bounds` are those of the previous level.
pub fn node_bounds(node: usize, active_nodes: &[LargeNode], chunk_bounds: &[ChunkBounds]) -> Aabb {
    let node = &active_nodes[node];
    let chunks = &chunk_bounds[range(node.source, node.source_chunks)];
    let side = node.side as usize;
    chunks.iter().fold(Aabb::EMPTY, |bounds, chunk| bounds.union(&chunk.sides[side]))
}

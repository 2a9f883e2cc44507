//! `node_bounds`: one workgroup an active node.
//!
//! Reads: bounds of the parent's chunks on the node's side. Writes: the node's chunks and tight bounds
//! (segmented reduction, Zhou et al. 2008, Algorithm 2).

use splitplane_core::aabb::Aabb;
use splitplane_core::layout::{Chunk, ChunkBounds, LargeNode};

use super::{GRAIN, name_chunks};
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel.
pub(crate) fn run(
    meter: &ProgressMeter<'_>,
    active: &[LargeNode],
    chunk_bounds: &[ChunkBounds],
    chunks: &mut [Chunk],
    node_bounds: &mut [Aabb],
) {
    name_chunks(active, chunks);
    let _loop = span::pieces_of(GRAIN);
    active.par_iter().zip(node_bounds).with_min_len(GRAIN).for_each(|(node, bounds)| {
        let _piece = span::piece();
        if meter.is_cancelled() {
            return;
        }
        *bounds = tight(node, chunk_bounds);
        meter.record_work(u64::from(node.source_chunks));
    });
}

/// The tight bounds of one node.
pub(crate) fn tight(node: &LargeNode, chunk_bounds: &[ChunkBounds]) -> Aabb {
    let first = node.source as usize;
    let chunks = &chunk_bounds[first..first + node.source_chunks as usize];
    let side = node.side as usize;
    chunks.iter().fold(Aabb::EMPTY, |bounds, chunk| bounds.union(&chunk.sides[side]))
}

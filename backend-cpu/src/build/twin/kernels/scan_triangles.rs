//! `scan_triangles`: one workgroup.
//!
//! Reads: kept and snapped counts and bounds of the input's chunks. Writes: exclusive scan of the
//! kept counts in their place; the root, on the active list, or as an empty leaf when nothing is
//! kept.

use splitplane_core::aabb::Aabb;
use splitplane_core::config::CHUNK;
use splitplane_core::kernel::Counter;
use splitplane_core::layout::{ChunkBounds, Counters, LargeNode, Sides, TopNode};

/// Runs the kernel.
pub(crate) fn run(
    chunk_counts: &mut [Sides],
    chunk_bounds: &[ChunkBounds],
    root: &mut LargeNode,
    top: &mut TopNode,
    counters: &mut Counters,
) {
    let (mut kept, mut snapped) = (0, 0);
    let mut bounds = Aabb::EMPTY;
    for (counts, chunk) in chunk_counts.iter_mut().zip(chunk_bounds) {
        let here = counts.left;
        counts.left = kept;
        kept += here;
        snapped += counts.right;
        bounds = bounds.union(&chunk.sides[0]);
    }
    *root = LargeNode {
        lo: bounds.lo,
        first: 0,
        hi: bounds.hi,
        count: kept,
        node: 0,
        depth: 0,
        source: 0,
        source_chunks: chunk_counts.len() as u32,
        side: 0,
        inseparable: 0,
        first_chunk: 0,
        padding: 0,
    };
    *top = TopNode { kind: TopNode::EMPTY, split: 0, left: 0, right: 0 };
    counters[Counter::Dropped] = counters[Counter::Triangles] - kept;
    counters[Counter::Snapped] = snapped;
    counters[Counter::ActiveNodes] = u32::from(kept > 0);
    counters[Counter::ActiveReferences] = kept;
    counters[Counter::Chunks] = kept.div_ceil(CHUNK);
    counters[Counter::TopNodes] = 1;
}

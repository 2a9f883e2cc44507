//! `node_bounds`: one workgroup an active node.
//!
//! Reads: bounds of the parent's chunks on the node's side. Writes: the node's tight bounds
//! (segmented reduction, Zhou et al. 2008, Algorithm 2).

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::layout::{ChunkBounds, LargeNode};

use super::GRAIN;
use crate::cancel::ProgressMeter;

/// Runs the kernel.
pub(crate) fn run(
    meter: &ProgressMeter<'_>,
    active: &[LargeNode],
    chunk_bounds: &[ChunkBounds],
    node_bounds: &mut [Aabb],
) {
    active.par_iter().zip(node_bounds).with_min_len(GRAIN).for_each(|(node, bounds)| {
        if meter.is_cancelled() {
            return;
        }
        let first = node.source as usize;
        let chunks = &chunk_bounds[first..first + node.source_chunks as usize];
        *bounds = chunks
            .iter()
            .fold(Aabb::EMPTY, |bounds, chunk| bounds.union(&chunk.sides[node.side as usize]));
        meter.record_work(u64::from(node.source_chunks));
    });
}

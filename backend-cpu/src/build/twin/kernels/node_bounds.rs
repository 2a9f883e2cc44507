//! `node_bounds`: one workgroup an active node.
//!
//! Reads: bounds of the parent's chunks on the node's side. Writes: the node's tight bounds
//! (segmented reduction, Zhou et al. 2008, Algorithm 2).

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::layout::{ChunkBounds, LargeNode};

use super::GRAIN;
use crate::lookout::Lookout;

/// Runs the kernel.
pub fn run(
    look: &Lookout<'_>,
    active: &[LargeNode],
    chunk_bounds: &[ChunkBounds],
    node_bounds: &mut [Aabb],
) {
    active.par_iter().zip(node_bounds).with_min_len(GRAIN).for_each(|(node, bounds)| {
        if look.is_over() {
            return;
        }
        let first = node.source as usize;
        let chunks = &chunk_bounds[first..first + node.source_chunks as usize];
        *bounds = chunks
            .iter()
            .fold(Aabb::EMPTY, |bounds, chunk| bounds.union(&chunk.sides[node.side as usize]));
        look.worked(u64::from(node.source_chunks));
    });
}

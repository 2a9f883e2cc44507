//! `split_median`: one workgroup an active node.
//!
//! Reads: cell and tight bounds of the node, from its parent's chunks; its references where the median
//! separates nothing. Writes: the node's chunks; the decision: cuts of empty space, then a split or a transfer to the small list.
//! Ties: axes in order, then lower positions.

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::reference::kernels::split_median_while;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{Chunk, ChunkBounds, Decision, LargeNode, Reference};

use super::node_bounds::tight;
use super::{GRAIN, name_chunks};
use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel.
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    active: &[LargeNode],
    chunk_bounds: &[ChunkBounds],
    references: &[Reference],
    chunks: &mut [Chunk],
    decisions: &mut [Decision],
) {
    name_chunks(active, chunks);
    let _loop = span::pieces_of(GRAIN);
    active.par_iter().zip(decisions).with_min_len(GRAIN).for_each(|(node, decision)| {
        let _piece = span::piece();
        if !meter.record_work(4 + u64::from(node.source_chunks)) {
            let tight = tight(node, chunk_bounds);
            *decision = decide::<A>(meter, config, node, &tight, references);
        }
    });
}

/// The decision about one node. Its references matter only where a plane did not separate it.
pub(crate) fn decide<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    node: &LargeNode,
    tight: &Aabb,
    references: &[Reference],
) -> Decision {
    split_median_while::<A>(config, node, tight, references, |work| !meter.record_work(work))
}

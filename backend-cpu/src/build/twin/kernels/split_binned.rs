//! `split_binned`: one workgroup an active node.
//!
//! Reads: cell and tight bounds of the node; the bins of its chunks. Writes: the decision: cuts of
//! empty space, then a split or a transfer to the small list.
//! Ties: least expected cost, then axis, then position.

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::build::bins::NodeBins;
use splitplane_core::build::decide::{border_or_median, cut_empty_space};
use splitplane_core::config::{BuildConfig, CHUNK};
use splitplane_core::layout::{ChunkBins, Decision, LargeNode};

use crate::cancel::ProgressMeter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel.
pub(crate) fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    active: &[LargeNode],
    node_bounds: &[Aabb],
    chunk_bins: &[ChunkBins],
    decisions: &mut [Decision],
) {
    let _loop = span::pieces_of(4);
    active.par_iter().zip(node_bounds).zip(decisions).with_min_len(4).for_each(
        |((node, tight), decision)| {
            let _piece = span::piece();
            // A chunk's bins take about as long as a quarter of its references.
            if !meter.record_work(u64::from(node.count / 4)) {
                *decision = decide::<A>(config, node, tight, chunk_bins);
            }
        },
    );
}

fn decide<A: Arithmetic>(
    config: &BuildConfig,
    node: &LargeNode,
    tight: &Aabb,
    chunk_bins: &[ChunkBins],
) -> Decision {
    let (decision, cell) = cut_empty_space::<A>(config, node, tight);
    let Some(cell) = cell else { return decision };
    let first = node.first_chunk as usize;
    let chunks = &chunk_bins[first..first + node.count.div_ceil(CHUNK) as usize];
    let bins = NodeBins::sum(chunks, config.bins());
    split::<A>(config, node, &cell, tight, &bins, decision)
}

/// The decision about a node after its cuts of empty space, which have left this cell.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn split<A: Arithmetic>(
    config: &BuildConfig,
    node: &LargeNode,
    cell: &Aabb,
    tight: &Aabb,
    bins: &NodeBins,
    decision: Decision,
) -> Decision {
    decision.split_at(border_or_median::<A>(config, node, cell, tight, bins))
}

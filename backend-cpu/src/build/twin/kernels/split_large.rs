//! `split_large`: one workgroup an active node.
//!
//! Reads: cell and tight bounds of the node; its references where the median separates nothing.
//! Writes: the decision: cuts of empty space, then a split or a transfer to the small list.
//! Ties: axes in order, then lower positions.

use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Arithmetic;
use splitplane_core::config::BuildConfig;
use splitplane_core::layout::{Decision, LargeNode, Reference, Sides};
use splitplane_core::split::{SplitPlane, empty_cutoff, sampled_sweep_while, spatial_median};

use super::GRAIN;
use crate::cancel::ProgressMeter;

/// Runs the kernel.
pub fn run<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    active: &[LargeNode],
    node_bounds: &[Aabb],
    references: &[Reference],
    decisions: &mut [Decision],
) {
    active.par_iter().zip(node_bounds).zip(decisions).with_min_len(GRAIN).for_each(
        |((node, tight), decision)| {
            if !meter.record_work(4) {
                *decision = decide::<A>(meter, config, node, tight, references);
            }
        },
    );
}

/// The decision about one node. Its references matter only where a plane did not separate it.
pub(crate) fn decide<A: Arithmetic>(
    meter: &ProgressMeter<'_>,
    config: &BuildConfig,
    node: &LargeNode,
    tight: &Aabb,
    references: &[Reference],
) -> Decision {
    let (mut decision, cell) = cut_empty_space::<A>(config, node, tight);
    let Some(cell) = cell else { return decision };
    let plane = if node.inseparable == 0 {
        spatial_median::<A>(&cell)
    } else {
        // That the median does not separate does not mean that no plane does.
        let mine = &references[node.first as usize..(node.first + node.count) as usize];
        sampled_sweep_while::<A>(&cell, mine, |work| !meter.record_work(work))
    };
    if let Some(SplitPlane { axis, position }) = plane {
        decision.axis = axis as u32;
        decision.position = position;
    }
    decision
}

/// The node's cuts of empty space, and the cell that is left to split; `None` when the node is
/// transferred after them, because it is small or at the greatest depth.
pub(crate) fn cut_empty_space<A: Arithmetic>(
    config: &BuildConfig,
    node: &LargeNode,
    tight: &Aabb,
) -> (Decision, Option<Aabb>) {
    let mut decision = Decision {
        cuts: [0.0; 6],
        cut_count: 0,
        cut_sides: 0,
        axis: Decision::TRANSFER,
        position: 0.0,
        counts: Sides { left: node.count, right: 0 },
        first: Sides::default(),
        first_node: 0,
        source_first: node.first,
    };
    let levels_left = config.max_depth - node.depth;
    if node.count <= config.small_node_limit {
        return (decision, None);
    }
    let mut cell = node.cell();
    for side in 0..6 {
        if decision.cut_count == levels_left {
            return (decision, None);
        }
        if let Some(cut) = empty_cutoff::<A>(config, &cell, tight, side) {
            if side % 2 == 0 {
                cell.lo[cut.axis] = cut.position;
            } else {
                cell.hi[cut.axis] = cut.position;
            }
            decision.cuts[decision.cut_count as usize] = cut.position;
            decision.cut_sides |= (side as u32) << (4 * decision.cut_count);
            decision.cut_count += 1;
        }
    }
    let cell = (decision.cut_count < levels_left).then_some(cell);
    (decision, cell)
}

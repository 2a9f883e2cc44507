//! A node that is not yet decided, and its decision.

use splitplane_core::aabb::{Aabb, max, min};
use splitplane_core::arithmetic::Strict;
use splitplane_core::error::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::sah::Extents;

use super::atomic_memory::AtomicMemory;
use super::bins::Bins;
use super::cost::{BestSplit, Cell, Split, SplitCosts};
use super::{bins, small};
use crate::cancel::ProgressMeter;
use crate::simd::InstructionSet;

/// A node without its references.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpenNode {
    /// Its cell.
    pub cell: Aabb,
    /// Levels below the root.
    pub depth: u32,
    /// Consecutive splits right above that did not pay.
    pub bad: u32,
    /// Most references that its leaves may have in all.
    pub budget: u64,
}

/// The decision on a node that is split.
#[derive(Clone, Copy, Debug)]
pub(super) struct SplitDecision {
    /// The plane.
    pub split: Split,
    /// [`OpenNode::bad`] of the children.
    pub bad: u32,
}

impl OpenNode {
    /// The root. A cell without references is never examined.
    pub(super) fn root(cell: Aabb, budget: u64) -> OpenNode {
        OpenNode { cell, depth: 0, bad: 0, budget }
    }

    /// The two children of a decision; `counts` references went left and right. The budget is handed down
    /// in proportion to them, so that it binds in the same place, whichever thread builds which child first.
    pub(super) fn children(&self, decision: &SplitDecision, counts: [usize; 2]) -> [OpenNode; 2] {
        let [left, right] = counts.map(|n| n as u64);
        // At most 2^30 each, so the product fits. What a child gets is never below its references.
        let share = (self.budget * left).checked_div(left + right).unwrap_or(0);
        let (mut below, mut above) = (self.cell, self.cell);
        below.hi[decision.split.axis] = decision.split.position;
        above.lo[decision.split.axis] = decision.split.position;
        [(below, share), (above, self.budget - share)].map(|(cell, budget)| OpenNode {
            cell,
            depth: self.depth + 1,
            bad: decision.bad,
            budget,
        })
    }

    /// Whether and where the node is split.
    ///
    /// # Errors
    /// More memory than the limit allows.
    #[allow(clippy::too_many_arguments, reason = "a bundle of them would be made for each node")]
    #[inline]
    pub(super) fn decide(
        &self,
        [costs, of_leaves]: &[SplitCosts; 2],
        set: InstructionSet,
        cell: &Cell,
        references: &[Reference],
        bins: &mut Bins,
        memory: &AtomicMemory,
        meter: &ProgressMeter<'_>,
    ) -> Result<Option<SplitDecision>, BuildError> {
        let count = references.len() as u32;
        if count == 0
            || self.depth >= costs.max_depth
            || Extents::of::<Strict>(&self.cell).is_none()
        {
            return Ok(None);
        }
        let leaf = costs.leaf(cell.area, count);
        if count <= costs.width {
            let split = cut_empty(costs, cell, references, leaf);
            return Ok(split.map(|split| SplitDecision { split, bad: 0 }));
        }
        let search = |costs: &SplitCosts, limit: f64, bins: &mut Bins| {
            if references.len() <= small::MOST {
                Ok(small::best_split(set, costs, cell, references, limit, &mut bins.small))
            } else {
                bins::best_split(set, costs, cell, references, limit, bins, memory, meter)
            }
        };
        // A split that does not pay need not be found where it would not be tried.
        let limit = if self.bad < costs.bad_splits { f64::INFINITY } else { leaf };
        // Whether a split pays is decided with children as leaves: they have their expected cost
        // only if they can be split well, and references that no plane separates cannot.
        let pays = |split: &Split| {
            let areas = cell.axes[split.axis].at(f64::from(split.position));
            costs.split(cell.step, areas, split.counts) < leaf
        };
        let few = costs.few(count);
        let mut found = search(costs, if few { limit } else { f64::INFINITY }, bins)?;
        if !few && !found.as_ref().is_some_and(pays) {
            found = search(of_leaves, limit, bins)?;
        }
        let Some(split) = found else { return Ok(None) };
        let [left, right] = split.counts.map(u64::from);
        if left + right > self.budget {
            return Ok(None);
        }
        Ok(Some(SplitDecision { split, bad: if pays(&split) { 0 } else { self.bad + 1 } }))
    }
}

/// The split of a node that fits one block. Only planes with nothing on one side can pay, and the best of
/// those touch the outermost faces.
fn cut_empty(
    costs: &SplitCosts,
    cell: &Cell,
    references: &[Reference],
    leaf: f64,
) -> Option<Split> {
    let mut tight = Aabb::EMPTY;
    for reference in references {
        for axis in 0..3 {
            tight.lo[axis] = min(tight.lo[axis], reference.lo[axis]);
            tight.hi[axis] = max(tight.hi[axis], reference.hi[axis]);
        }
    }
    let count = references.len() as u32;
    let mut best = BestSplit::below(leaf);
    for axis in 0..3 {
        // The high face first: where all are planar in one plane, left wins the tie.
        for (position, counts) in [(tight.hi[axis], [count, 0]), (tight.lo[axis], [0, count])] {
            if !cell.contains(axis, position) {
                continue;
            }
            let areas = cell.axes[axis].at(f64::from(position));
            let cost = costs.split(cell.step, areas, counts);
            // References planar in the plane go with the others.
            let planar_right = counts[0] == 0;
            best.offer(Split { cost, axis, position, planar_right, counts });
        }
    }
    best.split
}

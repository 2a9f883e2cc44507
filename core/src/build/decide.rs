//! The decision on a large node: cuts of empty space, then a split or a transfer to the small list.
//! The rules of `split_median` and `split_binned`, for one node by itself.

use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::bins::NodeBins;
use crate::build::split::{SplitPlane, empty_cutoff, sampled_sweep_while, spatial_median};
use crate::config::BuildConfig;
use crate::layout::{Decision, LargeNode, Reference, Sides};

/// The cuts of empty space off a large node (Zhou et al. 2008, Algorithm 2), and the cell that is left to
/// split; `None` when the node is transferred after its cuts, because it is small or at the greatest
/// depth.
///
/// Sides are tried in the order of [`empty_cutoff`], each against the cell that the cuts before have left.
/// Every cut is a level. The decision says transfer until [`Decision::split_at`] says otherwise.
pub fn cut_empty_space<A: Arithmetic>(
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
    if node.count <= config.small_node_limit() {
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

impl Decision {
    /// The decision with a split at this plane, whose children are still to be counted; unchanged where there is none.
    #[inline(always)]
    #[must_use]
    pub fn split_at(mut self, plane: Option<SplitPlane>) -> Decision {
        if let Some(SplitPlane { axis, position }) = plane {
            self.axis = axis as u32;
            self.position = position;
            self.counts = Sides::default();
        }
        self
    }
}

/// The plane of a large node in preset `fast`, after its cuts have left `cell`: the spatial median, or the
/// best of a sampled sweep where the plane that made the node separated nothing. That a median does
/// not separate does not mean that no plane does.
///
/// `references` returns the node's references, for the sweep; `go_on` is as for
/// [`sampled_sweep_while`].
pub fn median_or_sweep_while<'a, A: Arithmetic>(
    node: &LargeNode,
    cell: &Aabb,
    references: impl FnOnce() -> &'a [Reference],
    go_on: impl FnMut(u64) -> bool,
) -> Option<SplitPlane> {
    if node.inseparable == 0 {
        spatial_median::<A>(cell)
    } else {
        sampled_sweep_while::<A>(cell, references(), go_on)
    }
}

/// The plane of a large node in preset `balanced`, after its cuts have left `cell`: the best border of its
/// bins. That no border pays does not mean that none will: the node is then halved once, as in preset
/// `fast`. Where that separated nothing before, the node stays whole.
#[inline(always)]
pub fn border_or_median<A: Arithmetic>(
    config: &BuildConfig,
    node: &LargeNode,
    cell: &Aabb,
    tight: &Aabb,
    bins: &NodeBins,
) -> Option<SplitPlane> {
    bins.best_border::<A>(config, cell, tight, node.count)
        .or_else(|| if node.inseparable == 0 { spatial_median::<A>(cell) } else { None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::Strict;
    use crate::config::Preset;
    use bytemuck::Zeroable;

    #[test]
    fn cuts_come_in_the_order_of_sides_and_take_levels() {
        let config = BuildConfig { max_depth: 10, ..BuildConfig::default() };
        let node = |count, depth| LargeNode {
            lo: [0.0; 3],
            hi: [8.0; 3],
            first: 7,
            count,
            depth,
            ..LargeNode::zeroed()
        };
        let tight = Aabb { lo: [3.0, 0.0, 0.0], hi: [5.0, 8.0, 1.0] };
        let cut = |count, depth| cut_empty_space::<Strict>(&config, &node(count, depth), &tight);
        let (decision, cell) = cut(100, 0);
        assert_eq!(cell, Some(tight), "what is left of x, 5 of 8, is cut off too");
        assert_eq!((decision.cut_count, &decision.cuts[..3]), (3, &[3.0, 5.0, 1.0][..]));
        assert_eq!([0, 1, 2].map(|index| decision.cut_side(index)), [0, 1, 5]);
        assert_eq!((decision.axis, decision.source_first), (Decision::TRANSFER, 7));
        // As many levels are left as there are cuts, or fewer, or none.
        for (depth, cuts) in [(6, 3), (7, 3), (8, 2), (10, 0)] {
            let (decision, cell) = cut(100, depth);
            assert_eq!((decision.cut_count, cell.is_some()), (cuts, depth < 7));
        }
        assert_eq!(cut(64, 0).0.cut_count, 0, "small nodes are not cut");
    }

    /// Three references that start and end everywhere: no border pays, so the node is halved, but once.
    #[test]
    fn a_node_is_halved_once() {
        let cell = Aabb { lo: [0.0; 3], hi: [4.0, 2.0, 1.0] };
        let mut bins = NodeBins::EMPTY;
        let config = Preset::Balanced.config().with_bins(4);
        for axis in 0..3 {
            (bins.starts[axis][0], bins.ends[axis][3]) = (3, 3);
        }
        let middle = Some(SplitPlane { axis: 0, position: 2.0 });
        let whole: [Reference; 3] = core::array::from_fn(|i| Reference::new(&cell, i as u32));
        for (inseparable, expected) in [(0, middle), (1, None)] {
            let node = LargeNode { count: 3, inseparable, ..LargeNode::zeroed() };
            let found = border_or_median::<Strict>(&config, &node, &cell, &cell, &bins);
            assert_eq!(found, expected);
            let found = median_or_sweep_while::<Strict>(&node, &cell, || &whole, |_| true);
            assert_eq!(found, expected);
        }
        // The sweep finds what the median does not separate.
        let mut layers = whole;
        for (z, reference) in layers.iter_mut().enumerate() {
            (reference.lo[2], reference.hi[2]) = (0.3 * z as f32, 0.3 * z as f32);
        }
        let node = LargeNode { count: 3, inseparable: 1, ..LargeNode::zeroed() };
        let found = median_or_sweep_while::<Strict>(&node, &cell, || &layers, |_| true);
        assert_eq!(found.map(|plane| plane.axis), Some(2));
    }
}

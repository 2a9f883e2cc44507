//! Custom queries by cost: the leaves of a tree, those that may hold the least cost first.

use alloc::collections::{BinaryHeap, TryReserveError};
use core::cmp::Ordering;
use core::ops::ControlFlow;

use crate::aabb::Aabb;
use crate::tree::node::NodeKind;
use crate::tree::{KdTree, KdTreeView};

/// A leaf and its box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafCell<'a> {
    /// Its place among the nodes of the tree.
    pub node: u32,
    /// The triangles that have a part in the cell, by their index in the mesh, in ascending order; none for
    /// empty space. A triangle is in all leaves that it has a part in, so it may come again.
    pub triangles: &'a [u32],
    /// The box of space.
    pub cell: Aabb,
    /// The greatest lower bound that was given for the cell or one that holds it; minus infinity where nothing is
    /// known.
    pub bound: f64,
}

/// A node that waits to be visited.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    bound: f64,
    node: u32,
    cell: Aabb,
}

/// The greatest is visited first: least bound, then lowest index. Bounds are never NaN.
impl Ord for Waiting {
    fn cmp(&self, other: &Waiting) -> Ordering {
        let bounds = other.bound.partial_cmp(&self.bound).unwrap_or(Ordering::Equal);
        bounds.then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Waiting) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Waiting) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Waiting {}

impl KdTreeView<'_> {
    /// Searches for the least cost: visits leaves in the order of lower bounds (best-first branch
    /// and bound, Hjaltason and Samet 1999) until no leaf is left that may improve on the best.
    /// Returns the least cost that `visit` has returned, or `within` where none was less.
    ///
    /// - `within`: costs above it are of no interest; infinity for no limit.
    /// - `lower_bound` returns a cost for a box such that no part of a triangle in it costs less.
    ///   Infinity says that nothing in it is of interest; such boxes are not visited. A NaN says
    ///   that nothing is known about it. A bound that is too high loses candidates, so it should
    ///   err on the low side.
    /// - `visit` looks at the triangles of a leaf and returns the least cost found so far, or
    ///   breaks off. The returned cost counts where it is less than before. A break carries no cost: what
    ///   that last visit found is not in the result. `visit` keeps the hit itself.
    ///
    /// For the distance to a point, [`Aabb::distance_squared`] is such a bound.
    ///
    /// *What a cost may be.* Anything that is the least over the points of triangles: the distance
    /// to a point, to a segment or to a plane, along one axis, within a class of triangles. The
    /// parts of a triangle in the cells of its leaves make up the whole triangle, so `visit` may
    /// take the cost of the whole triangle wherever it meets it. Costs and bounds may be in any
    /// measure, such as squared distances.
    ///
    /// *Order.* Leaves come in the order of (bound, node index), where the bound of a node is the
    /// greatest of those given for it and for the nodes above it. The search ends before the first
    /// whose bound is greater than the best cost. One that equals it is still visited, since it may
    /// hold ties; so `visit` can resolve ties in favour of the lowest triangle index, and the
    /// answer does not depend on the tree. Leaves without triangles are visited too.
    ///
    /// *Time and memory.* No node is visited twice, so it ends, whatever the bounds are. There is no recursion. At
    /// most as many nodes wait as the tree has leaves, 40 bytes each; with useful bounds, tens of them.
    /// A tree without triangles has no leaf to visit.
    ///
    /// The tree must be valid (see [`tree::validate`](crate::tree::validate)), as built trees and those read from files are.
    ///
    /// # Errors
    /// The system has no memory for the waiting nodes.
    ///
    /// # Panics
    /// With a tree that is not valid it may panic, or not end.
    ///
    /// ```
    /// use core::ops::ControlFlow;
    /// # use splitplane_core::aabb::Aabb;
    /// # use splitplane_core::config::BuildConfig;
    /// # use splitplane_core::tree::node::Axis;
    /// # use splitplane_core::tree::node::KdNode;
    /// use splitplane_core::tree::KdTreeView;
    ///
    /// // The lowest point of a mesh: (height, triangle).
    /// fn lowest(tree: &KdTreeView, triangles: &[[[f32; 3]; 3]]) -> Option<(f32, u32)> {
    ///     let mut best: Option<(f32, u32)> = None;
    ///     let bound = |cell: &Aabb| f64::from(cell.lo[2]);
    ///     let found = tree.find_best(f64::INFINITY, bound, |leaf| {
    ///         for &triangle in leaf.triangles {
    ///             let [a, b, c] = triangles[triangle as usize].map(|corner| corner[2]);
    ///             let height = (a.min(b).min(c), triangle);
    ///             if best.is_none_or(|best| height < best) {
    ///                 best = Some(height);
    ///             }
    ///         }
    ///         ControlFlow::Continue(best.map_or(f64::INFINITY, |(height, _)| f64::from(height)))
    ///     });
    ///     found.expect("memory for a few nodes");
    ///     best
    /// }
    /// # let triangles = [
    /// #     [[0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [0.0, 1.0, 2.0]],
    /// #     [[2.0, 0.0, 1.0], [3.0, 0.0, 2.0], [2.0, 1.0, 3.0]],
    /// # ];
    /// # let tree = KdTreeView {
    /// #     nodes: &[KdNode::interior(Axis::X, 1.5, 2), KdNode::leaf(0, 1), KdNode::leaf(1, 1)],
    /// #     references: &[0, 1],
    /// #     bounds: Aabb { lo: [0.0, 0.0, 1.0], hi: [3.0, 1.0, 3.0] },
    /// #     triangles: 2,
    /// #     config: BuildConfig::default(),
    /// # };
    /// # assert_eq!(lowest(&tree, &triangles), Some((1.0, 1)));
    /// ```
    pub fn find_best(
        &self,
        within: f64,
        mut lower_bound: impl FnMut(&Aabb) -> f64,
        mut visit: impl FnMut(LeafCell<'_>) -> ControlFlow<(), f64>,
    ) -> Result<f64, TryReserveError> {
        let mut best = within;
        if self.bounds.is_empty() {
            return Ok(best);
        }
        let mut waiting = BinaryHeap::new();
        // A node with its bound, if it may be of interest.
        let mut enter = |node: u32, cell: Aabb, least: f64, best: f64| {
            let given = lower_bound(&cell);
            // Not for a NaN.
            let bound = if given > least { given } else { least };
            (bound <= best && bound < f64::INFINITY).then_some(Waiting { bound, node, cell })
        };
        let mut next = enter(0, self.bounds, f64::NEG_INFINITY, best);
        while let Some(Waiting { bound, node, cell }) = next {
            // No waiting node has a lesser bound.
            if bound > best {
                break;
            }
            next = match self.nodes[node as usize].kind() {
                NodeKind::Leaf { first, count } => {
                    let triangles = self.leaf(first, count);
                    match visit(LeafCell { node, triangles, cell, bound }) {
                        ControlFlow::Continue(cost) if cost < best => best = cost,
                        ControlFlow::Continue(_) => {}
                        ControlFlow::Break(()) => break,
                    }
                    waiting.pop()
                }
                NodeKind::Interior { axis, split, right } => {
                    let (mut below, mut above) = (cell, cell);
                    below.hi[axis.index()] = split;
                    above.lo[axis.index()] = split;
                    let left = enter(node + 1, below, bound, best);
                    let right = enter(right, above, bound, best);
                    waiting.try_reserve(2)?;
                    waiting.extend(left.into_iter().chain(right));
                    waiting.pop()
                }
            };
        }
        Ok(best)
    }
}

impl KdTree {
    /// Shorthand for [`KdTreeView::find_best`] of the view.
    ///
    /// # Errors
    /// As there.
    #[inline]
    pub fn find_best(
        &self,
        within: f64,
        lower_bound: impl FnMut(&Aabb) -> f64,
        visit: impl FnMut(LeafCell<'_>) -> ControlFlow<(), f64>,
    ) -> Result<f64, TryReserveError> {
        self.view().find_best(within, lower_bound, visit)
    }
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;

    use super::*;
    use crate::config::BuildConfig;
    use crate::random;
    use crate::tree::node::{Axis, KdNode};

    /// A leaf by its index: its cell, and the greatest bound on the way to it.
    type Path = (f64, u32, Aabb);

    /// Cuts a cell until chance says so.
    fn grow(
        nodes: &mut Vec<KdNode>,
        leaves: &mut Vec<Path>,
        (above, cell): (f64, Aabb),
        levels: u32,
        lower_bound: &impl Fn(&Aabb) -> f64,
        seed: u64,
    ) {
        let at = nodes.len();
        let bound = above.max(lower_bound(&cell));
        let chance = |what: u64| random::hash(seed, &[at as u64, what]);
        if levels == 0 || chance(0).is_multiple_of(6) {
            leaves.push((bound, at as u32, cell));
            return nodes.push(KdNode::leaf(at as u32 % 5, chance(1) as u32 % 3));
        }
        let axis = Axis::ALL[chance(2) as usize % 3];
        let split = 0.5 * (cell.lo[axis.index()] + cell.hi[axis.index()]);
        let (mut left, mut right) = (cell, cell);
        left.hi[axis.index()] = split;
        right.lo[axis.index()] = split;
        nodes.push(KdNode::leaf(0, 0));
        grow(nodes, leaves, (bound, left), levels - 1, lower_bound, seed);
        nodes[at] = KdNode::interior(axis, split, nodes.len() as u32);
        grow(nodes, leaves, (bound, right), levels - 1, lower_bound, seed);
    }

    /// All leaves put in order, and taken until one is worse than the best cost.
    #[test]
    fn leaves_come_in_the_order_of_their_bounds() {
        let references: Vec<u32> = (0..8).collect();
        let (mut visits, mut ends) = (0, 0);
        for round in 0..2_000u64 {
            // Whole numbers up to 10, so that many are equal; some NaN, some infinite either way.
            let lower_bound = |cell: &Aabb| {
                let words = [cell.lo, cell.hi].map(|p| p.map(|x| u64::from(x.to_bits())));
                match random::hash(round, words.as_flattened()) % 40 {
                    0..4 => f64::NAN,
                    4 => f64::INFINITY,
                    5..8 => f64::NEG_INFINITY,
                    any => (any % 11) as f64,
                }
            };
            // Leaves seldom cost less than what is looked for.
            let cost = |node: u32| match random::hash(round, &[u64::from(node)]) % 32 {
                0 => f64::NAN,
                any => any as f64,
            };
            let within = [f64::INFINITY, 9.0, 4.0][round as usize % 3];
            let bounds = Aabb { lo: [0.0, -1.0, 2.0], hi: [4.0, 3.0, 3.0] };
            let (mut nodes, mut leaves) = (Vec::new(), Vec::new());
            grow(&mut nodes, &mut leaves, (f64::NEG_INFINITY, bounds), 7, &lower_bound, round);
            let config = BuildConfig::default();
            let tree =
                KdTreeView { nodes: &nodes, references: &references, bounds, triangles: 8, config };
            leaves.sort_by(|a, b| (a.0, a.1).partial_cmp(&(b.0, b.1)).expect("no NaN"));
            for limit in [usize::MAX, 1 + round as usize % 7] {
                let mut seen = Vec::new();
                let best = tree.find_best(within, lower_bound, |leaf| {
                    seen.push((leaf.bound, leaf.node, leaf.cell));
                    let NodeKind::Leaf { first, count } = nodes[leaf.node as usize].kind() else {
                        panic!("{} is no leaf", leaf.node);
                    };
                    assert_eq!(leaf.triangles, tree.leaf(first, count));
                    if seen.len() == limit {
                        return ControlFlow::Break(());
                    }
                    ControlFlow::Continue(cost(leaf.node))
                });
                let (mut expected, mut least) = (Vec::new(), within);
                for way in &leaves {
                    if way.0 > least || way.0 == f64::INFINITY {
                        break;
                    }
                    expected.push(*way);
                    if expected.len() == limit {
                        break;
                    }
                    least = least.min(cost(way.1));
                }
                assert_eq!((seen.as_slice(), best), (expected.as_slice(), Ok(least)), "{round}");
                visits += seen.len();
                ends += usize::from(seen.len() < leaves.len());
            }
        }
        assert!(visits > 5_000 && ends > 2_000, "{visits} {ends}");
    }

    #[test]
    fn a_tree_without_triangles_has_no_leaf_to_visit() {
        let config = BuildConfig::default();
        let (nodes, bounds) = ([KdNode::leaf(0, 0)], Aabb::EMPTY);
        let tree = KdTreeView { nodes: &nodes, references: &[], bounds, triangles: 0, config };
        let best = tree.find_best(3.0, |_| 0.0, |_| panic!("a leaf"));
        assert_eq!(best, Ok(3.0));
    }
}

//! The walk of a ray down a tree: from leaf to leaf, near ones first, without recursion or allocation.
//!
//! This is the one loop over the nodes of a tree that follows a ray (Havran 2000). The reference
//! traversal ([`query::traverse`](crate::query::traverse)), the exact one ([`traverse::exact`](crate::query::traverse::exact)), the one of a certain device
//! ([`query::certify`](crate::query::certify)) and users' own queries
//! ([`KdTreeView::visit_along`](crate::tree::KdTreeView::visit_along)) are visitors of it. They
//! differ in how distances are computed, which is a [`WalkRay`], and in what is done at a leaf,
//! which is a [`Visitor`]. Both are static: a walk is compiled for each pair.

use core::ops::ControlFlow;

use crate::config::MAX_DEPTH;
use crate::tree::node::{KdNode, NodeKind};

/// A ray among the planes of a tree.
pub trait WalkRay {
    /// What distances along the ray are: `f32` or `f64`.
    type T: Copy + Default + PartialOrd;

    /// Whether the ray comes to the upper side of a plane across this axis first.
    fn is_backwards(&self, axis: usize) -> bool;

    /// The least and greatest `t` at which the ray may be at a plane. They enclose the exact one,
    /// with as much slack as the triangle tests need.
    ///
    /// For a plane that the ray never reaches, both lie beyond the whole walk: above it where the ray stays on the
    /// near side, below it where it stays on the far side. For a plane that the ray lies in, the interval holds the
    /// whole walk. The near side is the lower one, unless the ray is backwards.
    fn plane_interval(&self, axis: usize, position: f32) -> (Self::T, Self::T);
}

/// A leaf that the ray may pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf<T> {
    /// Its place among the nodes.
    pub node: u32,
    /// Its first reference.
    pub first: u32,
    /// How many references it has; 0 for empty space.
    pub count: u32,
    /// Where the ray enters the leaf's cell, or a little before.
    pub enter: T,
    /// Where the ray leaves it, or a little after; not less than `enter`.
    pub exit: T,
}

/// The purpose of a walk.
pub trait Visitor<T> {
    /// The walk has come to a node, interior or leaf.
    #[inline(always)]
    fn node(&mut self) {}

    /// The walk has come to a leaf. Returns the `t` beyond which no more leaves are of interest, or
    /// ends the walk.
    fn leaf(&mut self, leaf: Leaf<T>) -> ControlFlow<(), T>;
}

impl<T, F: FnMut(Leaf<T>) -> ControlFlow<(), T>> Visitor<T> for F {
    #[inline(always)]
    fn leaf(&mut self, leaf: Leaf<T>) -> ControlFlow<(), T> {
        self(leaf)
    }
}

/// Hands the leaves that a ray may pass within an interval to a visitor, near ones first. Both children of a
/// node are visited where the ray may be at their plane within the interval.
///
/// Leaves that begin at the `t` that the visitor returned last are still visited, since they may
/// hold ties with the best hit; those beyond are not.
///
/// The nodes must be those of a valid tree (see [`tree::validate`](crate::tree::validate)); the contents of their leaves
/// make no difference.
///
/// # Panics
/// Where nodes name children that do not exist, or are deeper than [`MAX_DEPTH`]. Nodes that name themselves or
/// those before them may make it loop forever.
#[inline(always)]
pub fn walk<R: WalkRay, V: Visitor<R::T>>(
    nodes: &[KdNode],
    ray: &R,
    interval: (R::T, R::T),
    visitor: &mut V,
) {
    walk_from(nodes, 0, ray, interval, visitor);
}

/// [`walk`] from another root, for several trees in one array.
///
/// # Panics
/// As [`walk`].
#[inline(always)]
pub fn walk_from<R: WalkRay, V: Visitor<R::T>>(
    nodes: &[KdNode],
    mut node: u32,
    ray: &R,
    (mut enter, mut exit): (R::T, R::T),
    visitor: &mut V,
) {
    // Each waiting node leaves the path to the current node at a level of its own.
    let mut stack = [(0u32, R::T::default(), R::T::default()); MAX_DEPTH as usize + 1];
    let mut top = 0;
    loop {
        visitor.node();
        match nodes[node as usize].kind() {
            NodeKind::Interior { axis, split, right } => {
                let (least, greatest) = ray.plane_interval(axis.index(), split);
                let backwards = ray.is_backwards(axis.index());
                let (near, far) = if backwards { (right, node + 1) } else { (node + 1, right) };
                if greatest < enter {
                    node = far;
                } else if least > exit {
                    node = near;
                } else {
                    stack[top] = (far, if least > enter { least } else { enter }, exit);
                    top += 1;
                    node = near;
                    if greatest < exit {
                        exit = greatest;
                    }
                }
                continue;
            }
            NodeKind::Leaf { first, count } => {
                let leaf = Leaf { node, first, count, enter, exit };
                let ControlFlow::Continue(stop) = visitor.leaf(leaf) else { return };
                loop {
                    if top == 0 {
                        return;
                    }
                    top -= 1;
                    (node, enter, exit) = stack[top];
                    if enter <= stop {
                        break;
                    }
                }
            }
        }
    }
}

#[cfg(all(test, feature = "alloc"))]
mod tests {
    use alloc::vec::Vec;

    use super::*;
    use crate::random;
    use crate::tree::node::Axis;

    /// A ray between whole numbers, whose distances to planes are fractions of 12: nothing is rounded.
    struct WholeRay {
        origin: [i64; 3],
        direction: [i64; 3],
    }

    impl WalkRay for WholeRay {
        type T = i64;

        fn is_backwards(&self, axis: usize) -> bool {
            self.direction[axis] < 0
        }

        fn plane_interval(&self, axis: usize, position: f32) -> (i64, i64) {
            let away = position as i64 - self.origin[axis];
            match (self.direction[axis], away.signum()) {
                (0, 1) => (i64::MAX, i64::MAX),
                (0, -1) => (i64::MIN, i64::MIN),
                (0, _) => (i64::MIN, i64::MAX),
                (step, _) => (12 * away / step, 12 * away / step),
            }
        }
    }

    /// The interval in which a ray is in a closed box, cut to another.
    fn within(ray: &WholeRay, cell: &[[i64; 2]; 3], (from, to): (i64, i64)) -> (i64, i64) {
        (0..3).fold((from, to), |(from, to), axis| {
            let [low, high] = cell[axis].map(|side| side - ray.origin[axis]);
            match ray.direction[axis] {
                0 if low <= 0 && high >= 0 => (from, to),
                0 => (1, 0),
                step if step > 0 => (from.max(12 * low / step), to.min(12 * high / step)),
                step => (from.max(12 * high / step), to.min(12 * low / step)),
            }
        })
    }

    /// Cuts a cell until it is small or chance says so; tells the leaves' cells.
    fn grow(
        nodes: &mut Vec<KdNode>,
        cells: &mut Vec<(u32, [[i64; 2]; 3])>,
        cell: [[i64; 2]; 3],
        seed: u64,
    ) {
        let at = nodes.len();
        let chance = |what: u64| random::hash(seed, &[at as u64, what]);
        let axis = chance(0) as usize % 3;
        let [low, high] = cell[axis];
        if high - low < 2 || chance(1).is_multiple_of(8) {
            cells.push((at as u32, cell));
            return nodes.push(KdNode::leaf(at as u32, chance(2) as u32 % 4));
        }
        let split = low + 1 + (chance(3) % (high - low - 1) as u64) as i64;
        let (mut below, mut above) = (cell, cell);
        (below[axis][1], above[axis][0]) = (split, split);
        nodes.push(KdNode::leaf(0, 0));
        grow(nodes, cells, below, seed);
        nodes[at] = KdNode::interior(Axis::ALL[axis], split as f32, nodes.len() as u32);
        grow(nodes, cells, above, seed);
    }

    /// The leaves visited are those whose closed cells the ray meets between its limits, near ones first, up to where
    /// the visitor has no more interest; and each is told with the part of the ray in it.
    #[test]
    fn leaves_are_those_that_the_ray_meets() {
        let (mut visited, mut touched, mut skipped) = (0, 0, 0);
        for round in 0..4_000u64 {
            let cell = [[0, 8]; 3];
            let (mut nodes, mut cells) = (Vec::new(), Vec::new());
            grow(&mut nodes, &mut cells, cell, round);
            let draw = |what: u64, of: u64| (random::hash(round, &[9, what]) % of) as i64;
            let ray = WholeRay {
                origin: [0, 1, 2].map(|k| draw(k, 13) - 2),
                direction: [3, 4, 5].map(|k| [0, 1, -1, 2, -2, 3, -3, 4][draw(k, 8) as usize]),
            };
            if ray.direction == [0; 3] {
                continue;
            }
            let limits = (draw(6, 60) - 30, draw(7, 120));
            let whole = within(&ray, &cell, limits);
            if whole.0 > whole.1 {
                continue;
            }
            let mut leaves = Vec::new();
            walk(&nodes, &ray, whole, &mut |leaf: Leaf<i64>| {
                leaves.push(leaf);
                ControlFlow::Continue(i64::MAX)
            });
            let mut expected = Vec::new();
            for &(node, ref cell) in &cells {
                let (enter, exit) = within(&ray, cell, limits);
                if enter <= exit {
                    touched += u32::from(enter == exit);
                    expected.push((node, enter, exit));
                }
            }
            let mut found: Vec<_> = leaves.iter().map(|l| (l.node, l.enter, l.exit)).collect();
            // A ray within a plane is on both sides of it at once.
            let in_order = found.windows(2).all(|pair| pair[0].1 <= pair[1].1);
            assert!(in_order || ray.direction.contains(&0), "{round}: {found:?}");
            found.sort_unstable();
            assert_eq!(found, expected, "{round}");
            for leaf in &leaves {
                let kind = NodeKind::Leaf { first: leaf.first, count: leaf.count };
                assert_eq!(nodes[leaf.node as usize].kind(), kind);
            }
            // Each leaf in turn says where the ray may end: those that begin there are visited, later ones are not.
            for end in [limits.0, (whole.0 + whole.1) / 2, leaves[leaves.len() / 2].enter] {
                let mut seen = Vec::new();
                walk(&nodes, &ray, whole, &mut |leaf: Leaf<i64>| {
                    seen.push(leaf);
                    ControlFlow::Continue(end)
                });
                let first = core::iter::once(leaves[0]);
                let rest = leaves[1..].iter().copied().filter(|leaf| leaf.enter <= end);
                let expected: Vec<_> = first.chain(rest).collect();
                assert_eq!(seen, expected, "{round} {end}");
                skipped += leaves.len() - seen.len();
            }
            // And breaks off.
            let mut left = leaves.len().div_ceil(2);
            walk(&nodes, &ray, whole, &mut |_: Leaf<i64>| {
                left -= 1;
                if left == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(i64::MAX) }
            });
            assert_eq!(left, 0);
            visited += leaves.len();
        }
        assert!(
            visited > 5_000 && touched > 500 && skipped > 5_000,
            "{visited} {touched} {skipped}"
        );
    }
}

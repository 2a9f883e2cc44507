//! How rays go down a tree, cell by cell.

use rayon::prelude::*;
use splitplane_core::ray::Ray;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{KdNode, NodeKind};

/// How rays go through inner nodes, added up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// Visits of inner nodes.
    nodes: u64,
    /// Visits of their children.
    children: u64,
    /// Visits of the child of each node that is visited less.
    lesser: u64,
}

impl Counts {
    pub(super) fn evenness(self) -> f64 {
        self.lesser as f64 / self.children.max(1) as f64
    }

    pub(super) fn children(self) -> f64 {
        self.children as f64 / self.nodes.max(1) as f64
    }
}

/// Follows rays through all cells that they meet, by [`splitplane_core::aabb::Aabb::ray_interval`].
pub(super) fn follow(tree: &KdTreeView<'_>, rays: &[Ray]) -> Counts {
    // Visits of the left and of the right child, by node.
    let none = || vec![[0u32; 2]; tree.nodes.len()];
    let visits = rays
        .par_iter()
        .fold(none, |mut visits, ray| {
            let mut stack = vec![(0usize, tree.bounds)];
            while let Some((node, cell)) = stack.pop() {
                let Some(NodeKind::Interior { axis, split, right }) =
                    tree.nodes.get(node).map(KdNode::kind)
                else {
                    continue;
                };
                let (mut left_cell, mut right_cell) = (cell, cell);
                left_cell.hi[axis.index()] = split;
                right_cell.lo[axis.index()] = split;
                for (side, (child, cell)) in
                    [(node + 1, left_cell), (right as usize, right_cell)].into_iter().enumerate()
                {
                    if cell.ray_interval(ray).is_some() {
                        visits[node][side] += 1;
                        stack.push((child, cell));
                    }
                }
            }
            visits
        })
        .reduce(none, |mut a, b| {
            for (a, b) in a.iter_mut().zip(b) {
                *a = [a[0] + b[0], a[1] + b[1]];
            }
            a
        });
    let mut counts = Counts::default();
    // A node's visits are those that its parent counts for it; the root has every ray that meets the bounds.
    let mut own = vec![0u64; tree.nodes.len()];
    if let Some(root) = own.first_mut() {
        *root = rays.iter().filter(|ray| tree.bounds.ray_interval(ray).is_some()).count() as u64;
    }
    for (node, [left, right]) in visits.iter().enumerate() {
        let Some(NodeKind::Interior { right: child, .. }) = tree.nodes.get(node).map(KdNode::kind)
        else {
            continue;
        };
        for (child, visits) in [(node + 1, left), (child as usize, right)] {
            if let Some(own) = own.get_mut(child) {
                *own = u64::from(*visits);
            }
        }
        counts.nodes += own[node];
        counts.children += u64::from(*left) + u64::from(*right);
        counts.lesser += u64::from(*left.min(right));
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::worked;

    /// Rays through the tree of Figure 8: its root splits x at 4, the children y at 2 and at 8.
    #[test]
    fn visits_by_hand() {
        let tree = worked::figure_8();
        let along = |origin: [f32; 3], direction: [f32; 3]| Ray::new(origin, direction);
        // Through the left child's lower leaf only; through both children of the root, both of them to the upper
        // leaf on the left and the lower on the right.
        let rays =
            [along([1.0, 1.0, -1.0], [0.0, 0.0, 1.0]), along([-1.0, 5.0, 5.0], [1.0, 0.0, 0.0])];
        let counts = follow(&tree, &rays);
        // Inner visits: the root twice, its left child twice, its right child once.
        assert_eq!(counts, Counts { nodes: 5, children: 3 + 2 + 1, lesser: 1 + 1 });
        // A ray that ends before the plane does not cross it.
        let short = rays[1].with_limits(0.0, 3.0);
        assert_eq!(follow(&tree, &[short]), Counts { nodes: 2, children: 2, lesser: 0 });
        assert_eq!(follow(&tree, &[along([0.0, 20.0, 0.0], [1.0, 0.0, 0.0])]).nodes, 0);
    }
}

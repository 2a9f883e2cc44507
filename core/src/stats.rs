//! What a tree is like: counts, histograms, the SAH cost of the whole.

use crate::config::MAX_DEPTH;
use crate::node::NodeKind;
use crate::sah::{equation_5, half_area_of};
use crate::tree::KdTreeView;

/// Classes of [`TreeStats::leaf_sizes`]: 0, 1, 2, 3-4, 5-8, ... and everything above 2^14.
pub const LEAF_SIZE_CLASSES: usize = 17;

/// Measures of a finished tree.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeStats {
    /// All nodes.
    pub nodes: usize,
    /// Interior nodes.
    pub interior: usize,
    /// Leaves, the empty ones included.
    pub leaves: usize,
    /// Leaves without triangles.
    pub empty_leaves: usize,
    /// References of all leaves.
    pub references: usize,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Most references of one leaf.
    pub largest_leaf: u32,
    /// Equation 5, corrected (see [`equation_5`]), in units of K_I: the expected cost of a random
    /// ray that meets the bounds and hits nothing.
    pub sah_cost: f64,
    /// The same with a leaf of n costed as ceil(n / W) blocks: what the builder minimises.
    pub block_cost: f64,
    /// Leaves at each depth.
    pub leaves_by_depth: [u32; MAX_DEPTH as usize + 1],
    /// Leaves by size: class 0 holds empty ones, class k those of more than 2^(k-2) and at most
    /// 2^(k-1) references.
    pub leaf_sizes: [u32; LEAF_SIZE_CLASSES],
    /// Bytes of nodes and references.
    pub bytes: u64,
}

impl TreeStats {
    /// Measures a tree.
    pub fn of(tree: &KdTreeView<'_>) -> TreeStats {
        let mut stats = TreeStats {
            nodes: tree.nodes.len(),
            interior: 0,
            leaves: 0,
            empty_leaves: 0,
            references: tree.references.len(),
            max_depth: 0,
            largest_leaf: 0,
            sah_cost: 0.0,
            block_cost: 0.0,
            leaves_by_depth: [0; MAX_DEPTH as usize + 1],
            leaf_sizes: [0; LEAF_SIZE_CLASSES],
            bytes: (size_of_val(tree.nodes) + size_of_val(tree.references)) as u64,
        };
        let (mut interior_area, mut leaf_area, mut block_area) = (0.0, 0.0, 0.0);
        tree.walk(|_, kind, cell, depth| {
            let area = half_area_of(cell);
            stats.max_depth = stats.max_depth.max(depth);
            match kind {
                NodeKind::Interior { .. } => {
                    stats.interior += 1;
                    interior_area += area;
                }
                NodeKind::Leaf { count, .. } => {
                    stats.leaves += 1;
                    stats.empty_leaves += usize::from(count == 0);
                    stats.largest_leaf = stats.largest_leaf.max(count);
                    leaf_area += area * f64::from(count);
                    block_area += area * f64::from(count.div_ceil(tree.config.block_width));
                    if let Some(leaves) = stats.leaves_by_depth.get_mut(depth as usize) {
                        *leaves += 1;
                    }
                    stats.leaf_sizes[leaf_size_class(count)] += 1;
                }
            }
        });
        let root = half_area_of(&tree.bounds);
        let ratio = tree.config.cost_ratio();
        stats.sah_cost = equation_5(ratio, 1.0, root, interior_area, leaf_area);
        stats.block_cost = equation_5(ratio, 1.0, root, interior_area, block_area);
        stats
    }
}

/// The class of a leaf in [`TreeStats::leaf_sizes`].
pub fn leaf_size_class(count: u32) -> usize {
    if count == 0 {
        return 0;
    }
    let above = u32::BITS - (count - 1).leading_zeros();
    (above as usize + 1).min(LEAF_SIZE_CLASSES - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::config::BuildConfig;
    use crate::node::{Axis, KdNode};

    #[test]
    fn one_split_costs_what_equation_5_says() {
        let nodes = [KdNode::interior(Axis::X, 0.5, 2), KdNode::leaf(0, 3), KdNode::leaf(3, 0)];
        let tree = KdTreeView {
            nodes: &nodes,
            references: &[0, 1, 2],
            bounds: Aabb { lo: [0.0; 3], hi: [1.0; 3] },
            triangles: 3,
            config: BuildConfig { traversal_cost: 3, intersection_cost: 2, ..Default::default() },
        };
        let stats = TreeStats::of(&tree);
        assert_eq!((stats.nodes, stats.leaves, stats.empty_leaves, stats.max_depth), (3, 2, 1, 1));
        // Root area 3, left child 2: 1.5 + 3 * 2/3, or one block.
        assert!((stats.sah_cost - 3.5).abs() < 1e-12);
        assert!((stats.block_cost - (1.5 + 2.0 / 3.0)).abs() < 1e-12);
        assert_eq!(stats.leaves_by_depth[1], 2);
    }

    #[test]
    fn size_classes() {
        let classes =
            [(0, 0), (1, 1), (2, 2), (3, 3), (4, 3), (5, 4), (8, 4), (9, 5), (u32::MAX, 16)];
        for (count, class) in classes {
            assert_eq!(leaf_size_class(count), class, "{count}");
        }
    }
}

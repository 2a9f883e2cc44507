//! Statistics of a tree: counts, histograms, and the expected cost of a random ray. The actual cost
//! of rays is counted in [`query::lines`](crate::query::lines).

use crate::config::MAX_DEPTH;
use crate::sah::{area_ratio, half_area_of};
use crate::tree::KdTreeView;
use crate::tree::cost::equation_5;
use crate::tree::node::NodeKind;

/// Classes of [`TreeStats::leaf_sizes`]: 0, 1, 2, 3-4, 5-8, ... and everything above 2^14.
pub const LEAF_SIZE_CLASSES: usize = 17;

/// The work of one ray on its way through a tree, or the average of many.
///
/// *Expected*, it is for a uniform line (see [`query::lines::Lines`](crate::query::lines::Lines)) through the bounds that passes
/// through everything. Such a line meets a convex cell inside the bounds with probability
/// `A(cell) / A(root)`, A being the surface area (MacDonald and Booth 1990). A traversal that
/// visits exactly the cells on the way therefore visits a class of nodes
///
/// ```text
/// sum over the nodes of the class: A(node) / A(root)
/// ```
///
/// times on average, and meets `sum over leaves: n(leaf) A(leaf) / A(root)` references. Aila,
/// Karras and Laine 2013 decompose the tree's SAH cost in the same way, and show what it does not
/// say: rays end at what they hit, and rarely are uniform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayCost {
    /// Traversal steps: interior nodes visited.
    pub interior: f64,
    /// Leaves visited, the empty ones included.
    pub leaves: f64,
    /// Leaves without triangles visited.
    pub empty_leaves: f64,
    /// Triangle tests: a triangle is tested in each leaf on the way that refers to it.
    pub tests: f64,
    /// Block tests: a leaf of n takes ceil(n / W).
    pub blocks: f64,
}

impl RayCost {
    /// The names of the quantities, in the order of [`RayCost::to_array`].
    pub const NAMES: [&'static str; 5] = ["interior", "leaves", "empty_leaves", "tests", "blocks"];

    /// The quantities in the order of their declaration.
    pub const fn to_array(self) -> [f64; 5] {
        [self.interior, self.leaves, self.empty_leaves, self.tests, self.blocks]
    }

    /// The inverse of [`RayCost::to_array`].
    pub const fn from_array([interior, leaves, empty_leaves, tests, blocks]: [f64; 5]) -> RayCost {
        RayCost { interior, leaves, empty_leaves, tests, blocks }
    }

    /// The cost in units of K_I, each triangle tested by itself: C_ts times the steps plus the tests.
    pub fn by_tests(&self, cost_ratio: f64) -> f64 {
        cost_ratio * self.interior + self.tests
    }

    /// The same with W triangles per test.
    pub fn by_blocks(&self, cost_ratio: f64) -> f64 {
        cost_ratio * self.interior + self.blocks
    }
}

/// Measures of a finished tree.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
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
    /// The same with a leaf of n costed as ceil(n / W) blocks, which builders minimise. Compares
    /// trees of equal K_T, K_I and W only.
    pub block_cost: f64,
    /// The expected work of a uniform line through the bounds that passes through everything.
    /// `sah_cost` is [`RayCost::by_tests`] of it, `block_cost` is [`RayCost::by_blocks`]. Zero
    /// where the bounds have no area, so that no line meets them.
    pub expected: RayCost,
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
            expected: RayCost::default(),
            leaves_by_depth: [0; MAX_DEPTH as usize + 1],
            leaf_sizes: [0; LEAF_SIZE_CLASSES],
            bytes: (size_of_val(tree.nodes) + size_of_val(tree.references)) as u64,
        };
        // Sums of half areas, each times the weight of a visit.
        let mut areas = RayCost::default();
        tree.walk(|_, kind, cell, depth| {
            let area = half_area_of(cell);
            stats.max_depth = stats.max_depth.max(depth);
            match kind {
                NodeKind::Interior { .. } => {
                    stats.interior += 1;
                    areas.interior += area;
                }
                NodeKind::Leaf { count, .. } => {
                    stats.leaves += 1;
                    stats.empty_leaves += usize::from(count == 0);
                    stats.largest_leaf = stats.largest_leaf.max(count);
                    areas.leaves += area;
                    areas.empty_leaves += if count == 0 { area } else { 0.0 };
                    areas.tests += area * f64::from(count);
                    areas.blocks += area * f64::from(count.div_ceil(tree.config.block_width));
                    if let Some(leaves) = stats.leaves_by_depth.get_mut(depth as usize) {
                        *leaves += 1;
                    }
                    stats.leaf_sizes[leaf_size_class(count)] += 1;
                }
            }
        });
        let root = half_area_of(&tree.bounds);
        let ratio = tree.config.cost_ratio();
        stats.sah_cost = equation_5(ratio, 1.0, root, areas.interior, areas.tests);
        stats.block_cost = equation_5(ratio, 1.0, root, areas.interior, areas.blocks);
        if root > 0.0 {
            stats.expected = RayCost::from_array(areas.to_array().map(|a| area_ratio(a, root)));
        }
        stats
    }

    /// References for each triangle kept; 1 where no triangle is in two leaves. `kept` is the number
    /// of triangles less those dropped ([`mesh`](crate::mesh) says which those are); 0 for none.
    pub fn duplication(&self, kept: u32) -> f64 {
        if kept == 0 { 0.0 } else { self.references as f64 / f64::from(kept) }
    }

    /// The depth of the leaves on average, 0 for the root.
    pub fn mean_leaf_depth(&self) -> f64 {
        let depths = self.leaves_by_depth.iter().enumerate();
        let sum: u64 = depths.map(|(depth, &leaves)| depth as u64 * u64::from(leaves)).sum();
        if self.leaves == 0 { 0.0 } else { sum as f64 / self.leaves as f64 }
    }
}

/// The least and the greatest number of references of a class of [`TreeStats::leaf_sizes`].
pub fn leaf_sizes_of_class(class: usize) -> [u32; 2] {
    match class {
        0 => [0, 0],
        1 => [1, 1],
        _ if class >= LEAF_SIZE_CLASSES - 1 => [(1 << (LEAF_SIZE_CLASSES - 3)) + 1, u32::MAX],
        _ => [(1 << (class - 2)) + 1, 1 << (class - 1)],
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
    use crate::tree::node::{Axis, KdNode};

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
        // Every line meets the root, two in three the left half, two in three the right one.
        let third = 1.0 / 3.0;
        let expected = [1.0, 4.0 * third, 2.0 * third, 2.0, 2.0 * third];
        for (a, b) in stats.expected.to_array().into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-12, "{:?}", stats.expected);
        }
        assert!((stats.expected.by_tests(1.5) - stats.sah_cost).abs() < 1e-12);
        assert!((stats.expected.by_blocks(1.5) - stats.block_cost).abs() < 1e-12);
        assert_eq!((stats.duplication(2), stats.duplication(0)), (1.5, 0.0));
        assert_eq!(stats.mean_leaf_depth(), 1.0);
    }

    /// Two splits, areas that differ: the second across another axis, its planes off the middle.
    #[test]
    fn areas_are_relative_to_the_root_at_every_depth() {
        let nodes = [
            KdNode::interior(Axis::Z, 3.0, 4),
            KdNode::interior(Axis::X, 0.5, 3),
            KdNode::leaf(0, 0),
            KdNode::leaf(0, 5),
            KdNode::leaf(5, 2),
        ];
        let tree = KdTreeView {
            nodes: &nodes,
            references: &[0, 1, 2, 3, 4, 4, 5],
            bounds: Aabb { lo: [0.0; 3], hi: [2.0, 1.0, 4.0] },
            triangles: 6,
            config: BuildConfig { block_width: 4, ..Default::default() },
        };
        // Half areas: 14 the root, 11 its lower child, 5 and 9 that one's children, 5 the upper.
        let expected = [25.0, 19.0, 5.0, 55.0, 23.0].map(|area| area / 14.0);
        let found = TreeStats::of(&tree).expected.to_array();
        for (a, b) in found.into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-12, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn a_tree_without_area_costs_nothing() {
        let tree = KdTreeView {
            nodes: &[KdNode::leaf(0, 1)],
            references: &[0],
            bounds: Aabb { lo: [1.0, 1.0, 0.0], hi: [1.0, 1.0, 5.0] },
            triangles: 1,
            config: BuildConfig::default(),
        };
        assert_eq!(TreeStats::of(&tree).expected, RayCost::default());
    }

    #[test]
    fn size_classes() {
        let classes =
            [(0, 0), (1, 1), (2, 2), (3, 3), (4, 3), (5, 4), (8, 4), (9, 5), (u32::MAX, 16)];
        for (count, class) in classes {
            assert_eq!(leaf_size_class(count), class, "{count}");
        }
        for class in 0..LEAF_SIZE_CLASSES {
            for end in leaf_sizes_of_class(class) {
                assert_eq!(leaf_size_class(end), class);
            }
        }
        let next = (1..LEAF_SIZE_CLASSES).map(|class| leaf_sizes_of_class(class)[0]);
        let ends = (0..LEAF_SIZE_CLASSES).map(|class| leaf_sizes_of_class(class)[1]);
        assert!(ends.zip(next).all(|(end, next)| end + 1 == next));
    }
}

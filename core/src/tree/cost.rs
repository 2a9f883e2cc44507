//! The cost of a finished tree by the surface area heuristic: Equations 3 and 5 of Martin's survey, in `f64`, for reports.

use crate::sah::{area_ratio, equation_2, half_area_of};
use crate::tree::KdTreeView;
use crate::tree::node::{KdNode, NodeKind};

/// Equation 3: the cost of a tree by the children of its nodes, the sum of [`equation_2`] over all of them. 0 where the
/// bounds have no area.
///
/// Equation 4 is this sum for the tree of the survey's Figure 8: `2 (1 + 18/30 + 22/30) = 4.67`.
pub fn equation_3(tree: &KdTreeView<'_>) -> f64 {
    let root = half_area_of(&tree.bounds);
    let mut sum = 0.0;
    tree.walk(|_, kind, cell, _| {
        let children = if matches!(kind, NodeKind::Interior { .. }) { 2 } else { 0 };
        sum += equation_2(children, half_area_of(cell), root);
    });
    if root > 0.0 { sum } else { 0.0 }
}

/// Equation 5, corrected: the cost of a finished tree. Areas are relative to the *root*, and a
/// leaf costs K_I for each of its triangles (as Aila, Karras and Laine 2013 print it).
/// [`equation_5_printed`] is the form that the survey prints.
///
/// `interior_area` is the sum of interior half areas, `leaf_area` the sum of leaf half areas each
/// times its triangle count.
pub fn equation_5(
    traversal: f64,
    intersection: f64,
    root_area: f64,
    interior_area: f64,
    leaf_area: f64,
) -> f64 {
    if root_area <= 0.0 {
        return 0.0;
    }
    (traversal * interior_area + intersection * leaf_area) / root_area
}

/// Equation 5 as the survey prints it: areas relative to the node's *parent*, the root its own, and
/// K_I once per leaf, however many triangles it has. It grows with the number of nodes and says
/// little about the cost of rays. Nodes whose parent has no area count nothing.
pub fn equation_5_printed(traversal: f64, intersection: f64, tree: &KdTreeView<'_>) -> f64 {
    let cost = |index: usize| {
        let leaf = tree.nodes.get(index).is_some_and(KdNode::is_leaf);
        if leaf { intersection } else { traversal }
    };
    let mut sum = if half_area_of(&tree.bounds) > 0.0 { cost(0) } else { 0.0 };
    tree.walk(|index, kind, cell, _| {
        let NodeKind::Interior { axis, split, right } = kind else { return };
        let parent = half_area_of(cell);
        if parent > 0.0 {
            let (mut low, mut high) = (*cell, *cell);
            low.hi[axis.index()] = split;
            high.lo[axis.index()] = split;
            for (child, index) in [(low, index + 1), (high, right as usize)] {
                sum += cost(index) * area_ratio(half_area_of(&child), parent);
            }
        }
    });
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::config::BuildConfig;
    use crate::sah::equation_6;
    use crate::tree::node::Axis;

    /// The tree of the survey's Figure 8: its planes, and leaves of which one holds three triangles.
    fn figure_8() -> [KdNode; 7] {
        [
            KdNode::interior(Axis::X, 4.0, 4),
            KdNode::interior(Axis::Y, 2.0, 3),
            KdNode::leaf(0, 0),
            KdNode::leaf(0, 3),
            KdNode::interior(Axis::Y, 8.0, 6),
            KdNode::leaf(3, 0),
            KdNode::leaf(3, 0),
        ]
    }

    fn view(nodes: &[KdNode]) -> KdTreeView<'_> {
        let bounds = Aabb { lo: [0.0; 3], hi: [10.0; 3] };
        let config = BuildConfig::default();
        KdTreeView { nodes, references: &[0, 1, 2], bounds, triangles: 3, config }
    }

    /// 2 (300 + 180 + 220) / 300: Equation 4.
    #[test]
    fn equation_4_is_equation_3_of_figure_8() {
        let cost = equation_3(&view(&figure_8()));
        assert!((cost - 14.0 / 3.0).abs() < 1e-12, "{cost}");
        assert_eq!(equation_2(2, 300.0, 300.0), 2.0);
        assert_eq!(equation_2(0, 88.0, 300.0), 0.0);
        let flat = Aabb { lo: [0.0; 3], hi: [0.0, 0.0, 1.0] };
        assert_eq!(equation_3(&KdTreeView { bounds: flat, ..view(&figure_8()) }), 0.0);
    }

    /// By hand: K_T (1 + 180/300 + 220/300) and K_I ((68 + 152)/180 + (188 + 92)/220).
    #[test]
    fn equation_5_as_printed_divides_by_the_parent() {
        let expected = 3.0 * (700.0 / 300.0) + 5.0 * (220.0 / 180.0 + 280.0 / 220.0);
        let cost = equation_5_printed(3.0, 5.0, &view(&figure_8()));
        assert!((cost - expected).abs() < 1e-12, "{cost} {expected}");
        assert_eq!(equation_5_printed(3.0, 5.0, &view(&[KdNode::leaf(0, 3)])), 5.0);
        // A line has no area, and neither have its parts.
        let bounds = Aabb { lo: [0.0; 3], hi: [0.0, 0.0, 1.0] };
        let nodes = [KdNode::interior(Axis::Z, 0.5, 2), KdNode::leaf(0, 3), KdNode::leaf(3, 0)];
        assert_eq!(equation_5_printed(3.0, 5.0, &KdTreeView { bounds, ..view(&nodes) }), 0.0);
    }

    #[test]
    fn equation_5_is_root_normalised_and_counts_triangles() {
        // One split of a unit cube in the middle, 3 and 5 triangles: root area 3, halves 2 each.
        let cost = equation_5(1.5, 2.0, 3.0, 3.0, 3.0 * 2.0 + 5.0 * 2.0);
        assert!((cost - (1.5 + 2.0 * 16.0 / 3.0)).abs() < 1e-12);
        // Which is Equation 6 for the same split, there in units of K_I.
        assert!((cost - 2.0 * equation_6(0.75, [3.0, 2.0, 2.0], 3.0, 5.0)).abs() < 1e-12);
    }
}

//! The boxes of a tree's nodes at one depth.

use splitplane_core::aabb::Aabb;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::NodeKind;

/// Most boxes that are drawn: each is twelve lines, tessellated anew for every frame.
pub(super) const MOST: usize = 1500;

/// What is in a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// More nodes.
    Interior,
    /// Triangles.
    Leaf,
    /// Nothing.
    Empty,
}

/// The boxes at one depth, the largest of them where there are too many.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LevelBoxes {
    /// The boxes to draw, at most [`MOST`].
    pub(super) boxes: Vec<(Aabb, Content)>,
    /// How many there are.
    pub(super) total: usize,
}

impl LevelBoxes {
    /// The boxes of all nodes that are so many levels below the root.
    pub(super) fn of(tree: &KdTreeView<'_>, level: u32) -> LevelBoxes {
        let mut boxes = Vec::new();
        tree.walk(|_, kind, cell, depth| {
            if depth == level && !cell.is_empty() {
                let content = match kind {
                    NodeKind::Interior { .. } => Content::Interior,
                    NodeKind::Leaf { count: 0, .. } => Content::Empty,
                    NodeKind::Leaf { .. } => Content::Leaf,
                };
                boxes.push((*cell, content));
            }
        });
        let total = boxes.len();
        if total > MOST {
            // Stable, so that equal sizes keep the order of the tree.
            boxes.sort_by(|(a, _), (b, _)| area(b).total_cmp(&area(a)));
            boxes.truncate(MOST);
        }
        LevelBoxes { boxes, total }
    }
}

/// Half the surface of a box.
fn area(cell: &Aabb) -> f64 {
    let [x, y, z] = [0, 1, 2].map(|axis| f64::from(cell.hi[axis]) - f64::from(cell.lo[axis]));
    x * y + y * z + z * x
}

/// The corners of a box: bit 0 of the index chooses the upper x, bit 1 y, bit 2 z.
pub(super) fn corners(cell: &Aabb) -> [[f32; 3]; 8] {
    [0, 1, 2, 3, 4, 5, 6, 7].map(|index: usize| {
        [0, 1, 2].map(|axis| if index >> axis & 1 == 1 { cell.hi[axis] } else { cell.lo[axis] })
    })
}

/// The edges of a box, as pairs of corners that differ in one bit.
pub(super) const EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [2, 3],
    [4, 5],
    [6, 7],
    [0, 2],
    [1, 3],
    [4, 6],
    [5, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane_core::config::BuildConfig;
    use splitplane_core::tree::node::{Axis, KdNode};

    fn view<'a>(nodes: &'a [KdNode], references: &'a [u32]) -> KdTreeView<'a> {
        let bounds = Aabb { lo: [0.0; 3], hi: [4.0, 1.0, 1.0] };
        KdTreeView { nodes, references, bounds, triangles: 1, config: BuildConfig::default() }
    }

    #[test]
    fn each_level_has_its_cells() {
        let nodes = [
            KdNode::interior(Axis::X, 1.0, 2),
            KdNode::leaf(0, 1),
            KdNode::interior(Axis::Y, 0.5, 4),
            KdNode::leaf(1, 0),
            KdNode::leaf(1, 0),
        ];
        let tree = view(&nodes, &[0]);
        let root = LevelBoxes::of(&tree, 0);
        assert_eq!(root.boxes, [(tree.bounds, Content::Interior)]);
        let first = LevelBoxes::of(&tree, 1);
        assert_eq!(first.total, 2);
        let left = Aabb { lo: [0.0; 3], hi: [1.0; 3] };
        assert!(first.boxes.contains(&(left, Content::Leaf)));
        let second = LevelBoxes::of(&tree, 2);
        assert!(second.boxes.iter().all(|(cell, content)| {
            *content == Content::Empty && cell.lo[0] == 1.0 && cell.hi[0] == 4.0
        }));
        assert_eq!(LevelBoxes::of(&tree, 3).total, 0);
    }

    #[test]
    fn of_too_many_the_largest_stay() {
        let depth = 11;
        let mut nodes = Vec::new();
        full(&mut nodes, depth, 0.0, 4.0);
        let tree = view(&nodes, &[]);
        let boxes = LevelBoxes::of(&tree, depth);
        assert_eq!((boxes.total, boxes.boxes.len()), (1 << depth, MOST));
        assert_eq!(LevelBoxes::of(&tree, 4).boxes.len(), 16);
    }

    /// A full tree of splits at a third on x.
    fn full(nodes: &mut Vec<KdNode>, depth: u32, lo: f32, hi: f32) {
        if depth == 0 {
            nodes.push(KdNode::leaf(0, 0));
            return;
        }
        let at = nodes.len();
        let split = lo + (hi - lo) / 3.0;
        nodes.push(KdNode::leaf(0, 0));
        full(nodes, depth - 1, lo, split);
        nodes[at] = KdNode::interior(Axis::X, split, nodes.len() as u32);
        full(nodes, depth - 1, split, hi);
    }

    #[test]
    fn edges_join_corners_that_differ_on_one_axis() {
        let corners = corners(&Aabb { lo: [0.0; 3], hi: [1.0, 2.0, 3.0] });
        for [a, b] in EDGES {
            let differ = (0..3).filter(|&axis| corners[a][axis] != corners[b][axis]).count();
            assert_eq!(differ, 1);
        }
    }
}

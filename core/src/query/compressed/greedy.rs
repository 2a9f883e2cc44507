//! Compressed nodes made top down, level by level, without costs: a rule that needs no more of a tree than its planes, so
//! that a device can follow it for a tree that it has just built.
//!
//! A node has the children of its part of the tree. While there are fewer than eight, the interior one of greatest surface
//! area is replaced by its own two, of equal ones the first; empty leaves are left out. A subtree's box is its cell, a
//! leaf's the part of its cell that its triangles' bounds reach into, both widened by the scene's slack. A leaf of the tree
//! stays one, unless it is too long. Nodes and references of a level come in the order of the nodes that they belong to.

use super::encode::{rounded_down, rounded_up};
use super::make::share;
use super::{CHILDREN, CompressedNode, CompressedNodes, LEAF_MOST};
use crate::aabb::Aabb;
use crate::query::intersect::SceneScale;
use crate::query::traverse::Triangles;
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use alloc::vec;
use alloc::vec::Vec;

/// What becomes a child.
#[derive(Clone, Copy)]
enum Part {
    /// A node of the tree with two children that have references, and its cell.
    Interior { left: u32, right: u32, cell: Aabb, children: [Aabb; 2] },
    /// Some references and the box around them.
    Run { first: u32, count: u32, bounds: Aabb },
}

impl CompressedNodes {
    /// The nodes of a tree with the snapped corners of its mesh by the rule that a device can follow; the hits are those of
    /// [`CompressedNodes::new`], and of the tree. The tree must be valid (see
    /// [`tree::validate`](crate::tree::validate)), and `scale` of these triangles. `None` where leaves name more than
    /// [`MOST_REFERENCES`](CompressedNodes::MOST_REFERENCES).
    pub fn greedy(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        scale: &SceneScale,
    ) -> Option<CompressedNodes> {
        if tree.references.len() > CompressedNodes::MOST_REFERENCES as usize {
            return None;
        }
        let mut made = CompressedNodes { nodes: Vec::new(), references: Vec::new() };
        let mut active = vec![part_of(tree, 0, tree.bounds)];
        while !active.is_empty() {
            let first_child = made.nodes.len() + active.len();
            let mut next = Vec::new();
            for part in active {
                let parts = opened(tree, part);
                let mut node = CompressedNode {
                    first_child: (first_child + next.len()) as u32,
                    first_reference: made.references.len() as u32,
                    ..CompressedNode::default()
                };
                let is_node = |part: &Part| match *part {
                    Part::Interior { .. } => true,
                    Part::Run { count, .. } => count > LEAF_MOST,
                };
                let (nodes, leaves): (Vec<Part>, Vec<Part>) = parts.into_iter().partition(is_node);
                let boxes =
                    nodes.iter().chain(&leaves).map(|part| bounds(tree, part, triangles, scale));
                node.set_boxes(&boxes.collect::<Vec<Aabb>>());
                let mut counts = Vec::new();
                for leaf in &leaves {
                    let Part::Run { first, count, .. } = *leaf else { continue };
                    made.references.extend_from_slice(tree.leaf(first, count));
                    counts.push(count);
                }
                node.set_children(nodes.len(), &counts);
                made.nodes.push(node);
                next.extend(nodes);
            }
            active = next;
        }
        Some(made)
    }
}

/// The highest part of a subtree with references on both sides of its plane, or its only leaf that has any.
fn part_of(tree: &KdTreeView<'_>, mut index: u32, mut cell: Aabb) -> Part {
    loop {
        let Some(node) = tree.nodes.get(index as usize) else {
            return Part::Run { first: 0, count: 0, bounds: cell };
        };
        match node.kind() {
            NodeKind::Leaf { first, count } => return Part::Run { first, count, bounds: cell },
            NodeKind::Interior { axis, split, right } => {
                let left = index + 1;
                let (mut low, mut high) = (cell, cell);
                (low.hi[axis.index()], high.lo[axis.index()]) = (split, split);
                match (is_empty(tree, left), is_empty(tree, right)) {
                    (true, _) => (index, cell) = (right, high),
                    (_, true) => (index, cell) = (left, low),
                    _ => return Part::Interior { left, right, cell, children: [low, high] },
                }
            }
        }
    }
}

/// Whether a node is an empty leaf. No subtree of ours is without references as a whole.
fn is_empty(tree: &KdTreeView<'_>, index: u32) -> bool {
    matches!(tree.nodes[index as usize].kind(), NodeKind::Leaf { count: 0, .. })
}

/// The parts that become the children of the node that a part becomes.
fn opened(tree: &KdTreeView<'_>, part: Part) -> Vec<Part> {
    let mut parts = match part {
        Part::Run { count: 0, .. } => return Vec::new(),
        Part::Run { first, count, bounds } => {
            let runs = share(first, count, CHILDREN as u32);
            return runs.map(|(first, count)| Part::Run { first, count, bounds }).collect();
        }
        Part::Interior { .. } => vec![part],
    };
    while parts.len() < CHILDREN {
        let mut widest: Option<(usize, f32)> = None;
        for (place, part) in parts.iter().enumerate() {
            if let Part::Interior { cell, .. } = part {
                let area = half_area(cell);
                if widest.is_none_or(|(_, most)| area > most) {
                    widest = Some((place, area));
                }
            }
        }
        let Some((place, _)) = widest else { break };
        let Part::Interior { left, right, children, .. } = parts[place] else { break };
        parts[place] = part_of(tree, left, children[0]);
        parts.push(part_of(tree, right, children[1]));
    }
    parts
}

/// Half the surface area of a cell, of halved extents.
fn half_area(cell: &Aabb) -> f32 {
    let [x, y, z] = [0, 1, 2].map(|axis| cell.half_extent(axis));
    x * y + y * z + z * x
}

/// The box of a child.
fn bounds(
    tree: &KdTreeView<'_>,
    part: &Part,
    triangles: &(impl Triangles + ?Sized),
    scale: &SceneScale,
) -> Aabb {
    let part = match *part {
        Part::Interior { cell, .. } => cell,
        Part::Run { first, count, bounds } => {
            let corners = tree.leaf(first, count).iter().map(|&name| triangles.corners(name));
            let all = corners.fold(Aabb::EMPTY, |all, one| all.union(&Aabb::of_points(&one)));
            let part = all.intersection(&bounds);
            // Whatever rounding did to a cell: what the leaf has is not to be lost.
            if (0..3).any(|axis| part.lo[axis] > part.hi[axis]) { bounds } else { part }
        }
    };
    let slack = f64::from(scale.slack);
    Aabb {
        lo: part.lo.map(|x| rounded_down(f64::from(x) - slack)),
        hi: part.hi.map(|x| rounded_up(f64::from(x) + slack)),
    }
}

//! Making compressed nodes from a finished tree.

use super::plan::Plan;
use super::{CHILDREN, CompressedNode, CompressedNodes, LEAF_MOST};
use crate::aabb::Aabb;
use crate::query::intersect::SceneScale;
use crate::query::traverse::Triangles;
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use alloc::vec;
use alloc::vec::Vec;

/// What is to become a child.
#[derive(Clone, Copy)]
enum Part {
    /// A node of the tree.
    Subtree(u32),
    /// Some references, and the box that they share.
    Run(u32, u32, Aabb),
}

/// The parts that become the children of one node.
struct Parts {
    parts: [Part; CHILDREN],
    count: usize,
}

impl Parts {
    fn none() -> Parts {
        Parts { parts: [Part::Subtree(0); CHILDREN], count: 0 }
    }

    fn push(&mut self, part: Part) {
        self.parts[self.count] = part;
        self.count += 1;
    }

    fn push_runs(&mut self, runs: impl Iterator<Item = (u32, u32)>, bounds: Aabb) {
        runs.for_each(|(first, count)| self.push(Part::Run(first, count, bounds)));
    }

    fn as_slice(&self) -> &[Part] {
        &self.parts[..self.count]
    }
}

impl CompressedNodes {
    /// The nodes of a tree with the snapped corners of its mesh. The tree must be valid (see
    /// [`tree::validate`](crate::tree::validate)), and `scale` of these triangles. Takes about 70 bytes a node of the
    /// tree meanwhile, and one thread. `None` where leaves name more than
    /// [`MOST_REFERENCES`](CompressedNodes::MOST_REFERENCES).
    pub fn new(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        scale: &SceneScale,
    ) -> Option<CompressedNodes> {
        if tree.references.len() > CompressedNodes::MOST_REFERENCES as usize {
            return None;
        }
        let plan = Plan::new(tree, triangles, scale);
        let mut made = CompressedNodes {
            nodes: vec![CompressedNode::default()],
            references: Vec::with_capacity(tree.references.len()),
        };
        let mut root = Parts::none();
        if !tree.nodes.is_empty() {
            plan.spread(0, 1, &mut root);
        }
        // A root that is one node of the tree is that node; a root of leaves has them as children.
        let mut waiting = match *root.as_slice() {
            [part @ Part::Subtree(node)] if !plan.nodes[node as usize].is_leaf => {
                vec![(0, plan.opened(part))]
            }
            _ => vec![(0, root)],
        };
        while let Some((place, parts)) = waiting.pop() {
            let node = made.node(&plan, parts.as_slice(), &mut waiting);
            made.nodes[place] = node;
        }
        Some(made)
    }

    /// A node with these children. Those that are nodes get their places, and are left to be made.
    fn node(
        &mut self,
        plan: &Plan<'_>,
        parts: &[Part],
        waiting: &mut Vec<(usize, Parts)>,
    ) -> CompressedNode {
        let mut node = CompressedNode {
            first_child: self.nodes.len() as u32,
            first_reference: self.references.len() as u32,
            ..CompressedNode::default()
        };
        let mut boxes = Vec::with_capacity(CHILDREN);
        let mut leaves = Vec::new();
        let planned = |part: Part| match part {
            Part::Subtree(index) => {
                let planned = &plan.nodes[index as usize];
                (planned.bounds, planned.first, planned.count, planned.is_leaf)
            }
            Part::Run(first, count, bounds) => (bounds, first, count, count <= LEAF_MOST),
        };
        // Nodes first.
        for &part in parts {
            let (bounds, _, _, is_leaf) = planned(part);
            if !is_leaf {
                boxes.push(bounds);
                waiting.push((self.nodes.len(), plan.opened(part)));
                self.nodes.push(CompressedNode::default());
            }
        }
        let nodes = boxes.len();
        for &part in parts {
            let (bounds, first, count, is_leaf) = planned(part);
            if !is_leaf {
                continue;
            }
            boxes.push(bounds);
            let start = self.references.len();
            for &triangle in &plan.tree.references[first as usize..(first + count) as usize] {
                // Subtrees that became one leaf may name a triangle twice.
                if !self.references[start..].contains(&triangle) {
                    self.references.push(triangle);
                }
            }
            leaves.push((self.references.len() - start) as u32);
        }
        node.set_children(nodes, &leaves);
        node.set_boxes(&boxes);
        node
    }
}

impl Plan<'_> {
    /// The children of the node that a part becomes.
    fn opened(&self, part: Part) -> Parts {
        let mut parts = Parts::none();
        match part {
            Part::Subtree(index) => match self.forked(index) {
                Some((_, left, right)) => {
                    let places = self.root_division(left, right);
                    self.spread(left, places, &mut parts);
                    self.spread(right, CHILDREN - places, &mut parts);
                }
                None => self.spread(index, CHILDREN, &mut parts),
            },
            Part::Run(first, count, bounds) => {
                parts.push_runs(share(first, count, CHILDREN as u32), bounds);
            }
        }
        parts
    }

    /// The highest node of a subtree with triangles on both sides, and its children; `None` for one leaf.
    fn forked(&self, mut index: u32) -> Option<(u32, u32, u32)> {
        while let NodeKind::Interior { right, .. } = self.tree.nodes[index as usize].kind() {
            match (self.nodes[index as usize + 1].count, self.nodes[right as usize].count) {
                (0, _) => index = right,
                (_, 0) => index += 1,
                _ => return Some((index, index + 1, right)),
            }
        }
        None
    }

    /// Distributes a subtree over at most so many children of a node.
    fn spread(&self, index: u32, mut places: usize, parts: &mut Parts) {
        let planned = &self.nodes[index as usize];
        if planned.count == 0 {
            return;
        }
        let Some((_, left, right)) = self.forked(index) else {
            if planned.count <= LEAF_MOST {
                return parts.push(Part::Subtree(index));
            }
            return match planned.count.div_ceil(LEAF_MOST) as usize <= places {
                true => parts
                    .push_runs(share(planned.first, planned.count, places as u32), planned.bounds),
                false => parts.push(Part::Run(planned.first, planned.count, planned.bounds)),
            };
        };
        while places > 1 {
            if let Some(first) = self.division(left, right, planned, places) {
                self.spread(left, first, parts);
                return self.spread(right, places - first, parts);
            }
            places -= 1;
        }
        parts.push(Part::Subtree(index));
    }
}

/// Divides references among as many children as they need, at most `places`: where each begins, and how many it has.
pub(crate) fn share(first: u32, count: u32, places: u32) -> impl Iterator<Item = (u32, u32)> {
    let places = count.div_ceil(LEAF_MOST).min(places).max(1);
    let mut next = first;
    (0..places).map(move |place| {
        let part = count / places + u32::from(place < count % places);
        next += part;
        (next - part, part)
    })
}

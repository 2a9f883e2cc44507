//! The top of a tree as a diagram (the survey's Figure 8).

use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::node::{Axis, NodeKind};

/// A node of the diagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// The number of its parent in the diagram; `None` for the root.
    pub parent: Option<usize>,
    /// Its level.
    pub depth: u32,
    /// Where it stands from left to right, in widths of the lowest row.
    pub place: f64,
    /// The axis of its plane; `None` for a leaf.
    pub axis: Option<Axis>,
    /// References of the leaves under it.
    pub references: usize,
}

/// The top levels of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Crown {
    /// The nodes, parents first.
    pub nodes: Vec<Node>,
    /// The lowest level.
    pub levels: u32,
    /// Places from left to right.
    pub places: usize,
}

/// Most nodes side by side.
const MOST_PLACES: usize = 26;

/// As many levels as can stand side by side, three at least.
pub fn of(tree: &KdTreeView<'_>) -> Crown {
    let mut crown = to_level(tree, 3);
    for levels in 4..=8 {
        let deeper = to_level(tree, levels);
        if deeper.places > MOST_PLACES {
            break;
        }
        crown = deeper;
    }
    crown
}

fn to_level(tree: &KdTreeView<'_>, levels: u32) -> Crown {
    let mut crown = Crown { nodes: Vec::new(), levels, places: 0 };
    crown.add(tree, 0, None, 0);
    crown
}

impl Crown {
    /// Adds a node and what is drawn of its subtree; gives its number.
    fn add(
        &mut self,
        tree: &KdTreeView<'_>,
        index: usize,
        parent: Option<usize>,
        depth: u32,
    ) -> usize {
        let number = self.nodes.len();
        let kind = tree.nodes.get(index).map(splitplane_core::tree::node::KdNode::kind);
        let references = references(tree, index);
        let axis = match kind {
            Some(NodeKind::Interior { axis, .. }) => Some(axis),
            _ => None,
        };
        self.nodes.push(Node { parent, depth, place: 0.0, axis, references });
        self.nodes[number].place = match kind {
            Some(NodeKind::Interior { right, .. }) if depth < self.levels => {
                let left = self.add(tree, index + 1, Some(number), depth + 1);
                let right = self.add(tree, right as usize, Some(number), depth + 1);
                0.5 * (self.nodes[left].place + self.nodes[right].place)
            }
            _ => {
                self.places += 1;
                (self.places - 1) as f64
            }
        };
        number
    }
}

/// References of all leaves under a node.
fn references(tree: &KdTreeView<'_>, index: usize) -> usize {
    let mut sum = 0;
    let mut stack = vec![index];
    while let Some(index) = stack.pop() {
        match tree.nodes.get(index).map(splitplane_core::tree::node::KdNode::kind) {
            Some(NodeKind::Interior { right, .. }) => stack.extend([right as usize, index + 1]),
            Some(NodeKind::Leaf { count, .. }) => sum += count as usize,
            None => {}
        }
    }
    sum
}

//! Finished subtrees, and the canonical arrays they become.

use splitplane_core::backend::BuildError;
use splitplane_core::node::{Axis, KdNode, NodeKind};

use crate::lookout::Lookout;
use crate::query::WalkNode;

/// A finished subtree.
#[derive(Debug)]
pub(super) enum Built {
    /// One that a single thread built.
    Whole(Subtree),
    /// A node with two children.
    Split(Box<Parts>),
}

/// Nodes and references of a subtree; indices count from its start.
#[derive(Debug)]
pub(super) struct Subtree {
    pub nodes: Vec<KdNode>,
    pub references: Vec<u32>,
}

/// A node with two children.
#[derive(Debug)]
pub(super) struct Parts {
    axis: Axis,
    position: f32,
    left: Built,
    right: Built,
    nodes: u64,
    references: u64,
}

impl Built {
    /// A node with two children.
    pub fn split(axis: Axis, position: f32, left: Built, right: Built) -> Built {
        let nodes = 1 + left.nodes() + right.nodes();
        let references = left.references() + right.references();
        Built::Split(Box::new(Parts { axis, position, left, right, nodes, references }))
    }

    /// One leaf.
    pub fn leaf(references: Vec<u32>) -> Built {
        let nodes = vec![KdNode::leaf(0, references.len() as u32)];
        Built::Whole(Subtree { nodes, references })
    }

    /// How many nodes it has.
    pub fn nodes(&self) -> u64 {
        match self {
            Built::Whole(subtree) => subtree.nodes.len() as u64,
            Built::Split(parts) => parts.nodes,
        }
    }

    /// How many references its leaves have.
    pub fn references(&self) -> u64 {
        match self {
            Built::Whole(subtree) => subtree.references.len() as u64,
            Built::Split(parts) => parts.references,
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        match self {
            // The node of a leaf is not counted anywhere.
            Built::Whole(subtree) if subtree.nodes.len() == 1 => {
                (subtree.references.capacity() * size_of::<u32>()) as u64
            }
            Built::Whole(subtree) => {
                let nodes = subtree.nodes.capacity() * size_of::<KdNode>();
                (nodes + subtree.references.capacity() * size_of::<u32>()) as u64
            }
            Built::Split(parts) => parts.left.bytes() + parts.right.bytes(),
        }
    }

    /// Appends the references of all leaves.
    pub fn collect(&self, out: &mut Vec<u32>) {
        match self {
            Built::Whole(subtree) => out.extend_from_slice(&subtree.references),
            Built::Split(parts) => {
                parts.left.collect(out);
                parts.right.collect(out);
            }
        }
    }

    /// How many nodes and references there are.
    ///
    /// # Errors
    /// More than the format can address.
    pub fn check_size(&self) -> Result<(usize, usize), BuildError> {
        let (nodes, references) = (self.nodes(), self.references());
        if nodes > u64::from(WalkNode::MOST) || references > u64::from(u32::MAX) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        Ok((nodes as usize, references as usize))
    }

    /// Writes the subtree to arrays of its size, as the canonical tree has it.
    pub fn emit(&self, look: &Lookout<'_>, nodes: &mut [KdNode], references: &mut [u32]) {
        self.emit_at(look, nodes, references, 0, 0);
    }

    /// Writes the subtree to arrays of its size, which begin at these indices of the tree.
    fn emit_at(
        &self,
        look: &Lookout<'_>,
        nodes: &mut [KdNode],
        references: &mut [u32],
        first_node: u32,
        first_reference: u32,
    ) {
        if look.is_over() {
            return;
        }
        match self {
            Built::Whole(subtree) => {
                references.copy_from_slice(&subtree.references);
                for (out, node) in nodes.iter_mut().zip(&subtree.nodes) {
                    *out = match node.kind() {
                        NodeKind::Interior { axis, split, right } => {
                            KdNode::interior(axis, split, first_node + right)
                        }
                        NodeKind::Leaf { first, count } => {
                            KdNode::leaf(first_reference + first, count)
                        }
                    };
                }
                look.advance(nodes.len() as u64);
                look.worked((nodes.len() + references.len()) as u64 / 2);
            }
            Built::Split(parts) => {
                look.advance(1);
                let (left_nodes, left_references) = (parts.left.nodes(), parts.left.references());
                let Some((root, nodes)) = nodes.split_first_mut() else { return };
                let right_node = first_node + 1 + left_nodes as u32;
                *root = KdNode::interior(parts.axis, parts.position, right_node);
                let (nodes, far_nodes) = nodes.split_at_mut(left_nodes as usize);
                let (references, far) = references.split_at_mut(left_references as usize);
                let right_reference = first_reference + left_references as u32;
                rayon::join(
                    || parts.left.emit_at(look, nodes, references, first_node + 1, first_reference),
                    || parts.right.emit_at(look, far_nodes, far, right_node, right_reference),
                );
            }
        }
    }
}

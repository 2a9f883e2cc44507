use crate::layout::{Extent, TopNode};
use crate::tree::node::{Axis, KdNode};

/// Where the subtree of a node of the top tree begins that is a small root, and the root's place in the small list; `None` for others.
/// Only where there is no middle stage: else [`super::emit_middle`] says where small roots begin.
pub fn small_address(
    node: usize,
    top_nodes: &[TopNode],
    top_addresses: &[Extent],
) -> Option<(usize, Extent)> {
    let top = &top_nodes[node];
    (top.kind == TopNode::SMALL_ROOT).then(|| (top.left as usize, top_addresses[node]))
}

/// A node of the top tree as stored in the tree, and its place: an interior node or an empty leaf.
/// `None` for small roots, which [`super::emit_small`] writes, or [`super::emit_middle`] first.
pub fn emit_top(
    node: usize,
    top_nodes: &[TopNode],
    top_addresses: &[Extent],
) -> Option<(usize, KdNode)> {
    let (node, address) = (&top_nodes[node], &top_addresses[node]);
    let emitted = match node.kind {
        TopNode::SMALL_ROOT => return None,
        TopNode::EMPTY => KdNode::leaf(address.references, 0),
        axis => {
            let right = top_addresses[node.right as usize].nodes;
            KdNode::interior(Axis::from_index(axis), f32::from_bits(node.split), right)
        }
    };
    Some((address.nodes as usize, emitted))
}

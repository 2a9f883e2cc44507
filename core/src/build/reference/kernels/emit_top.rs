use crate::layout::{Extent, TopNode};
use crate::tree::node::{Axis, KdNode};

/// A node of the top tree as stored in the tree, and its place: an interior node or an empty leaf.
/// `None` for small roots, which [`super::emit_small`] writes.
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

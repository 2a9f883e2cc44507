//! `emit_top`: one invocation a top node.
//!
//! Reads: the top tree and its addresses. Writes: its interior nodes and empty leaves in preorder; the addresses
//! of its small roots, if there is no middle stage.

use splitplane_core::layout::{Extent, TopNode};
use splitplane_core::tree::node::{Axis, KdNode};

/// Where the small roots begin, if there is no middle stage.
pub(crate) fn address_small_roots(top: &[TopNode], addresses: &[Extent], small: &mut [Extent]) {
    for (node, address) in top.iter().zip(addresses) {
        if node.kind == TopNode::SMALL_ROOT {
            small[node.left as usize] = *address;
        }
    }
}

/// Runs the kernel. Serial: there is about one top node for 32 triangles.
pub(crate) fn run(top: &[TopNode], addresses: &[Extent], nodes: &mut [KdNode]) {
    for (node, address) in top.iter().zip(addresses) {
        let out = address.nodes as usize;
        match node.kind {
            TopNode::SMALL_ROOT => {}
            TopNode::EMPTY => nodes[out] = KdNode::leaf(address.references, 0),
            axis => {
                let right = addresses[node.right as usize].nodes;
                let split = f32::from_bits(node.split);
                nodes[out] = KdNode::interior(Axis::from_index(axis), split, right);
            }
        }
    }
}

//! `emit_middle`: one workgroup a middle root.
//!
//! Reads: the trees of the middle roots, the sizes of their leaves, the addresses of the roots. Writes: the nodes of the
//! trees in preorder, and the addresses of the leaves.

use splitplane_core::build::reference::kernels as reference;
use splitplane_core::layout::{Extent, MiddleRoot, TopNode};
use splitplane_core::tree::node::KdNode;

/// Runs the kernel.
pub(crate) fn run(
    middle_roots: &[MiddleRoot],
    middle_nodes: &[TopNode],
    small_sizes: &[Extent],
    top_addresses: &[Extent],
    nodes: &mut [KdNode],
    small_addresses: &mut [Extent],
) {
    for (index, root) in middle_roots.iter().enumerate() {
        reference::emit_middle(
            index,
            middle_roots,
            middle_nodes,
            small_sizes,
            top_addresses,
            nodes,
            &mut small_addresses[root.first_leaf as usize..][..root.leaves as usize],
        );
    }
}

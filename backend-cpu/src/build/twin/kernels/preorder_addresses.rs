//! `preorder_addresses`: one invocation a top node on devices, here from the root on.
//!
//! Reads: the top tree and the sizes of its subtrees. Writes: where each subtree starts in the
//! output: a left subtree just after its parent, a right one after the left one; the number of nodes and references of the tree.

use splitplane_core::kernel::Counter;
use splitplane_core::layout::{Counters, Extent, TopNode};

/// Runs the kernel.
pub(crate) fn run(
    top: &[TopNode],
    sizes: &[Extent],
    addresses: &mut [Extent],
    counters: &mut Counters,
) {
    counters[Counter::Nodes] = sizes[0].nodes;
    counters[Counter::LeafReferences] = sizes[0].references;
    addresses[0] = Extent::default();
    for index in 0..top.len() {
        let node = &top[index];
        if node.kind < TopNode::SMALL_ROOT {
            let here = addresses[index];
            let left_size = sizes[node.left as usize];
            let left = Extent { nodes: here.nodes + 1, references: here.references };
            addresses[node.left as usize] = left;
            addresses[node.right as usize] = Extent {
                nodes: left.nodes + left_size.nodes,
                references: left.references + left_size.references,
            };
        }
    }
}

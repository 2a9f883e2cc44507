//! `subtree_sizes`: one invocation a top node on devices, here from the last node to the first.
//!
//! Reads: the top tree, sizes of the small roots. Writes: nodes and references of every top node's
//! subtree. Children have higher numbers than their parents.

use splitplane_core::layout::{Extent, TopNode};

/// Runs the kernel. Sums wrap; the executor checks the root's against 64-bit sums before.
pub(crate) fn run(top: &[TopNode], small_sizes: &[Extent], sizes: &mut [Extent]) {
    for index in (0..top.len()).rev() {
        let node = &top[index];
        sizes[index] = match node.kind {
            TopNode::EMPTY => Extent { nodes: 1, references: 0 },
            TopNode::SMALL_ROOT => small_sizes[node.left as usize],
            _ => {
                let (left, right) = (sizes[node.left as usize], sizes[node.right as usize]);
                Extent {
                    nodes: 1 + left.nodes + right.nodes,
                    references: left.references + right.references,
                }
            }
        };
    }
}

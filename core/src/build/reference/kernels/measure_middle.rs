use super::range;
use crate::layout::{Extent, MiddleRoot};

/// The nodes and references of a middle root's subtree: those of its leaves, and its own nodes that are none of these.
pub fn measure_middle(root: usize, middle_roots: &[MiddleRoot], small_sizes: &[Extent]) -> Extent {
    let root = &middle_roots[root];
    let mut size = Extent { nodes: root.nodes - root.leaves, references: 0 };
    for leaf in &small_sizes[range(root.first_leaf, root.leaves)] {
        size.nodes += leaf.nodes;
        size.references += leaf.references;
    }
    size
}

use crate::kernel::Counter;
use crate::layout::{Counters, Extent, TopNode};

/// The nodes and references of every subtree of the top tree, from the last node to the first:
/// children come after their parents. Counts those of the tree.
///
/// Sums are of 32 bits. The executor must have made sure that the tree fits its format, as
/// [`super::super::Buffers::make_room`] does.
pub fn subtree_sizes(
    top_nodes: &[TopNode],
    small_sizes: &[Extent],
    top_sizes: &mut [Extent],
    counters: &mut Counters,
) {
    for (index, node) in top_nodes.iter().enumerate().rev() {
        top_sizes[index] = match node.kind {
            TopNode::EMPTY => Extent { nodes: 1, references: 0 },
            TopNode::SMALL_ROOT => small_sizes[node.left as usize],
            _ => {
                let [left, right] = [node.left, node.right].map(|child| top_sizes[child as usize]);
                Extent {
                    nodes: 1 + left.nodes + right.nodes,
                    references: left.references + right.references,
                }
            }
        };
    }
    counters[Counter::Nodes] = top_sizes[0].nodes;
    counters[Counter::LeafReferences] = top_sizes[0].references;
}

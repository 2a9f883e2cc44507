use crate::layout::{Extent, TopNode};

/// The nodes and references of every subtree of the top tree, from the last node to the first:
/// children come after their parents.
///
/// `leaf_sizes` are those of what the levels have handed over: of the middle roots, or of the small roots where there is no middle
/// stage. Sums are of 32 bits. The executor must have made sure that the tree fits its format, as
/// [`super::super::Buffers::make_room`] does.
pub fn subtree_sizes(top_nodes: &[TopNode], leaf_sizes: &[Extent], top_sizes: &mut [Extent]) {
    for (index, node) in top_nodes.iter().enumerate().rev() {
        top_sizes[index] = match node.kind {
            TopNode::EMPTY => Extent { nodes: 1, references: 0 },
            TopNode::SMALL_ROOT => leaf_sizes[node.left as usize],
            _ => {
                let [left, right] = [node.left, node.right].map(|child| top_sizes[child as usize]);
                Extent {
                    nodes: 1 + left.nodes + right.nodes,
                    references: left.references + right.references,
                }
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root above an empty leaf and an interior node with a small root and an empty leaf. What was there before makes no
    /// difference.
    #[test]
    fn sizes_are_those_of_all_below() {
        let node = |kind, left, right| TopNode { kind, split: 0, left, right };
        let top_nodes = [
            node(0, 1, 2),
            node(TopNode::EMPTY, 0, 0),
            node(1, 3, 4),
            node(TopNode::SMALL_ROOT, 1, 0),
            node(TopNode::EMPTY, 0, 0),
        ];
        let small = [Extent { nodes: 99, references: 99 }, Extent { nodes: 5, references: 7 }];
        let mut sizes = [Extent { nodes: 1_000, references: 1_000 }; 5];
        subtree_sizes(&top_nodes, &small, &mut sizes);
        let expected = [(9, 7), (1, 0), (7, 7), (5, 7), (1, 0)];
        assert_eq!(sizes, expected.map(|(nodes, references)| Extent { nodes, references }));
    }
}

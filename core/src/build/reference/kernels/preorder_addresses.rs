use crate::kernel::Counter;
use crate::layout::{Counters, Extent, TopNode};

/// Where every subtree of the top tree begins in the output: the left one just after its parent,
/// the right one after the left one. Counts the nodes and references of the tree.
pub fn preorder_addresses(
    top_nodes: &[TopNode],
    top_sizes: &[Extent],
    top_addresses: &mut [Extent],
    counters: &mut Counters,
) {
    counters[Counter::Nodes] = top_sizes[0].nodes;
    counters[Counter::LeafReferences] = top_sizes[0].references;
    top_addresses[0] = Extent::default();
    for (index, node) in top_nodes.iter().enumerate() {
        if node.kind == TopNode::SMALL_ROOT || node.kind == TopNode::EMPTY {
            continue;
        }
        let here = top_addresses[index];
        let left = Extent { nodes: here.nodes + 1, ..here };
        let size = top_sizes[node.left as usize];
        top_addresses[node.left as usize] = left;
        top_addresses[node.right as usize] = Extent {
            nodes: left.nodes + size.nodes,
            references: left.references + size.references,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::subtree_sizes;
    use super::*;

    /// A root with an empty left child, and two small roots below its right one.
    #[test]
    fn subtrees_stand_one_behind_the_other() {
        let node = |kind, left, right| TopNode { kind, split: 0, left, right };
        let top = [
            node(0, 1, 2),
            node(TopNode::EMPTY, 0, 0),
            node(2, 3, 4),
            node(TopNode::SMALL_ROOT, 1, 0),
            node(TopNode::SMALL_ROOT, 0, 0),
        ];
        let extent = |nodes, references| Extent { nodes, references };
        let small = [extent(3, 20), extent(5, 40)];
        let (mut sizes, mut addresses) = ([extent(0, 0); 5], [extent(9, 9); 5]);
        let mut counters = Counters::default();
        subtree_sizes(&top, &small, &mut sizes);
        assert_eq!(sizes, [(11, 60), (1, 0), (9, 60), (5, 40), (3, 20)].map(|(n, r)| extent(n, r)));
        preorder_addresses(&top, &sizes, &mut addresses, &mut counters);
        assert_eq!((counters[Counter::Nodes], counters[Counter::LeafReferences]), (11, 60));
        let expected = [(0, 0), (1, 0), (2, 0), (3, 0), (8, 40)];
        assert_eq!(addresses, expected.map(|(n, r)| extent(n, r)));
    }
}

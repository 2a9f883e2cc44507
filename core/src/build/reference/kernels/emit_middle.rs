use crate::build::middle::{NO_NODE, Region};
use crate::layout::{Extent, MiddleRoot, TopNode};
use crate::tree::node::{Axis, KdNode};

/// Writes the nodes of a middle root's tree as they are stored, in preorder, and the addresses of its leaves.
///
/// `nodes` are those of the whole tree; only the subtree of the root is written. `small_addresses` are those of the
/// root's leaves.
pub fn emit_middle(
    root: usize,
    middle_roots: &[MiddleRoot],
    middle_nodes: &[TopNode],
    small_sizes: &[Extent],
    top_addresses: &[Extent],
    nodes: &mut [KdNode],
    small_addresses: &mut [Extent],
) {
    let index = root as u32;
    let root = &middle_roots[root];
    let own = &middle_nodes[Region::start(root.first, index).nodes as usize..];
    let mut address = top_addresses[root.node as usize];
    // Interior nodes are written when the address of their right child is known.
    let mut node = 0;
    while node != NO_NODE {
        let here = own[node as usize];
        match here.kind {
            TopNode::EMPTY => {
                nodes[address.nodes as usize] = KdNode::leaf(address.references, 0);
                address.nodes += 1;
                node = here.right;
            }
            TopNode::SMALL_ROOT => {
                let size = small_sizes[(root.first_leaf + here.left) as usize];
                small_addresses[here.left as usize] = address;
                address.nodes += size.nodes;
                address.references += size.references;
                node = here.right;
            }
            axis => {
                let right =
                    address.nodes + 1 + nodes_below(root, own, small_sizes, here.left, here.right);
                nodes[address.nodes as usize] =
                    KdNode::interior(Axis::from_index(axis), f32::from_bits(here.split), right);
                address.nodes += 1;
                node = here.left;
            }
        }
    }
}

/// Nodes from one node of a middle root's tree up to another that follows it in preorder.
fn nodes_below(
    root: &MiddleRoot,
    own: &[TopNode],
    small_sizes: &[Extent],
    from: u32,
    end: u32,
) -> u32 {
    let (mut node, mut sum) = (from, 0);
    while node != end {
        let here = own[node as usize];
        let (nodes, next) = match here.kind {
            TopNode::EMPTY => (1, here.right),
            TopNode::SMALL_ROOT => {
                (small_sizes[(root.first_leaf + here.left) as usize].nodes, here.right)
            }
            _ => (1, here.left),
        };
        (node, sum) = (next, sum + nodes);
    }
    sum
}

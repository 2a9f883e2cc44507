use super::range;
use super::small_subtree::{SmallNode, SmallSubtree};
use crate::arithmetic::Arithmetic;
use crate::config::{BuildConfig, MAX_DEPTH};
use crate::layout::{Extent, Reference, SmallRoot};
use crate::node::{Axis, KdNode};

/// Writes the subtree of a small root: nodes in preorder, and the triangles of its leaves in the order
/// in which the leaves stand, each leaf's in the order of the root's references.
///
/// `nodes` and `leaf_references` are the subtree's own parts of the output: they begin at the address of
/// its top node and are as long as [`super::build_small`] says.
pub fn emit_small<A: Arithmetic>(
    config: &BuildConfig,
    root: usize,
    small_roots: &[SmallRoot],
    small_references: &[Reference],
    top_addresses: &[Extent],
    nodes: &mut [KdNode],
    leaf_references: &mut [u32],
) {
    let root = &small_roots[root];
    let address = top_addresses[root.node as usize];
    let references = &small_references[range(root.first, root.count)];
    if root.count > config.small_node_limit {
        nodes[0] = KdNode::leaf(address.references, root.count);
        for (out, reference) in leaf_references.iter_mut().zip(references) {
            *out = reference.triangle;
        }
        return;
    }
    // Interior nodes whose right child is still to come. It follows the last leaf on the left.
    let mut parents = [(0, Axis::X, 0.0); MAX_DEPTH as usize];
    let (mut waiting, mut written) = (0, 0);
    for (index, node) in SmallSubtree::<A>::new(config, root, small_references).enumerate() {
        match node {
            SmallNode::Interior(plane) => {
                let axis = Axis::from_index(plane.axis as u32);
                parents[waiting] = (index, axis, plane.position);
                waiting += 1;
            }
            SmallNode::Leaf(triangles) => {
                let first = address.references + written as u32;
                nodes[index] = KdNode::leaf(first, triangles.count());
                for triangle in triangles.iter() {
                    leaf_references[written] = references[triangle as usize].triangle;
                    written += 1;
                }
                if waiting > 0 {
                    waiting -= 1;
                    let (parent, axis, position) = parents[waiting];
                    let right = address.nodes + index as u32 + 1;
                    nodes[parent] = KdNode::interior(axis, position, right);
                }
            }
        }
    }
}

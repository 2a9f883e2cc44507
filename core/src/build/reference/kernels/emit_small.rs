use super::range;
use super::small_subtree::{SmallNode, SmallSubtree};
use crate::arithmetic::Arithmetic;
use crate::config::{BuildConfig, MAX_DEPTH};
use crate::layout::{Extent, Reference, SmallRoot};
use crate::tree::node::{Axis, KdNode};

/// Writes the subtree of a small root: nodes in preorder, and the triangles of its leaves in the
/// order of the leaves, each leaf's in the order of the root's references.
///
/// `nodes` and `leaf_references` are the subtree's own parts of the output: they begin at its address and are as long as [`super::build_small`] says.
pub fn emit_small<A: Arithmetic>(
    config: &BuildConfig,
    root: usize,
    small_roots: &[SmallRoot],
    small_references: &[Reference],
    small_addresses: &[Extent],
    nodes: &mut [KdNode],
    leaf_references: &mut [u32],
) {
    let address = small_addresses[root];
    let root = &small_roots[root];
    let references = &small_references[range(root.first, root.count)];
    if root.count > config.small_node_limit() {
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

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::super::build_small;
    use super::*;
    use crate::aabb::Aabb;
    use crate::arithmetic::Strict;
    use crate::tree::node::NodeKind;

    /// `count` boxes of length 1 on the x axis, at 2, 4, 6 ..., after one reference of another
    /// root.
    fn row(count: usize) -> (SmallRoot, [Reference; 64]) {
        let cell = Aabb { lo: [0.0; 3], hi: [2.0 * count as f32 + 2.0, 1.0, 1.0] };
        let references = core::array::from_fn(|i| {
            let x = 2.0 * i as f32;
            let bounds = Aabb { lo: [x, 0.0, 0.0], hi: [x + 1.0, 1.0, 1.0] };
            Reference::new(&bounds, 1000 + i as u32)
        });
        let (lo, hi) = (cell.lo, cell.hi);
        (SmallRoot { lo, hi, first: 1, count: count as u32, ..SmallRoot::zeroed() }, references)
    }

    /// What the subtree says, checked by its format: right children, leaves in order, no reference lost.
    fn emitted(config: &BuildConfig, count: usize) -> ([u32; 64], usize, usize) {
        let (root, references) = row(count);
        let size = build_small::<Strict>(config, 0, &[root], &references);
        let (mut nodes, mut leaves) = ([KdNode::leaf(0, 0); 512], [0; 64]);
        let own = &mut nodes[..size.nodes as usize];
        let out = &mut leaves[..size.references as usize];
        let address = Extent { nodes: 70, references: 500 };
        emit_small::<Strict>(config, 0, &[root], &references, &[address], own, out);
        fn end(nodes: &[KdNode], index: usize, next: &mut u32, depth: &mut [usize; 2]) -> usize {
            depth[0] += 1;
            depth[1] = depth[1].max(depth[0]);
            let end = match nodes[index].kind() {
                NodeKind::Leaf { first, count } => {
                    assert_eq!(first, *next);
                    *next += count;
                    index + 1
                }
                NodeKind::Interior { right, .. } => {
                    let left_end = end(nodes, index + 1, next, depth);
                    assert_eq!(right as usize, left_end + 70);
                    end(nodes, left_end, next, depth)
                }
            };
            depth[0] -= 1;
            end
        }
        let (mut next, mut depth) = (500, [0; 2]);
        assert_eq!(end(own, 0, &mut next, &mut depth), own.len());
        assert_eq!(next, 500 + size.references);
        (leaves, size.nodes as usize, depth[1] - 1)
    }

    #[test]
    fn a_row_of_boxes_comes_apart() {
        let fine = BuildConfig { block_width: 1, ..BuildConfig::default() };
        for count in [1, 2, 3, 17, 60] {
            let (leaves, nodes, _) = emitted(&fine, count);
            assert!((0..count).all(|i| leaves[i] == 1001 + i as u32), "{count}");
            assert!(nodes >= 2 * count - 1, "each box has a leaf, {count}: {nodes}");
        }
        // The depth that is left.
        let shallow = BuildConfig { max_depth: 2, ..fine };
        assert_eq!(emitted(&shallow, 60).2, 2);
    }

    #[test]
    fn more_than_t_are_one_leaf() {
        let config = BuildConfig { block_width: 1, ..BuildConfig::default() }
            .with_stages(|stages| stages.small_node_limit = 9);
        assert!(emitted(&config, 9).1 > 1);
        let (leaves, nodes, _) = emitted(&config, 10);
        assert_eq!(
            (nodes, &leaves[..10]),
            (1, &core::array::from_fn::<u32, 10, _>(|i| 1001 + i as u32)[..])
        );
    }
}

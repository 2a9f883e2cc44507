use super::small_subtree::{SmallNode, SmallSubtree};
use crate::arithmetic::Arithmetic;
use crate::config::BuildConfig;
use crate::layout::{Extent, Reference, SmallRoot};

/// The nodes and references of a small root's subtree: see [`SmallSubtree`]. A root of more than T
/// references, which no plane separates or a cap stopped, is one leaf.
///
/// A twin may keep the subtree for `emit_small`, in `Subtrees`. This one builds it again.
pub fn build_small<A: Arithmetic>(
    config: &BuildConfig,
    root: usize,
    small_roots: &[SmallRoot],
    small_references: &[Reference],
) -> Extent {
    let root = &small_roots[root];
    if root.count > config.small_node_limit() {
        return Extent { nodes: 1, references: root.count };
    }
    let mut size = Extent::default();
    for node in SmallSubtree::<A>::new(config, root, small_references) {
        size.nodes += 1;
        if let SmallNode::Leaf(triangles) = node {
            size.references += triangles.count();
        }
    }
    size
}

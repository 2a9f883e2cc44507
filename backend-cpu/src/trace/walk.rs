//! The walk over the tree's own nodes in the layout, leaf by leaf: for the rays that the vector
//! code does not handle, exact ones among them.

use core::ops::ControlFlow;

use splitplane_core::query::walk;
use splitplane_core::query::walk::{Leaf, WalkRay};

use crate::layout::walk_node::WalkNode;

/// Hands the leaves that a ray passes within an interval to `visit`, near ones first. It returns
/// the `t` beyond which no more leaves are of interest; without one the walk ends.
#[inline]
pub(crate) fn walk<R: WalkRay>(
    nodes: &[WalkNode],
    ray: &R,
    interval: (R::T, R::T),
    mut visit: impl FnMut(&WalkNode) -> Option<R::T>,
) {
    let mut leaf = |leaf: Leaf<R::T>| match visit(&WalkNode::leaf(leaf.first, leaf.count)) {
        Some(stop) => ControlFlow::Continue(stop),
        None => ControlFlow::Break(()),
    };
    walk::walk(WalkNode::as_tree(nodes), ray, interval, &mut leaf);
}

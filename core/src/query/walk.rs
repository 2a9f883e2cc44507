//! The walk of a ray down a tree: from leaf to leaf, near ones first, without recursion or allocation.
//!
//! This is the one loop over the nodes of a tree that follows a ray (Havran 2000). The reference
//! traversal ([`crate::query::traverse`]), the exact one ([`crate::exact`]), the one of a certain device
//! ([`crate::query::certify`]) and users' own queries
//! ([`KdTreeView::visit_along`](crate::tree::KdTreeView::visit_along)) are visitors of it. They
//! differ in how distances are computed, which is a [`WalkRay`], and in what is done at a leaf,
//! which is a [`Visitor`]. Both are static: a walk is compiled for each pair.

use core::ops::ControlFlow;

use crate::config::MAX_DEPTH;
use crate::tree::node::{KdNode, NodeKind};

/// A ray among the planes of a tree.
pub trait WalkRay {
    /// What distances along the ray are: `f32` or `f64`.
    type T: Copy + Default + PartialOrd;

    /// Whether the ray comes to the upper side of a plane across this axis first.
    fn is_backwards(&self, axis: usize) -> bool;

    /// The least and greatest `t` at which the ray may be at a plane. They enclose the exact one,
    /// with as much slack as the triangle tests need.
    ///
    /// For a plane that the ray never reaches, both lie beyond the whole walk: above it where the ray stays on the
    /// near side, below it where it stays on the far side. For a plane that the ray lies in, the interval holds the
    /// whole walk. The near side is the lower one, unless the ray is backwards.
    fn plane_interval(&self, axis: usize, position: f32) -> (Self::T, Self::T);
}

/// A leaf that the ray may pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leaf<T> {
    /// Its place among the nodes.
    pub node: u32,
    /// Its first reference.
    pub first: u32,
    /// How many references it has; 0 for empty space.
    pub count: u32,
    /// Where the ray enters the leaf's cell, or a little before.
    pub enter: T,
    /// Where the ray leaves it, or a little after; not less than `enter`.
    pub exit: T,
}

/// The purpose of a walk.
pub trait Visitor<T> {
    /// The walk has come to a node, interior or leaf.
    #[inline(always)]
    fn node(&mut self) {}

    /// The walk has come to a leaf. Returns the `t` beyond which no more leaves are of interest, or
    /// ends the walk.
    fn leaf(&mut self, leaf: Leaf<T>) -> ControlFlow<(), T>;
}

impl<T, F: FnMut(Leaf<T>) -> ControlFlow<(), T>> Visitor<T> for F {
    #[inline(always)]
    fn leaf(&mut self, leaf: Leaf<T>) -> ControlFlow<(), T> {
        self(leaf)
    }
}

/// Hands the leaves that a ray may pass within an interval to a visitor, near ones first. Both children of a
/// node are visited where the ray may be at their plane within the interval.
///
/// Leaves that begin at the `t` that the visitor returned last are still visited, since they may
/// hold ties with the best hit; those beyond are not.
///
/// The nodes must be those of a valid tree (see [`crate::tree::validate`]); the contents of their leaves
/// make no difference.
///
/// # Panics
/// Where nodes name children that do not exist, or are deeper than [`MAX_DEPTH`]. Nodes that name themselves or
/// those before them may keep it going for ever.
#[inline(always)]
pub fn walk<R: WalkRay, V: Visitor<R::T>>(
    nodes: &[KdNode],
    ray: &R,
    (mut enter, mut exit): (R::T, R::T),
    visitor: &mut V,
) {
    // Each waiting node leaves the path to the current node at a level of its own.
    let mut stack = [(0u32, R::T::default(), R::T::default()); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        visitor.node();
        match nodes[node as usize].kind() {
            NodeKind::Interior { axis, split, right } => {
                let (least, greatest) = ray.plane_interval(axis.index(), split);
                let backwards = ray.is_backwards(axis.index());
                let (near, far) = if backwards { (right, node + 1) } else { (node + 1, right) };
                if greatest < enter {
                    node = far;
                } else if least > exit {
                    node = near;
                } else {
                    stack[top] = (far, if least > enter { least } else { enter }, exit);
                    top += 1;
                    node = near;
                    if greatest < exit {
                        exit = greatest;
                    }
                }
                continue;
            }
            NodeKind::Leaf { first, count } => {
                let leaf = Leaf { node, first, count, enter, exit };
                let ControlFlow::Continue(stop) = visitor.leaf(leaf) else { return };
                loop {
                    if top == 0 {
                        return;
                    }
                    top -= 1;
                    (node, enter, exit) = stack[top];
                    if enter <= stop {
                        break;
                    }
                }
            }
        }
    }
}

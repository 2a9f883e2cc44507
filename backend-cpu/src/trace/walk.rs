//! The reference loop over the tree's own nodes, leaf by leaf: for the rays that vectors are not made for,
//! exact ones among them. The loops of [`splitplane_core::traverse`] and [`splitplane_core::exact`] are the same
//! on purpose: answers are held to theirs, and a loop in common would bring its mistakes to both sides.

use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::exact::Walker;
use splitplane_core::intersect::PreparedRay;

use crate::layout::walk_node::WalkNode;

/// A ray among planes, in `f32` or `f64`.
pub(crate) trait Walk {
    /// What distances are.
    type T: Copy + PartialOrd;

    /// Whether the direction is negative on an axis.
    fn is_backwards(&self, axis: usize) -> bool;

    /// The least and greatest `t` at which the ray may be at a plane.
    fn plane_interval(&self, axis: usize, position: f32) -> (Self::T, Self::T);
}

impl Walk for PreparedRay {
    type T = f32;

    fn is_backwards(&self, axis: usize) -> bool {
        self.direction[axis] < 0.0
    }

    fn plane_interval(&self, axis: usize, position: f32) -> (f32, f32) {
        PreparedRay::plane_interval::<Strict>(self, axis, position)
    }
}

impl Walk for Walker {
    type T = f64;

    fn is_backwards(&self, axis: usize) -> bool {
        Walker::is_backwards(self, axis)
    }

    fn plane_interval(&self, axis: usize, position: f32) -> (f64, f64) {
        Walker::plane_interval(self, axis, position)
    }
}

/// Hands the leaves that a ray passes within an interval to `visit`, near ones first. It gives the `t` beyond
/// which no more leaves are of interest; without one the walk ends.
pub(crate) fn walk<W: Walk>(
    nodes: &[WalkNode],
    ray: &W,
    (mut enter, mut exit): (W::T, W::T),
    mut visit: impl FnMut(&WalkNode) -> Option<W::T>,
) {
    let mut stack = [(0u32, enter, exit); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        let at = *nodes[node as usize].node();
        let axis = at.axis_index() as usize;
        if axis < 3 {
            let (least, greatest) = ray.plane_interval(axis, at.split());
            let (left, right) = (node + 1, at.right());
            let (near, far) = if ray.is_backwards(axis) { (right, left) } else { (left, right) };
            if greatest < enter {
                node = far;
            } else if least > exit {
                node = near;
            } else {
                stack[top] = (far, if least > enter { least } else { enter }, exit);
                top += 1;
                (node, exit) = (near, if greatest < exit { greatest } else { exit });
            }
            continue;
        }
        let Some(stop) = visit(&nodes[node as usize]) else { return };
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

//! The walk of a ray down compressed nodes: the serial reference of the kernels `closest_hit_compressed` and
//! `any_hit_compressed`.

use super::{BOX_ENTRIES, BOX_SLACK, CHILDREN, CompressedChild, CompressedNode, CompressedNodes};
use crate::arithmetic::Arithmetic;
use crate::query::intersect::{PreparedRay, SceneScale};
use crate::query::traverse::{Best, Observer, Query, Triangles};
use crate::ray::{Hit, QueryOptions, Ray};
use core::ops::ControlFlow;

/// What is yet to be visited, and where the ray enters it.
type Entry = (u32, f32);

impl CompressedNodes {
    /// Traces one ray under accuracy `watertight`: the hit of [`trace`](crate::query::traverse::trace), bit for bit.
    /// `None` where the kernel leaves the ray to the tree itself: it is of a wide scene, starts far off, or needs more
    /// than [`BOX_ENTRIES`] entries of a stack.
    ///
    /// The observer is told each compressed node, not the leaves.
    pub fn trace<A: Arithmetic, O: Observer>(
        &self,
        triangles: &(impl Triangles + ?Sized),
        scale: &SceneScale,
        ray: &Ray,
        options: &QueryOptions<'_>,
        query: Query,
        observer: &mut O,
    ) -> Option<Hit> {
        let Some(ray) = PreparedRay::new::<A>(ray, scale) else { return Some(Hit::MISS) };
        if ray.wide || ray.offset != 0.0 {
            return None;
        }
        let Some(whole) = ray.enter::<A>(&scale.bounds) else { return Some(Hit::MISS) };
        let mut best = Best { hit: Hit::MISS, stop: f32::INFINITY };
        let mut stack = [(0, 0.0); BOX_ENTRIES as usize];
        let mut top = 0;
        let mut entry = 0;
        loop {
            match CompressedChild::of_entry(entry) {
                CompressedChild::Node(node) => {
                    observer.node();
                    let node = &self.nodes[node as usize];
                    let near = Near { bottom: top, ray: &ray, whole, stop: best.stop };
                    top = near.children_of::<A>(node, &mut stack, top)?;
                }
                CompressedChild::Leaf { first, count } => {
                    let tested = &self.references[first as usize..(first + count) as usize];
                    if let ControlFlow::Break(()) =
                        best.test::<A, O>(&ray, triangles, tested, options, query, observer)
                    {
                        return Some(best.hit);
                    }
                }
            }
            loop {
                if top == 0 {
                    return Some(best.hit);
                }
                top -= 1;
                if stack[top].1 <= best.stop {
                    break;
                }
            }
            entry = stack[top].0;
        }
    }
}

/// A ray that has come to a node.
struct Near<'a> {
    /// The stack's entries below belong to other nodes.
    bottom: usize,
    ray: &'a PreparedRay,
    whole: (f32, f32),
    stop: f32,
}

impl Near<'_> {
    /// Puts the children that the ray may pass on the stack, the nearest on top. `None` where there is no room.
    fn children_of<A: Arithmetic>(
        &self,
        node: &CompressedNode,
        stack: &mut [Entry],
        mut top: usize,
    ) -> Option<usize> {
        for (child, what) in node.children().enumerate().take(CHILDREN) {
            let (enter, leave) = self.interval::<A>(node, child);
            let (from, to) = self.whole;
            if enter > leave || enter > to || enter > self.stop || leave < from {
                continue;
            }
            if top >= stack.len() {
                return None;
            }
            let mut place = top;
            while place > self.bottom && stack[place - 1].1 < enter {
                stack[place] = stack[place - 1];
                place -= 1;
            }
            stack[place] = (what.entry(), enter);
            top += 1;
        }
        Some(top)
    }

    /// Where the ray may be within a child's box: none unless the first is at most the second.
    fn interval<A: Arithmetic>(&self, node: &CompressedNode, child: usize) -> (f32, f32) {
        let (mut enter, mut leave) = (f32::MIN, f32::MAX);
        for axis in 0..3 {
            let reciprocal = self.ray.reciprocal[axis];
            let step = A::free_mul(node.quantum(axis), reciprocal);
            let away = A::free_sub(node.origin[axis], self.ray.origin[axis]);
            let start = A::free_mul(away, reciprocal);
            let backwards = reciprocal < 0.0;
            let [near, far] = [backwards, !backwards]
                .map(|upper| A::free_mul_add(node.side(child, axis, upper) as f32, step, start));
            (enter, leave) = (enter.max(near), leave.min(far));
        }
        let before = A::free_mul_add(enter.abs(), -BOX_SLACK, enter);
        (before, A::free_mul_add(leave.abs(), BOX_SLACK, leave))
    }
}

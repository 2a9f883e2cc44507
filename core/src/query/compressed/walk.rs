//! The walk of a ray down compressed nodes: the serial reference of the kernels `closest_hit_compressed` and
//! `any_hit_compressed`.

use super::{BOX_ENTRIES, BOX_FACTOR, CHILDREN, CompressedChild, CompressedNode, CompressedNodes};
use crate::arithmetic::Arithmetic;
use crate::query::intersect::{PreparedRay, SceneScale};
use crate::query::traverse::{Best, Observer, Query, Triangles};
use crate::ray::{Hit, QueryOptions, Ray};
use core::ops::ControlFlow;

/// Where a ray enters a child's box, a float that is not negative, with the child's place in its last three bits: whole
/// numbers in the order of the floats. [`NO_CHILD`] for a child that the ray passes by.
type Key = u32;
const NO_CHILD: u32 = u32::MAX;
/// The bits of a key that hold the child's place.
const CHILD_PLACE: u32 = 7;

/// What is yet to be visited: a child, and its node.
type Entry = (Key, u32);

/// What is compared and exchanged to put eight keys in order (Batcher's odd-even merge sort).
const SORTING: [(usize, usize); 19] = [
    (0, 1),
    (2, 3),
    (4, 5),
    (6, 7),
    (0, 2),
    (1, 3),
    (4, 6),
    (5, 7),
    (1, 2),
    (5, 6),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
    (2, 4),
    (3, 5),
    (1, 2),
    (3, 4),
    (5, 6),
];

impl CompressedNodes {
    /// Traces one ray under accuracy `watertight`: the hit of [`trace`](crate::query::traverse::trace), bit for bit.
    /// `None` where the kernel leaves the ray to the tree itself: it is of a wide scene, starts far off, reaches behind its
    /// origin, or needs more than [`BOX_ENTRIES`] entries of a stack.
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
        if ray.wide || ray.offset != 0.0 || ray.limits[0] < 0.0 {
            return None;
        }
        let Some((from, to)) = ray.enter::<A>(&scale.bounds) else { return Some(Hit::MISS) };
        let mut best = Best { hit: Hit::MISS, stop: f32::INFINITY };
        let mut stack: [Entry; BOX_ENTRIES as usize] = [(NO_CHILD, 0); BOX_ENTRIES as usize];
        let mut top = 0;
        let mut next = CompressedChild::Node(0);
        // What is entered beyond is of no interest.
        let mut limit = to;
        loop {
            match next {
                CompressedChild::Node(index) => {
                    observer.node();
                    let node = &self.nodes[index as usize];
                    let keys = sorted(node.keys::<A>(&ray, from, limit));
                    for &key in keys.iter().rev().filter(|&&key| key != NO_CHILD) {
                        *stack.get_mut(top)? = (key, index);
                        top += 1;
                    }
                }
                CompressedChild::Leaf { first, count } => {
                    let tested = &self.references[first as usize..(first + count) as usize];
                    if let ControlFlow::Break(()) =
                        best.test::<A, O>(&ray, triangles, tested, options, query, observer)
                    {
                        return Some(best.hit);
                    }
                    limit = to.min(best.stop);
                }
            }
            let reached = A::free_mul(limit, BOX_FACTOR);
            let entry = stack[..top]
                .iter()
                .rposition(|&(key, _)| f32::from_bits(key & !CHILD_PLACE) <= reached);
            let Some(entry) = entry else { return Some(best.hit) };
            top = entry;
            let (key, index) = stack[entry];
            next = self.nodes[index as usize].child((key & CHILD_PLACE) as usize);
        }
    }
}

/// Keys in ascending order.
fn sorted(mut keys: [Key; CHILDREN]) -> [Key; CHILDREN] {
    for (one, other) in SORTING {
        (keys[one], keys[other]) = (keys[one].min(keys[other]), keys[one].max(keys[other]));
    }
    keys
}

impl CompressedNode {
    /// The keys of the children that a ray may meet from one distance to another.
    fn keys<A: Arithmetic>(&self, ray: &PreparedRay, from: f32, to: f32) -> [Key; CHILDREN] {
        let mut step = [0.0; 3];
        let mut start = [0.0; 3];
        for axis in 0..3 {
            let reciprocal = ray.reciprocal[axis];
            step[axis] = A::free_mul(self.units(axis), reciprocal);
            let away = A::free_sub(self.origin[axis], ray.origin[axis]);
            start[axis] = A::free_sub(A::free_mul(away, reciprocal), step[axis]);
        }
        core::array::from_fn(|child| {
            let (mut enter, mut leave) = (from, to);
            for axis in 0..3 {
                let backwards = ray.reciprocal[axis] < 0.0;
                let [near, far] = [backwards, !backwards].map(|upper| {
                    A::free_mul_add(self.side(child, axis, upper), step[axis], start[axis])
                });
                (enter, leave) = (enter.max(near), leave.min(far));
            }
            let meets = enter <= A::free_mul(leave, BOX_FACTOR);
            if meets { enter.to_bits() & !CHILD_PLACE | child as u32 } else { NO_CHILD }
        })
    }
}

//! Traversal of the tree over instances, which can be interrupted after each.

use alloc::vec::Vec;

use super::top_build::LEVELS;
use super::top_tree::{INSTANCE, NONE, TopNode, TopTree, WIDTH};
use crate::arithmetic::snap;
use crate::query::intersect::STOP_SLACK;
use crate::ray::Ray;

/// Entries of a stack that serves every tree.
pub const WIDEST_STACK: usize = (WIDTH - 1) * LEVELS + 1;

/// A ray, ready for the tree over instances.
///
/// It enters a child's box at the greatest, over the axes, of the lesser of `((lo - reach distance) - origin) reciprocal` and
/// `((hi + reach distance) - origin) reciprocal`, and of `t_min`; it leaves it at the least of the greater ones, and of
/// [`TopRay::stop_after`] of its upper limit. It meets the box where it enters it no later than it leaves it. Each operation rounds by itself.
#[derive(Clone, Copy, Debug)]
pub struct TopRay {
    /// Where it begins.
    pub origin: [f32; 3],
    /// Reciprocals of the direction, none of which is infinite.
    pub reciprocal: [f32; 3],
    /// Greatest component of the origin.
    pub distance: f32,
    /// Lower limit, a little wide.
    pub t_min: f32,
    /// False for a ray that enters everything.
    pub tame: bool,
}

impl TopRay {
    /// Components of a direction are taken to be at least this part of the greatest: 2^-80.
    pub const DIRECTION_LEAST: f32 = 8.271_806e-25;
    /// Rays whose direction is longer, or shorter than the reciprocal, enter every instance: 2^40.
    pub const DIRECTION_MOST: f32 = 1.099_511_6e12;
    /// Rays from farther away enter every instance: 2^60.
    pub const ORIGIN_MOST: f32 = 1.152_921_5e18;

    /// A ray that can be traced; `None` for one that hits nothing: an origin or a direction that is not finite, a zero
    /// direction, no `t` between the limits.
    #[inline]
    pub fn new(ray: &Ray) -> Option<TopRay> {
        // Loops, since closures over arrays are not compiled into who calls this.
        let (mut finite, mut distance, mut length) = (true, 0.0f32, 0.0f32);
        for axis in 0..3 {
            let (from, along) = (ray.origin[axis].abs(), ray.direction[axis].abs());
            finite &= (from <= f32::MAX) & (along <= f32::MAX);
            let along = snap(along);
            distance = if from > distance { from } else { distance };
            length = if along > length { along } else { length };
        }
        let some_t = ray.t_min <= ray.t_max;
        if !(finite & some_t) || length == 0.0 {
            return None;
        }
        let tame = (1.0 / Self::DIRECTION_MOST..=Self::DIRECTION_MOST).contains(&length)
            && distance <= Self::ORIGIN_MOST;
        let least = length * Self::DIRECTION_LEAST;
        let mut reciprocal = [0.0; 3];
        for (to, &along) in reciprocal.iter_mut().zip(&ray.direction) {
            *to = 1.0 / if along.abs() < least { least } else { along };
        }
        let t_min = TopRay::start_before(ray.t_min);
        Some(TopRay { origin: ray.origin, reciprocal, distance, t_min, tame })
    }

    /// Before this no box can have a hit at `t_min` or later.
    #[inline]
    pub fn start_before(t_min: f32) -> f32 {
        (t_min - t_min.abs() * STOP_SLACK) - f32::MIN_POSITIVE
    }

    /// Beyond this no box can have a hit at `t_max` or before: the `t` of a hit may be off by half of `STOP_SLACK`, and one below
    /// the least normal float counts as 0.
    #[inline]
    pub fn stop_after(t_max: f32) -> f32 {
        let t_max = if t_max >= 0.0 { t_max.max(f32::MIN_POSITIVE) } else { t_max };
        t_max + t_max.abs() * STOP_SLACK
    }

    /// Where the ray enters the boxes of a node's children that it meets up to `stop`: `f32::INFINITY` for the others. A
    /// box within another is never entered before the other, nor met without it.
    #[inline]
    fn enter(&self, node: &TopNode, stop: f32) -> [f32; WIDTH] {
        let mut near = [self.t_min; WIDTH];
        let mut far = [stop; WIDTH];
        if !self.tame {
            return node
                .children
                .map(|child| if child == NONE { f32::INFINITY } else { -f32::MAX });
        }
        for axis in 0..3 {
            let (origin, reciprocal) = (self.origin[axis], self.reciprocal[axis]);
            for slot in 0..WIDTH {
                let reach = node.reach[slot] * self.distance;
                let low = ((node.lo[axis][slot] - reach) - origin) * reciprocal;
                let high = ((node.hi[axis][slot] + reach) - origin) * reciprocal;
                let (first, last) = if low < high { (low, high) } else { (high, low) };
                near[slot] = if first > near[slot] { first } else { near[slot] };
                far[slot] = if last < far[slot] { last } else { far[slot] };
            }
        }
        let mut enter = [f32::INFINITY; WIDTH];
        for slot in 0..WIDTH {
            let met = (near[slot] <= far[slot]) & (node.children[slot] != NONE);
            enter[slot] = if met { near[slot].min(f32::MAX) } else { f32::INFINITY };
        }
        enter
    }
}

/// An entry of a ray's stack of what it still has to enter, the next one last.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TopStack {
    /// Where the ray enters the box.
    pub enter: f32,
    /// A node or an instance, as [`TopNode::children`] has them.
    pub child: u32,
}

impl TopStack {
    /// The root, which every ray enters.
    pub const ROOT: TopStack = TopStack { enter: -f32::MAX, child: 0 };
}

/// Rays on their way through the tree over instances.
pub struct TopWalk<'a> {
    /// The tree.
    pub tree: &'a TopTree,
    /// The rays; `None` for those that hit nothing.
    pub rays: &'a [Option<TopRay>],
    /// A stack of [`TopTree::stack`] entries for each ray.
    pub stacks: &'a mut [TopStack],
    /// The number of entries of each.
    pub tops: &'a mut [usize],
    /// Rays that are not done, by their places.
    pub active: &'a mut Vec<u32>,
}

/// Finds the instances that rays enter. What it finds first does not matter, as long as it finds those that a ray enters before its limit.
pub trait TopWalker {
    /// Finds the next instance of each active ray: those that `accept` takes, by the ray's place and the instance's name. Rays that have
    /// no other instance are no longer active. A ray's limit, by its place, is in `t_max`.
    fn advance(
        &mut self,
        walk: TopWalk<'_>,
        t_max: impl Fn(u32) -> f32,
        accept: impl FnMut(u32, u32) -> bool,
    );
}

/// Finds them one ray after the other.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScalarWalker;

impl TopWalker for ScalarWalker {
    fn advance(
        &mut self,
        walk: TopWalk<'_>,
        t_max: impl Fn(u32) -> f32,
        mut accept: impl FnMut(u32, u32) -> bool,
    ) {
        let TopWalk { tree, rays, stacks, tops, active } = walk;
        let room = tree.stack();
        active.retain(|&index| {
            let at = index as usize;
            let Some(ray) = &rays[at] else { return false };
            let (stack, t_max) = (&mut stacks[at * room..][..room], t_max(index));
            while let Some(name) = tree.next(ray, t_max, stack, &mut tops[at]) {
                if accept(index, name) {
                    return true;
                }
            }
            false
        });
    }
}

impl TopTree {
    /// Entries of a stack.
    pub const fn stack(&self) -> usize {
        (WIDTH - 1) * self.depth + 1
    }

    /// Puts the root on a stack of at least [`TopTree::stack`] entries. Returns how many entries there are then.
    #[inline]
    pub fn begin(&self, stack: &mut [TopStack]) -> usize {
        if self.nodes.is_empty() {
            return 0;
        }
        stack[0] = TopStack::ROOT;
        1
    }

    /// The next instance that the ray enters before `t_max`, nearest boxes first; `None` when there is none left. `top` is
    /// the number of entries. Between two calls `t_max` may fall.
    #[inline]
    pub fn next(
        &self,
        ray: &TopRay,
        t_max: f32,
        stack: &mut [TopStack],
        top: &mut usize,
    ) -> Option<u32> {
        let stop = TopRay::stop_after(t_max);
        while *top > 0 {
            *top -= 1;
            let TopStack { enter, child } = stack[*top];
            if enter > stop {
                continue;
            }
            if child & INSTANCE != 0 {
                return Some(child & !INSTANCE);
            }
            let node = &self.nodes[child as usize];
            let entered = ray.enter(node, stop);
            let bottom = *top;
            for slot in 0..WIDTH {
                let t = entered[slot];
                if t == f32::INFINITY {
                    continue;
                }
                // The farthest first; of equals, the first child is the next.
                let mut at = *top;
                while at > bottom && stack[at - 1].enter <= t {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = TopStack { enter: t, child: node.children[slot] };
                *top += 1;
            }
        }
        None
    }
}

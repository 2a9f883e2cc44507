//! The turns of rays in instances: a step at a node, the test of a block, and the way out.

use splitplane_core::backend::scene::{SceneAnswer, limit_within};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{SceneHit, TopRay};

use super::lane::{Lane, Waiting, lanes_of};
use crate::layout::wide_node::DONE;
use crate::simd::{Compiled, Simd};
use crate::trace::keep::KeepAll;
use crate::trace::leaves::Leaves;
use crate::trace::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step_in_turn};

/// A stack from an entry on.
///
/// # Safety
/// The stack must have twice as many words as entries.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn stack(entry: *mut u32, room: usize) -> TraversalStack {
    // SAFETY: the caller's contract.
    TraversalStack { children: entry, t: unsafe { entry.add(room) }.cast() }
}

/// A step of all rays that are at nodes.
pub(super) struct AtNodes<'a, 'b, T, L> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    /// Entries of a stack.
    pub(super) room: usize,
}

impl<T: SceneAnswer, L: Leaves> Compiled for AtNodes<'_, '_, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let AtNodes { lanes, waiting, room } = self;
        let mut left = *waiting;
        for number in lanes_of(core::mem::take(&mut left.node)) {
            // SAFETY: the caller's contract; lanes are below LANES; the child is a node; stacks have the space; the ray is in an instance.
            unsafe {
                let lane = &mut *lanes.add(number);
                let entry = lane.last;
                let top = stack(entry, room);
                let (child, more) = step_in_turn::<S>(&lane.ray_state, lane.lines, lane.child, top);
                (lane.child, lane.last) = (child, entry.add(more).wrapping_sub(1));
                ask_for::<S, L>(lane.lines, lane.leaves.unwrap_unchecked(), child);
                left.put(number, child);
            }
        }
        *waiting = left;
    }
}

/// A test of all rays that are at blocks.
pub(super) struct AtBlocks<'a, 'b, T, L: Leaves> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    /// Entries of a stack.
    pub(super) room: usize,
    pub(super) leaf_room: &'a mut L::Room,
}

impl<T: SceneAnswer, L: Leaves> Compiled for AtBlocks<'_, '_, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let AtBlocks { lanes, waiting, room, leaf_room } = self;
        let mut left = *waiting;
        for number in lanes_of(core::mem::take(&mut left.block)) {
            // SAFETY: the caller's contract; lanes are below LANES; children name leaves; wide rays are not under way; stacks have the space; the ray is in
            // an instance, whose options live as long as the lanes; all are watertight.
            unsafe {
                let lane = &mut *lanes.add(number);
                let leaves = lane.leaves.unwrap_unchecked();
                let options = &*lane.options;
                let test = &TestContext { leaves, options, query: T::QUERY, keep: KeepAll };
                let Lane { ray_state, best, child, last, stack: bottom, .. } = lane;
                let tested = &mut RayTest { test, room: leaf_room, ray_state, best, exact: None };
                if TestLeaf(*child, tested).run::<S>() {
                    if T::QUERY == Query::Any {
                        left.put(number, DONE);
                        continue;
                    }
                    let stop = best.stop.min(ray_state.stop);
                    ray_state.stop = stop;
                    // Of the entries, the lowest stays.
                    let entries = last.offset_from(*bottom) as usize;
                    *last = bottom.add(stack(*bottom, room).cull::<S>(entries, stop));
                }
                *child = **last;
                *last = last.wrapping_sub(1);
                ask_for::<S, L>(lane.lines, leaves, *child);
                left.put(number, *child);
            }
        }
        *waiting = left;
    }
}

/// Takes the rays that wait for it out of their instances, to what they enter next.
pub(super) struct Leave<'a, 'b, T, L> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    pub(super) rays: &'a [Ray],
    /// Entries of a stack of the tree over instances.
    pub(super) room: usize,
}

impl<T: SceneAnswer, L> Compiled for Leave<'_, '_, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Leave { lanes, waiting, rays, room } = self;
        let mut left = *waiting;
        for number in lanes_of(core::mem::take(&mut left.leave)) {
            // SAFETY: the caller's contract; lanes are below LANES; stacks have the space, and entries were written.
            unsafe {
                let lane = &mut *lanes.add(number);
                lane.take::<S>(rays, room);
                left.put_top(number, lane.pop_top());
            }
        }
        *waiting = left;
    }
}

impl<T: SceneAnswer, L> Lane<'_, T, L> {
    /// Takes the hit in the instance that the ray is in, if it is better than its best, and drops what lies behind it.
    ///
    /// # Safety
    /// The processor must have the set; the stack must have space for 16 more entries.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn take<S: Simd>(&mut self, rays: &[Ray], room: usize) {
        let found = SceneHit::of(&self.best.hit, self.geometry, self.instance);
        if !(found.is_hit() && found.precedes(&self.answer.best())) {
            return;
        }
        if self.answer.take(found) {
            self.top_last = self.top_stack;
            return;
        }
        let (ray, best) = (&rays[self.index as usize], self.answer.best());
        let stop = TopRay::stop_after(ray.t_max.min(best.t));
        (self.limit, self.turn_ray.stop) = (limit_within(ray, &best), stop);
        // SAFETY: the caller's contract; the last entry is not before the first, since that is what ends a ray.
        unsafe {
            let entries = self.top_last.offset_from(self.top_stack) as usize;
            let kept = stack(self.top_stack, room).cull::<S>(entries, stop);
            self.top_last = self.top_stack.add(kept);
        }
    }
}

//! The turns of the rays under way in a batch ([`super::stream`]): a step of all that are at nodes, and a test of all that are at
//! blocks.
//!
//! Each kind is a function of its own, called once for many rays. Together with everything else a batch needs more registers
//! than there are: of 123 instructions of a step at a node (AVX2) 23 read back what had been put on the machine's stack.

use splitplane_core::query::traverse::Query;

use super::block_test::BestHit;
use super::leaves::Leaves;
use super::queues::{FLIGHT, Queues, Turn};
use super::ray_state::RayState;
use super::sieve::ExactLane;
use super::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step_in_turn};
use crate::layout::wide_node::{CacheLine, DONE};
use crate::simd::{Compiled, Simd};

/// A ray under way.
pub(super) struct Lane {
    pub ray_state: RayState,
    /// Its current child.
    pub child: u32,
    /// Last entry of its stack.
    pub top: usize,
    pub best: BestHit,
    pub exact: ExactLane,
    /// Its stack of children, and behind as many entries where the ray enters them.
    pub stack: *mut u32,
}

/// The rays under way and what they go through. Pointers without checks of bounds, since every step reads and writes here.
#[derive(Clone, Copy)]
pub(super) struct Lanes<L> {
    /// [`FLIGHT`] rays.
    pub lanes: *mut Lane,
    /// Entries of a stack.
    pub room: usize,
    pub lines: *const CacheLine,
    pub leaves: L,
}

impl<L: Leaves> Lanes<L> {
    /// A ray.
    ///
    /// # Safety
    /// Lanes are below [`FLIGHT`]; only one reference to each at a time.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn lane<'a>(self, lane: usize) -> &'a mut Lane {
        debug_assert!(lane < FLIGHT);
        // SAFETY: the caller's contract.
        unsafe { &mut *self.lanes.add(lane) }
    }

    /// A ray's stack.
    ///
    /// # Safety
    /// The ray must be one of these.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn stack(self, lane: &Lane) -> TraversalStack {
        // SAFETY: a stack has twice as many words as entries.
        let t = unsafe { lane.stack.add(self.room) };
        TraversalStack { children: lane.stack, t: t.cast() }
    }
}

/// A step of all rays that are at nodes.
pub(super) struct AtNodes<L>(pub Lanes<L>, pub Queues);

impl<L: Leaves> Compiled for AtNodes<L> {
    /// What rays wait for then.
    type Output = Queues;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Queues {
        let AtNodes(lanes, mut queues) = self;
        for number in queues.take(Turn::Node) {
            // SAFETY: the caller's contract; lanes are below FLIGHT; the child is a node; stacks have the space.
            unsafe {
                let lane = lanes.lane(number);
                let (node, top, mut stack) = (lane.child, lane.top, lanes.stack(lane));
                let (child, top) =
                    step_in_turn::<S>(&lane.ray_state, lanes.lines, node, &mut stack, top);
                (lane.child, lane.top) = (child, top);
                ask_for::<S, L>(lanes.lines, lanes.leaves, child);
                queues.put(number, child);
            }
        }
        queues
    }
}

/// A test of all rays that are at blocks.
pub(super) struct AtBlocks<'a, L: Leaves> {
    pub lanes: Lanes<L>,
    pub queues: Queues,
    pub test: &'a TestContext<'a, L>,
    pub room: &'a mut L::Room,
    /// Accuracy `exact`.
    pub exactly: bool,
}

impl<L: Leaves> Compiled for AtBlocks<'_, L> {
    /// What rays wait for then.
    type Output = Queues;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Queues {
        let AtBlocks { lanes, mut queues, test, room, exactly } = self;
        for number in queues.take(Turn::Block) {
            // SAFETY: the caller's contract; lanes are below FLIGHT; children name nodes or leaves; wide rays get no lane; stacks
            // have the space; entries that were written.
            unsafe {
                let lane = lanes.lane(number);
                let mut stack = lanes.stack(lane);
                let Lane { ray_state, best, child, exact, top, .. } = lane;
                let (room, exact) = (&mut *room, exactly.then_some(exact));
                let tested = &mut RayTest { test, room, ray_state, best, exact };
                if TestLeaf(*child, tested).run::<S>() {
                    if test.query == Query::Any {
                        queues.put(number, DONE);
                        continue;
                    }
                    let stop = best.stop.min(ray_state.stop);
                    ray_state.stop = stop;
                    *top = stack.cull::<S>(*top, stop);
                }
                *child = *stack.children.add(*top);
                *top = top.wrapping_sub(1);
                ask_for::<S, L>(lanes.lines, lanes.leaves, *child);
                queues.put(number, *child);
            }
        }
        queues
    }
}

//! The turns of the rays under way in a batch ([`super::stream`]): a step of all that are at nodes, and a test of all that are at
//! blocks.
//!
//! Each kind is a function of its own, called once for many rays. Together with everything else a batch needs more registers
//! than there are: of 123 instructions of a step at a node (AVX2) 23 read back what had been put on the machine's stack.

use core::hint::assert_unchecked;

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, QueryOptions, Rays};

use super::block_test::BestHit;
use super::keep::KeepAll;
use super::leaves::Leaves;
use super::queues::{FLIGHT, Queues, Turn};
use super::ray_state::RayState;
use super::sieve::ExactLane;
use super::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step_in_turn};
use super::supply::EXACT_IN_TURN;
use crate::layout::wide_node::{CacheLine, DONE};
use crate::simd::{Compiled, Simd};

/// A ray under way.
pub(super) struct Lane {
    pub ray_state: RayState,
    /// Its current child.
    pub child: u32,
    /// Last entry of its stack, or the place before the first.
    pub top: *mut u32,
    pub best: BestHit,
    /// Its stack of children, and behind as many entries where the ray enters them.
    pub stack: *mut u32,
}

/// The rays under way and what they go through. Pointers without checks of bounds, since every step reads and writes here.
#[derive(Clone, Copy)]
pub(super) struct Lanes<L> {
    /// [`FLIGHT`] rays.
    pub lanes: *mut Lane,
    /// As many, where the accuracy is `exact`: apart, so that rays of other accuracies lie closer together in the cache.
    pub exact: *mut ExactLane,
    /// Entries of a stack.
    pub room: usize,
    pub lines: *const CacheLine,
    pub leaves: L,
}

impl<L: Leaves> Lanes<L> {
    /// What these rays share at blocks, which are read as `leaves` has them: options, query, and the batch where the accuracy is `exact`.
    pub(super) fn blocks<'a, M: Leaves>(
        self,
        leaves: M,
        (options, query, exactly): (&'a QueryOptions<'a>, Query, Option<Rays<'a>>),
    ) -> Blocks<'a, M> {
        let Lanes { lanes, exact, room, lines, .. } = self;
        let lanes = Lanes { lanes, exact, room, lines, leaves };
        let test = TestContext { leaves, options, query, keep: KeepAll };
        Blocks { lanes, test, room: M::room(), exactly }
    }

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

    /// A ray as the exact test takes it.
    ///
    /// # Safety
    /// As for [`Lanes::lane`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn exact<'a>(self, lane: usize) -> &'a mut ExactLane {
        debug_assert!(lane < FLIGHT);
        // SAFETY: the caller's contract.
        unsafe { &mut *self.exact.add(lane) }
    }

    /// A ray's stack from an entry on.
    ///
    /// # Safety
    /// The entry must be of the stack of one of these rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn stack(self, entry: *mut u32) -> TraversalStack {
        // SAFETY: a stack has twice as many words as entries.
        let t = unsafe { entry.add(self.room) };
        TraversalStack { children: entry, t: t.cast() }
    }
}

/// A step of all rays that are at nodes. Two words, so that they are handed over in registers.
pub(super) struct AtNodes<'a, L>(pub &'a Lanes<L>, pub Queues);

impl<L: Leaves> Compiled for AtNodes<'_, L> {
    /// What rays wait for then.
    type Output = Queues;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Queues {
        let AtNodes(&lanes, mut queues) = self;
        for number in queues.take(Turn::Node) {
            // SAFETY: the caller's contract; lanes are below FLIGHT; the child is a node; stacks have the space.
            unsafe {
                let lane = lanes.lane(number);
                // Read once: the compiler cannot know that what goes on the stack does not change it.
                let entry = lane.top;
                let top = lanes.stack(entry);
                let (child, more) =
                    step_in_turn::<S>(&lane.ray_state, lanes.lines, lane.child, top);
                (lane.child, lane.top) = (child, entry.add(more).wrapping_sub(1));
                ask_for::<S, L>(lanes.lines, lanes.leaves, child);
                queues.put(number, child);
            }
        }
        queues
    }
}

/// What rays at blocks share.
pub(super) struct Blocks<'a, L: Leaves> {
    lanes: Lanes<L>,
    test: TestContext<'a, L>,
    room: L::Room,
    /// The batch, where the accuracy is `exact`.
    exactly: Option<Rays<'a>>,
}

impl<L: Leaves> Blocks<'_, L> {
    /// Tests all rays that are at blocks. Returns what rays wait for then.
    ///
    /// # Safety
    /// The processor must have the set; rays at blocks must be at those of the leaves.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn take_turns<S: Simd>(&mut self, queues: Queues) -> Queues {
        // SAFETY: the caller's contract.
        unsafe {
            if self.test.options.accuracy == Accuracy::Watertight {
                S::call(AtBlocks::<L, true>(self, queues))
            } else {
                S::call(AtBlocks::<L, false>(self, queues))
            }
        }
    }
}

/// A test of all rays that are at blocks, of accuracy `watertight` or of any other: tests of the one have no branches and keep nothing
/// for the sake of the others. Two words, as above.
struct AtBlocks<'a, 'b, L: Leaves, const WATERTIGHT: bool>(&'a mut Blocks<'b, L>, Queues);

impl<L: Leaves, const WATERTIGHT: bool> Compiled for AtBlocks<'_, '_, L, WATERTIGHT> {
    /// What rays wait for then.
    type Output = Queues;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Queues {
        let AtBlocks(Blocks { lanes, test, room, exactly }, mut queues) = self;
        let (lanes, test, exactly) = (*lanes, &*test, &*exactly);
        for number in queues.take(Turn::Block) {
            // SAFETY: the caller's contract; lanes are below FLIGHT; children name nodes or leaves; wide rays get no lane; stacks
            // have the space; entries that were written; the accuracy is what it says.
            unsafe {
                let Lane { ray_state, best, child, top, stack } = lanes.lane(number);
                assert_unchecked((test.options.accuracy == Accuracy::Watertight) == WATERTIGHT);
                let exactly = if WATERTIGHT || !EXACT_IN_TURN { None } else { exactly.as_ref() };
                let (room, exact) = (&mut *room, exactly.map(|rays| (lanes.exact(number), rays)));
                let tested = &mut RayTest { test, room, ray_state, best, exact };
                if TestLeaf(*child, tested).run::<S>() {
                    if test.query == Query::Any {
                        queues.put(number, DONE);
                        continue;
                    }
                    let stop = best.stop.min(ray_state.stop);
                    ray_state.stop = stop;
                    // Of the entries, the lowest stays.
                    let entries = top.offset_from(*stack) as usize;
                    *top = stack.add(lanes.stack(*stack).cull::<S>(entries, stop));
                }
                *child = **top;
                *top = top.wrapping_sub(1);
                ask_for::<S, L>(lanes.lines, lanes.leaves, *child);
                queues.put(number, *child);
            }
        }
        queues
    }
}

//! Batches: several rays at a time, which take their steps in turn.
//!
//! A step of a ray is one wide node, whose boxes are tested all at once, or one block of triangles.
//! After it the next place of the ray is known and prefetched, and other rays take their steps
//! until the memory has arrived. Rays at nodes and rays at blocks are processed by turns, each kind
//! as bits of one word, so that no branch has to predict which kind a ray is. When a ray is
//! answered, the next one takes its place. Coherent rays are traced by [`super::packet`] instead.

use core::cell::RefCell;
use std::collections::TryReserveError;

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::Accuracy;

use super::batch::{Answers, RayBatch};
use super::block_test::BestHit;
use super::keep::KeepAll;
use super::leaves::{IndexedLeaves, Leaves, PackedLeaves};
use super::packet::Packet;
use super::prepare::{CHUNK, PreparedRays};
use super::queues::{FLIGHT, Queues, Turn};
use super::ray_state::RayState;
use super::sieve::ExactLane;
use super::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step};
use super::supply::Supply;
use crate::layout::wide_node::DONE;
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};

/// A ray under way.
struct Lane {
    ray_state: RayState,
    /// Its current child.
    child: u32,
    /// Last entry of its stack.
    top: usize,
    best: BestHit,
    exact: ExactLane,
}

/// Memory of the rays under way, kept between batches.
struct Flight {
    lanes: Vec<Lane>,
    children: Vec<u32>,
    t: Vec<f32>,
    ready: PreparedRays,
    ray_states: [RayState; CHUNK],
    packet: Packet,
}

impl Flight {
    /// No rays, and no memory yet.
    fn new() -> Flight {
        let (lanes, children, t) = (Vec::new(), Vec::new(), Vec::new());
        let (ready, ray_states, packet) =
            (PreparedRays::NONE, [RayState::none(); CHUNK], Packet::new());
        Flight { lanes, children, t, ready, ray_states, packet }
    }

    /// Makes lanes, and stacks of `room` entries.
    ///
    /// # Errors
    /// Less memory than that.
    fn make_room(&mut self, room: usize) -> Result<(), TryReserveError> {
        let Flight { lanes, children, t, packet, .. } = self;
        if lanes.is_empty() {
            let (ray_state, best, exact) = (RayState::none(), BestHit::NONE, ExactLane::idle());
            lanes.try_reserve_exact(FLIGHT)?;
            lanes.resize_with(FLIGHT, || Lane { ray_state, child: DONE, top: 0, best, exact });
        }
        lengthen(children, room * FLIGHT, DONE)?;
        lengthen(t, room * FLIGHT, 0.0)?;
        packet.make_room(room)
    }
}

thread_local! {
    static IN_FLIGHT: RefCell<Option<Box<Flight>>> = const { RefCell::new(None) };
}

/// A batch to be answered. The layout must be made for the width of the set.
pub(crate) struct Stream<'a> {
    pub batch: RayBatch<'a>,
    pub answers: Answers<'a>,
}

impl Compiled for Stream<'_> {
    /// An error where there is no memory for the rays under way.
    type Output = Result<(), TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<(), TryReserveError> {
        let Stream { batch, mut answers } = self;
        // Taken out; `None` while the thread is being destroyed.
        let kept = IN_FLIGHT.try_with(RefCell::take).ok().flatten();
        let mut flight = kept.map_or_else(|| boxed(Flight::new), Ok)?;
        flight.make_room(batch.layout.wide.stack())?;
        // SAFETY: the caller's contract; there is space.
        unsafe {
            match IndexedLeaves::of(batch.layout) {
                None => {
                    fly::<S, _>(batch, PackedLeaves::new(batch.layout), &mut flight, &mut answers);
                }
                Some(leaves) => {
                    fly::<S, IndexedLeaves<'_>>(batch, leaves, &mut flight, &mut answers);
                }
            }
        }
        let _ = IN_FLIGHT.try_with(|kept| kept.replace(Some(flight)));
        Ok(())
    }
}

/// # Safety
/// The processor must have the set, for whose width the layout was made; the flight must have space
/// for its stacks.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn fly<S: Simd, L: Leaves>(
    batch: RayBatch<'_>,
    leaves: L,
    flight: &mut Flight,
    answers: &mut Answers<'_>,
) {
    let RayBatch { layout, scene, rays, options, query } = batch;
    let lines = layout.wide.lines();
    let test = &TestContext { leaves, options, query, keep: KeepAll };
    let mut leaf_room = L::room();
    let room = layout.wide.stack();
    let Flight { lanes, children, t, ready, ray_states, packet } = flight;
    let exactly = options.accuracy == Accuracy::Exact;
    let bounds = [scene.bounds, layout.large.others];
    let mut supply = Supply { batch, next: 0, left: 0, ready, ray_states, packet };
    let mut queues = Queues::IDLE;
    for state in lanes.iter_mut() {
        state.ray_state.index = RayState::NO_RAY;
    }
    let lanes = &mut lanes[..FLIGHT];
    let (children, t) = (children.as_mut_ptr(), t.as_mut_ptr());
    macro_rules! stack {
        ($lane:expr) => {
            // SAFETY: lanes are below FLIGHT.
            unsafe {
                TraversalStack { children: children.add($lane * room), t: t.add($lane * room) }
            }
        };
    }
    let lines = lines.as_ptr();
    loop {
        for lane in queues.take(Turn::Refill) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            if state.ray_state.index != RayState::NO_RAY {
                let hit = if exactly { state.exact.hit(query) } else { state.best.hit };
                answers.set(state.ray_state.index as usize, hit);
                state.ray_state.index = RayState::NO_RAY;
            }
            // SAFETY: the caller's contract.
            let Some(ray_state) = (unsafe { supply.next::<S>(answers) }) else { continue };
            state.ray_state = *ray_state;
            state.best = BestHit::NONE;
            if exactly {
                let ray = &rays[ray_state.index as usize];
                let exact = ExactLane::new(ray, ray_state, &bounds);
                // Rays that can hit nothing are not handed out.
                state.exact = exact.unwrap_or(ExactLane::idle());
            }
            (state.child, state.top) = (0, 0);
            let mut stack = stack!(lane);
            // SAFETY: stacks have the space.
            unsafe { stack.begin() };
            queues.put(lane, 0);
        }
        if queues.is_empty() {
            return;
        }
        for lane in queues.take(Turn::Node) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            let mut stack = stack!(lane);
            // SAFETY: the caller's contract; the child is a node; stacks have the space.
            let (child, top) =
                unsafe { step::<S>(&state.ray_state, lines, state.child, &mut stack, state.top) };
            (state.child, state.top) = (child, top);
            ask_for::<S, L>(lines, leaves, child);
            queues.put(lane, child);
        }
        for lane in queues.take(Turn::Block) {
            // SAFETY: lanes are below FLIGHT.
            let state = unsafe { lanes.get_unchecked_mut(lane) };
            let mut stack = stack!(lane);
            let Lane { ray_state, best, child, .. } = state;
            let (room, exact) = (&mut leaf_room, exactly.then_some(&mut state.exact));
            let tested = &mut RayTest { test, room, ray_state, best, exact };
            // Not in a separate function: that would make rays that hit something a tenth slower
            // here. SAFETY: the caller's contract; children name nodes or leaves; wide rays get no
            // lane.
            let better = unsafe { TestLeaf(*child, tested).run::<S>() };
            if better {
                if query == Query::Any {
                    queues.put(lane, DONE);
                    continue;
                }
                let stop = state.best.stop.min(state.ray_state.stop);
                state.ray_state.stop = stop;
                // SAFETY: the caller's contract; stacks have the space.
                state.top = unsafe { stack.cull::<S>(state.top, stop) };
            }
            // SAFETY: entries that were written.
            let child = unsafe { *stack.children.add(state.top) };
            (state.child, state.top) = (child, state.top.wrapping_sub(1));
            ask_for::<S, L>(lines, leaves, child);
            queues.put(lane, child);
        }
    }
}

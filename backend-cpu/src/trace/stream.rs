//! Batches: several rays at a time, which take their steps in turn.
//!
//! A step of a ray is one wide node, whose boxes are tested all at once, or one block of triangles.
//! After it the next place of the ray is known and prefetched, and other rays take their steps
//! until the memory has arrived. Rays at nodes and rays at blocks are processed by turns, each kind
//! as bits of one word, so that no branch has to predict which kind a ray is. When a ray is
//! answered, the next one takes its place. Coherent rays are traced by [`super::packet`] instead.

use core::cell::RefCell;
use std::collections::TryReserveError;

use splitplane_core::ray::Accuracy;

use super::batch::{Answers, RayBatch};
use super::block_test::BestHit;
use super::exact;
use super::leaves::{IndexedLeaves, Leaves, PackedLeaves, WrittenLeaves};
use super::packet::Packet;
use super::prepare::{CHUNK, PreparedRays};
use super::queues::{FLIGHT, Queues, Turn};
use super::ray_state::RayState;
use super::sieve::{ExactLane, Reach};
use super::supply::{EXACT_IN_TURN, Supply};
use super::turns::{AtNodes, Blocks, Lane, Lanes};
use super::unfinished::Unfinished;
use crate::layout::wide_node::DONE;
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};

/// Memory of the rays under way, kept between batches.
struct Flight {
    lanes: Vec<Lane>,
    exact: Vec<ExactLane>,
    /// Their stacks.
    stacks: Vec<u32>,
    ready: PreparedRays,
    ray_states: [RayState; CHUNK],
    packet: Packet,
}

impl Flight {
    /// No rays, and no memory yet.
    fn new() -> Flight {
        let (lanes, exact, stacks) = (Vec::new(), Vec::new(), Vec::new());
        let (ready, ray_states, packet) =
            (PreparedRays::NONE, [RayState::none(); CHUNK], Packet::new());
        Flight { lanes, exact, stacks, ready, ray_states, packet }
    }

    /// Takes this thread's memory, for stacks of so many entries.
    ///
    /// # Errors
    /// No memory.
    fn borrow(room: usize) -> Result<Box<Flight>, TryReserveError> {
        // `None` while the thread is being destroyed.
        let kept = IN_FLIGHT.try_with(RefCell::take).ok().flatten();
        let mut flight = kept.map_or_else(|| boxed(Flight::new), Ok)?;
        flight.make_room(room)?;
        Ok(flight)
    }

    /// Keeps it for the next batch.
    fn give_back(self: Box<Flight>) {
        let _ = IN_FLIGHT.try_with(|kept| kept.replace(Some(self)));
    }

    /// Makes lanes, and stacks of `room` entries.
    ///
    /// # Errors
    /// Less memory than that.
    fn make_room(&mut self, room: usize) -> Result<(), TryReserveError> {
        let Flight { lanes, exact, stacks, packet, .. } = self;
        if lanes.is_empty() {
            let (ray_state, best) = (RayState::none(), BestHit::NONE);
            exact.try_reserve_exact(FLIGHT)?;
            exact.resize_with(FLIGHT, ExactLane::idle);
            lanes.try_reserve_exact(FLIGHT)?;
            let stack = core::ptr::null_mut();
            lanes.resize_with(FLIGHT, || Lane { ray_state, child: DONE, top: stack, best, stack });
        }
        lengthen(stacks, 2 * room * FLIGHT, DONE)?;
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
        if !EXACT_IN_TURN && batch.options.accuracy == Accuracy::Exact {
            let RayBatch { layout, scene, rays, options, query } = batch;
            for index in 0..rays.len() {
                let ray = rays.ray(index);
                answers
                    .set(index, exact::trace_in_f64(layout, &scene.bounds, &ray, options, query));
            }
            return Ok(());
        }
        let mut flight = Flight::borrow(batch.layout.wide.stack())?;
        // SAFETY: the caller's contract; there is space.
        unsafe {
            match IndexedLeaves::of(batch.layout) {
                None => {
                    let leaves = PackedLeaves::new(batch.layout);
                    fly::<S, _>(batch, leaves, &mut flight, &mut answers);
                }
                Some(leaves) => {
                    fly::<S, IndexedLeaves<'_>>(batch, leaves, &mut flight, &mut answers);
                }
            }
        }
        flight.give_back();
        Ok(())
    }
}

/// What rays at blocks share, by how all blocks of the layout are stored. It is asked once a turn, so that blocks are not asked: where every one
/// was, that took back half and more of what writing corners out gives.
enum EveryBlock<'a, L: Leaves> {
    Shared(Blocks<'a, L::Shared>),
    Written(Blocks<'a, WrittenLeaves<'a>>),
}

/// Traces what the batch has.
///
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
    let room = layout.wide.stack();
    let Flight { lanes, exact, stacks, ready, ray_states, packet } = flight;
    packet.begin(layout, query);
    let exactly = EXACT_IN_TURN && options.accuracy == Accuracy::Exact;
    let bounds = [scene.bounds, layout.large.others];
    let errors = [[0.0; 2]; 2];
    let mut supply =
        Supply { batch, next: 0, left: 0, moved: u32::MAX, errors, ready, ray_states, packet };
    let (mut queues, mut unfinished) = (Queues::IDLE, Unfinished::new());
    for (lane, stack) in lanes.iter_mut().zip(stacks.chunks_exact_mut(2 * room)) {
        lane.ray_state.index = RayState::NO_RAY;
        lane.stack = stack.as_mut_ptr();
    }
    let (lanes, exact) = (lanes[..FLIGHT].as_mut_ptr(), exact[..FLIGHT].as_mut_ptr());
    let lanes = Lanes { lanes, exact, room, lines: lines.as_ptr(), leaves };
    let how = (options, query, exactly.then_some(rays));
    let mut blocks = if S::WRITES_OUT && layout.is_written() {
        EveryBlock::<L>::Written(lanes.blocks(WrittenLeaves::new(layout), how))
    } else {
        EveryBlock::<L>::Shared(lanes.blocks(leaves.shared(), how))
    };
    loop {
        for number in queues.take(Turn::Refill) {
            // SAFETY: lanes are below FLIGHT.
            let lane = unsafe { lanes.lane(number) };
            if lane.ray_state.index != RayState::NO_RAY {
                let index = lane.ray_state.index as usize;
                if !exactly {
                    answers.set(index, lane.best.hit);
                } else {
                    // SAFETY: lanes are below FLIGHT.
                    match unsafe { lanes.exact(number) }.hit(query) {
                        Ok(hit) => answers.set(index, hit),
                        // SAFETY: the caller's contract.
                        Err(hit) => unsafe {
                            unfinished.add::<S>(&rays, index, hit, answers);
                        },
                    }
                }
                lane.ray_state.index = RayState::NO_RAY;
            }
            // SAFETY: the caller's contract.
            let Some((ray_state, moved)) = (unsafe { supply.next::<S>(answers) }) else { continue };
            lane.ray_state = *ray_state;
            lane.best = BestHit::NONE;
            if exactly {
                let RayState { t_min, t_max, .. } = *ray_state;
                let reach = if moved {
                    Reach::new(ray_state, &bounds)
                } else {
                    Reach::with_errors(supply.errors, t_min, t_max)
                };
                // SAFETY: lanes are below FLIGHT.
                unsafe { lanes.exact(number) }.begin(reach);
            }
            (lane.child, lane.top) = (0, lane.stack);
            // SAFETY: stacks have the space.
            unsafe { lanes.stack(lane.stack).begin() };
            queues.put(number, 0);
        }
        if queues.is_empty() {
            // SAFETY: the caller's contract.
            unsafe { unfinished.finish::<S>(answers) };
            return;
        }
        // SAFETY: the caller's contract; as many lanes as queues have.
        unsafe {
            queues = S::call(AtNodes(&lanes, queues));
            queues = match &mut blocks {
                EveryBlock::Written(blocks) if S::WRITES_OUT => blocks.take_turns::<S>(queues),
                EveryBlock::Shared(blocks) => blocks.take_turns::<S>(queues),
                EveryBlock::Written(_) => queues,
            };
        }
    }
}

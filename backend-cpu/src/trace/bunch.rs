//! Rays that enter a mesh together, made ready elsewhere than in its own batches: traced in turn, each in a lane of its own.
//!
//! As in a mesh's own batches ([`super::turns`]), but no more rays come than there are lanes, so that each stays where it was made ready, and none is
//! waited for.

use core::hint::assert_unchecked;
use std::collections::TryReserveError;

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, Ray};

use super::batch::RayBatch;
use super::block_test::BestHit;
use super::keep::KeepAll;
use super::leaves::Leaves;
use super::prepare::{CHUNK, PerRay, PreparedRays, RECORD};
use super::prepare_one::{LoadedRay, Readiness};
use super::ray_state::{RayState, ScalarOutcome};
use super::single::Single;
use super::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step_in_turn};
use crate::layout::wide_node::{DONE, leaf_bit};
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};

/// So many rays are prepared together: parts of which none is asked for are passed over.
pub(crate) const PART: usize = 16;
/// The numbers of so many rays, by rows in the order of records.
pub(crate) type PartRows = [PerRay<f32, PART>; RECORD];

/// Rays that enter a mesh together, a lane for each.
pub(crate) struct Bunch {
    prepared: PreparedRays<PART>,
    ray_states: [RayState; CHUNK],
    lanes: [Lane; CHUNK],
    stacks: Vec<u32>,
    /// Entries of a stack.
    room: usize,
    /// Lanes that are ready.
    ready: u32,
    /// Lanes that have a hit.
    hits: u32,
}

/// A ray under way.
#[derive(Clone, Copy)]
struct Lane {
    child: u32,
    /// Where its stack begins in those of all.
    stack: usize,
    /// The last entry.
    last: *mut u32,
    best: BestHit,
}

impl Bunch {
    /// No rays, with stacks of so many entries.
    ///
    /// # Errors
    /// No memory.
    pub(crate) fn new(room: usize) -> Result<Box<Bunch>, TryReserveError> {
        let none = Lane { child: DONE, stack: 0, last: core::ptr::null_mut(), best: BestHit::NONE };
        let mut bunch = boxed(|| Bunch {
            prepared: PreparedRays::NONE,
            ray_states: [RayState::none(); CHUNK],
            lanes: [none; CHUNK],
            stacks: Vec::new(),
            room,
            ready: 0,
            hits: 0,
        })?;
        lengthen(&mut bunch.stacks, 2 * room * CHUNK, DONE)?;
        for (number, lane) in bunch.lanes.iter_mut().enumerate() {
            lane.stack = 2 * room * number;
        }
        Ok(bunch)
    }

    /// No lane is ready, and none has a hit.
    pub(crate) fn clear(&mut self) {
        (self.ready, self.hits) = (0, 0);
    }

    /// Lanes that have a hit, as bits.
    pub(crate) fn hits(&self) -> u32 {
        self.hits
    }

    /// The hit of a lane that has one; of rays that any hit ends, a hit.
    pub(crate) fn hit(&self, lane: usize) -> &Hit {
        &self.lanes[lane].best.hit
    }

    /// Takes what was found for a lane elsewhere.
    pub(crate) fn answer(&mut self, lane: usize, hit: Hit) {
        self.lanes[lane].best.hit = hit;
        self.hits |= u32::from(hit.is_hit()) << lane;
    }

    /// Makes one ray ready. Returns 1 where it needs more care.
    ///
    /// # Safety
    /// The processor must have the set; lanes are below [`CHUNK`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn ready_one<S: Simd>(
        &mut self,
        batch: &RayBatch<'_>,
        ray: &LoadedRay,
        lane: usize,
    ) -> u32 {
        let ray_state = &mut self.ray_states[lane];
        // SAFETY: the caller's contract.
        match unsafe { ray_state.prepare_loaded::<S>(ray, batch.scene, batch.query) } {
            Readiness::Ready => {
                self.ready |= 1 << lane;
                0
            }
            Readiness::Misses => 0,
            Readiness::Special => 1,
        }
    }

    /// Makes a ray ready that needs more care, or answers it.
    ///
    /// # Safety
    /// As for [`Bunch::ready_one`], and the layout must be made for the set.
    #[cold]
    pub(crate) unsafe fn ready_special<S: Simd>(
        &mut self,
        batch: &RayBatch<'_>,
        ray: &Ray,
        lane: usize,
    ) {
        let RayBatch { layout, scene, options, query, .. } = *batch;
        let hit: Hit = match RayState::prepare_by_core(ray, scene, options.accuracy, query) {
            Some(ScalarOutcome::Traced(moved)) => {
                self.ray_states[lane] = moved;
                self.ready |= 1 << lane;
                return;
            }
            Some(ScalarOutcome::Answer(hit)) => hit,
            // SAFETY: the caller's contract.
            None => unsafe { S::call(Single { layout, scene, ray, options, query }) },
        };
        self.answer(lane, hit);
    }
}

/// Makes some of the rays of these rows ready, those that meet the bounds. Rows are origin, lower limit, direction, upper limit, as in [`Ray`]. The
/// layout must be made for the set. A function of its own, so that it is compiled once for all queries.
pub(crate) struct ReadyMany<'a, 'b> {
    pub(crate) bunch: &'a mut Bunch,
    pub(crate) batch: &'a RayBatch<'b>,
    pub(crate) rows: &'a [PartRows; CHUNK / PART],
    /// Which of them, as bits.
    pub(crate) asked: u32,
}

impl Compiled for ReadyMany<'_, '_> {
    /// The lanes that need more care.
    type Output = u32;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u32 {
        let ReadyMany { bunch, batch, rows, asked } = self;
        let Bunch { prepared, ray_states, ready, .. } = bunch;
        let mut special = 0;
        // Not in packets: where a mesh has a triangle or two for each ray, they take longer.
        *ready = 0;
        for (part, rows) in rows.iter().enumerate() {
            let first = part * PART;
            if asked >> first & (u32::MAX >> (32 - PART)) == 0 {
                continue;
            }
            prepared.fill_rows(rows, PART, batch.scene, 0, batch.query);
            let (mut own, mut alive) = (0, 0);
            for lane in 0..PART {
                let within = u32::from(prepared.enter[lane] <= prepared.exit[lane]);
                own |= prepared.special[lane] << lane;
                alive |= (prepared.alive[lane] & within) << lane;
            }
            let rays = (alive & !own) << first & asked;
            if rays != 0 {
                let Some(states) = ray_states[first..].first_chunk_mut() else { continue };
                // SAFETY: the caller's contract.
                unsafe { prepared.ray_states::<S>(states) };
            }
            (*ready, special) = (*ready | rays, special | own << first);
        }
        special & asked
    }
}

/// Traces the rays that are ready in turn; accuracy must be watertight, and the layout made for the set. `ANY`: a hit ends a ray.
pub(crate) struct FlyReady<'a, 'b, L, const ANY: bool> {
    pub(crate) bunch: &'a mut Bunch,
    pub(crate) batch: &'a RayBatch<'b>,
    pub(crate) leaves: L,
}

impl<L: Leaves, const ANY: bool> Compiled for FlyReady<'_, '_, L, ANY> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let FlyReady { bunch, batch, leaves } = self;
        let (lines, options) = (batch.layout.wide.lines().as_ptr(), batch.options);
        let query = if ANY { Query::Any } else { Query::Closest };
        // SAFETY: the caller's contract.
        unsafe { assert_unchecked(options.accuracy == Accuracy::Watertight) };
        let test = &TestContext { leaves, options, query, keep: KeepAll };
        let mut leaf_room = L::room();
        let Bunch { ray_states, lanes, stacks, room, ready, hits, .. } = bunch;
        let (room, stacks) = (*room, stacks.as_mut_ptr());
        let stack = |at: *mut u32| TraversalStack {
            children: at,
            // A stack has twice as many words as entries.
            t: at.wrapping_add(room).cast(),
        };
        // Rays at nodes, and rays at blocks.
        let (mut nodes, mut blocks) = (core::mem::take(ready), 0u32);
        for number in lanes_of(nodes) {
            let lane = &mut lanes[number];
            (lane.child, lane.best) = (0, BestHit::NONE);
            // SAFETY: lanes have their stacks.
            unsafe {
                lane.last = stacks.add(lane.stack);
                stack(lane.last).begin();
            }
        }
        loop {
            for number in lanes_of(core::mem::take(&mut nodes)) {
                let (lane, ray_state) = (&mut lanes[number], &ray_states[number]);
                // SAFETY: the caller's contract; the child is a node; stacks have the space.
                unsafe {
                    let entry = lane.last;
                    let (child, more) =
                        step_in_turn::<S>(ray_state, lines, lane.child, stack(entry));
                    (lane.child, lane.last) = (child, entry.add(more).wrapping_sub(1));
                    ask_for::<S, L>(lines, leaves, child);
                    put((&mut nodes, &mut blocks), number, child);
                }
            }
            for number in lanes_of(core::mem::take(&mut blocks)) {
                let (lane, ray_state) = (&mut lanes[number], &mut ray_states[number]);
                let Lane { child, stack: first, last, best } = lane;
                let tested =
                    &mut RayTest { test, room: &mut leaf_room, ray_state, best, exact: None };
                // SAFETY: the caller's contract; the child names a leaf; wide rays are not ready; stacks have the space, and entries were written.
                unsafe {
                    if TestLeaf(*child, tested).run::<S>() {
                        *hits |= 1 << number;
                        if ANY {
                            continue;
                        }
                        let stop = best.stop.min(ray_state.stop);
                        ray_state.stop = stop;
                        // Of the entries, the lowest stays.
                        let bottom = stacks.add(*first);
                        let entries = last.offset_from(bottom) as usize;
                        *last = bottom.add(stack(bottom).cull::<S>(entries, stop));
                    }
                    *child = **last;
                    *last = last.wrapping_sub(1);
                }
                ask_for::<S, L>(lines, leaves, *child);
                put((&mut nodes, &mut blocks), number, *child);
            }
            if nodes | blocks == 0 {
                return;
            }
        }
    }
}

/// Puts a lane where its child calls for: to those at nodes, to those at blocks, or nowhere, without a branch, since no predictor could get it right.
#[cfg_attr(not(unoptimised), inline(always))]
fn put((nodes, blocks): (&mut u32, &mut u32), lane: usize, child: u32) {
    let (leaf, done) = (leaf_bit(child) as u32, u32::from(child == DONE));
    *nodes |= (leaf ^ 1) << lane;
    *blocks |= (leaf ^ done) << lane;
}

/// The lanes of bits.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < CHUNK).then_some(lane)
    })
}

//! Rays that enter a mesh together, made ready elsewhere than in its own batches: traced as those trace theirs.

use splitplane_core::ray::{Hit, Ray};

use super::batch::{Answers, RayBatch};
use super::leaves::Leaves;
use super::prepare::{CHUNK, PerRay, RECORD};
use super::prepare_one::{LoadedRay, Readiness};
use super::ray_state::{RayState, ScalarOutcome};
use super::single::Single;
use super::stream::{Flight, fly};
use crate::simd::{Compiled, Simd};

/// Makes some of the rays of these rows ready, those that meet the bounds. Rows are origin, lower limit, direction, upper limit, as in [`Ray`]. The
/// layout must be made for the set, and the flight must have space for its stacks. A function of its own, so that it is compiled once for
/// all queries.
pub(crate) struct ReadyMany<'a, 'b> {
    pub(crate) flight: &'a mut Flight,
    pub(crate) batch: &'a RayBatch<'b>,
    pub(crate) rows: &'a [PerRay<f32>; RECORD],
    /// Which of them, as bits.
    pub(crate) asked: u32,
}

impl Compiled for ReadyMany<'_, '_> {
    /// The lanes that need more care.
    type Output = u32;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u32 {
        let ReadyMany { flight, batch, rows, asked } = self;
        let Flight { ready, ray_states, left, .. } = flight;
        ready.fill_rows(rows, CHUNK, batch.scene, 0, batch.query);
        let (mut special, mut alive) = (0, 0);
        for lane in 0..CHUNK {
            let within = u32::from(ready.enter[lane] <= ready.exit[lane]);
            special |= ready.special[lane] << lane;
            alive |= (ready.alive[lane] & within) << lane;
        }
        let rays = alive & asked & !special;
        // Not in packets: where a mesh has a triangle or two for each ray, they take longer.
        *left = rays;
        if rays != 0 {
            // SAFETY: the caller's contract.
            unsafe { ready.ray_states::<S>(ray_states) };
        }
        special & asked
    }
}

/// Traces the rays that are ready in turn. As [`ReadyMany`].
pub(crate) struct FlyReady<'a, 'b, 'c, L> {
    pub(crate) flight: &'a mut Flight,
    pub(crate) batch: &'a RayBatch<'b>,
    pub(crate) leaves: L,
    pub(crate) answers: &'a mut Answers<'c>,
}

impl<L: Leaves> Compiled for FlyReady<'_, '_, '_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let FlyReady { flight, batch, leaves, answers } = self;
        let left = core::mem::take(&mut flight.left);
        if left != 0 {
            // SAFETY: the caller's contract.
            unsafe { fly::<S, L>(*batch, left, leaves, flight, answers) };
        }
    }
}

impl Flight {
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
                ray_state.index = lane as u32;
                self.left |= 1 << lane;
                0
            }
            Readiness::Misses => 0,
            Readiness::Special => 1,
        }
    }

    /// Makes a ray ready that needs more care, or answers it.
    ///
    /// # Safety
    /// As for [`Flight::ready_one`], and the layout must be made for the set.
    #[cold]
    pub(crate) unsafe fn ready_special<S: Simd>(
        &mut self,
        batch: &RayBatch<'_>,
        ray: &Ray,
        lane: usize,
        answers: &mut Answers<'_>,
    ) {
        let RayBatch { layout, scene, options, query, .. } = *batch;
        let hit: Hit = match RayState::prepare_by_core(ray, scene, options.accuracy, query) {
            Some(ScalarOutcome::Traced(moved)) => {
                self.ray_states[lane] = RayState { index: lane as u32, ..moved };
                self.left |= 1 << lane;
                return;
            }
            Some(ScalarOutcome::Answer(hit)) => hit,
            // SAFETY: the caller's contract.
            None => unsafe { S::call(Single { layout, scene, ray, options, query }) },
        };
        answers.set(lane, hit);
    }
}

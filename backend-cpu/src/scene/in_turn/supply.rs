//! Where lanes get their rays.
//!
//! Rays are loaded as many at a time as are prepared at once. Those that go the same way are answered together, from instance to instance ([`Together`]); each of the
//! others waits for a lane.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::scene::{BuiltScene, SceneAnswer};
use splitplane_core::ray::Ray;

use super::Shared;
use super::lane::{Lane, Waiting, lanes_of};
use crate::memory::boxed;
use crate::scene::found::Found;
use crate::scene::single::{Followed, Following, SceneSingle};
use crate::scene::together::{Room, Together};
use crate::scene::turn_ray::TurnRay;
use crate::scene::way::{LoadWay, TopRays};
use crate::simd::{Compiled, Simd};
use crate::trace::prepare::CHUNK;
use crate::trace::ray_state::RayState;

/// Rays that have been loaded and have not all begun.
pub(super) struct Supply {
    /// The first ray of the batch that is not loaded.
    next: usize,
    /// Where the loaded ones begin.
    start: usize,
    /// Those that have not begun, as bits, and all of them as they begin.
    left: u32,
    ready: Box<[TurnRay; CHUNK]>,
    room: Room,
}

impl Supply {
    /// No rays yet, for a tree over instances whose stacks have so many entries, and meshes whose stacks have so many.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(top: usize, room: usize) -> Result<Supply, TryReserveError> {
        let ready = boxed(|| [TurnRay::NONE; CHUNK])?;
        Ok(Supply { next: 0, start: 0, left: 0, ready, room: Room::new(top, room)? })
    }
}

/// Takes the answers of rays that are done, and gives their lanes others, as long as there are some.
pub(super) struct Refill<'a, 'b, T, L> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    pub(super) scene: &'b BuiltScene,
    pub(super) shared: &'a Shared<'b>,
    pub(super) supply: &'a mut Supply,
    pub(super) answers: &'a mut [T],
    /// Instances entered.
    pub(super) entered: &'a mut u64,
    pub(super) of: PhantomData<L>,
}

impl<'b, T: SceneAnswer, L: Found<'b>> Compiled for Refill<'_, 'b, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let Refill { lanes, waiting, scene, shared, supply, answers, entered, of } = self;
        for number in lanes_of(core::mem::take(&mut waiting.done)) {
            // SAFETY: lanes are below LANES.
            let lane = unsafe { &mut *lanes.add(number) };
            if lane.index != RayState::NO_RAY {
                answers[lane.index as usize] = lane.answer;
                lane.index = RayState::NO_RAY;
            }
            while supply.left == 0 && supply.next < shared.rays.len() {
                let answers = &mut *answers;
                // SAFETY: the caller's contract.
                *entered += unsafe { S::call(Load { scene, shared, supply, answers, of }) };
            }
            if supply.left == 0 {
                continue;
            }
            let place = supply.left.trailing_zeros() as usize;
            supply.left &= supply.left - 1;
            lane.turn_ray = supply.ready[place];
            lane.index = (supply.start + place) as u32;
            (lane.answer, lane.limit) = (T::NONE, shared.rays[supply.start + place].t_max);
            (lane.top_child, lane.top_last) = (0, lane.top_stack);
            waiting.top |= 1 << number;
        }
    }
}

/// Loads the next rays. Answers those that are unusual, and those that go the same way from instance to instance.
struct Load<'a, 'b, T, L> {
    scene: &'b BuiltScene,
    shared: &'a Shared<'b>,
    supply: &'a mut Supply,
    answers: &'a mut [T],
    of: PhantomData<L>,
}

impl<'b, T: SceneAnswer, L: Found<'b>> Compiled for Load<'_, 'b, T, L> {
    /// How many instances they entered, all together.
    type Output = u64;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u64 {
        let Load { scene, shared, supply, answers, of } = self;
        let (tree, options) = (scene.top_tree(), shared.options);
        let rest = &shared.rays[supply.next..];
        let count = rest.len().min(CHUNK);
        let mut last;
        let rays: &[Ray; CHUNK] = match rest.first_chunk() {
            Some(rays) => rays,
            None => {
                last = [rest[0]; CHUNK];
                last[..count].copy_from_slice(rest);
                &last
            }
        };
        supply.start = supply.next;
        supply.next += count;
        let answers = &mut answers[supply.start..][..count];
        let way = &mut supply.room.way;
        // SAFETY: the caller's contract.
        let usual = unsafe { S::call(LoadWay { way: &mut *way, rays, reach: tree.reach() }) };
        let bounds = tree.bounds();
        let mut extents = 0.0;
        for axis in 0..3 {
            extents += bounds.hi[axis] - bounds.lo[axis];
        }
        if count == CHUNK && usual == u32::MAX && way.goes_together(extents) {
            let (geometries, room) = (shared.geometries, &mut supply.room);
            let asked = Together { scene, geometries, options, rays, answers, room, of };
            // SAFETY: the caller's contract.
            return unsafe { S::call(asked) };
        }
        let there = u32::MAX >> (CHUNK - count);
        supply.left = there & usual;
        for lane in lanes_of(there & !usual) {
            let (ray, set) = (&rays[lane], shared.geometries.set);
            let single = SceneSingle { scene, ray, options, set };
            // SAFETY: the caller's contract.
            let found = unsafe { S::call(Following(single, PhantomData)) };
            if let Followed::Answer(answer) = found {
                answers[lane] = answer;
            }
        }
        // SAFETY: the caller's contract.
        unsafe { S::call(TopRays { way: &supply.room.way, to: &mut supply.ready }) };
        0
    }
}

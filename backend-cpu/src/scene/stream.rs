//! Batches of rays through scenes: several rays at a time, each in an instance of its own, which take their steps in turn.
//!
//! As [`trace::stream`](crate::trace::stream), whose steps these are, but a ray whose way through an instance has ended goes on to the
//! next instance that it enters, until none is left that could precede its best hit. So a ray's stack of instances stays where it is near, and
//! nothing is sorted.

use core::cell::Cell;
use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::scene::{Asked, SceneAnswer, limit_within, seen_by};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::scene::{GeometryId, InstanceId, Placement, SceneHit, TopRay, TopStack};

use super::batch::{SceneBatch, Work};
use super::counting::KeepSome;
use super::found::Found;
use super::parts::Reached;
use super::seen::WorldRay;
use super::top_walk::{VectorRay, next};
use crate::layout::wide_node::{CacheLine, DONE};
use crate::memory::lengthen;
use crate::simd::{Compiled, Simd, prefetch};
use crate::trace::block_test::BestHit;
use crate::trace::keep::Keep;
use crate::trace::prepare_one::Readiness;
use crate::trace::queues::{FLIGHT, Queues, Turn};
use crate::trace::ray_state::{RayState, ScalarOutcome};
use crate::trace::single::Single;
use crate::trace::step::{RayTest, TestContext, TestLeaf, TraversalStack, ask_for, step_in_turn};

/// A ray in an instance.
struct Lane<'a, T, L> {
    ray_state: RayState,
    /// Its current child, and the last entry of its stack.
    child: u32,
    top: usize,
    best: BestHit,
    lines: *const CacheLine,
    /// `None` before the first instance.
    within: Option<Within<'a, L>>,
    instance: InstanceId,
    geometry: GeometryId,
    /// Its place in the batch; [`RayState::NO_RAY`] for none.
    index: u32,
    world: WorldRay,
    top_ray: VectorRay,
    /// Entries of its stack of instances.
    tops: usize,
    answer: T,
}

/// What tests of triangles read in an instance.
struct Within<'a, L> {
    leaves: L,
    keep: KeepSome<'a>,
    options: QueryOptions<'a>,
}

/// The rays under way.
pub(super) struct Flying<'a, T, L> {
    batch: SceneBatch<'a, T>,
    of: PhantomData<L>,
}

impl<'a, T, L> Flying<'a, T, L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(batch: SceneBatch<'a, T>) -> Flying<'a, T, L> {
        Flying { batch, of: PhantomData }
    }
}

impl<'a, T: SceneAnswer, L: Found<'a>> Compiled for Flying<'a, T, L> {
    type Output = Result<Work, TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Work, TryReserveError> {
        let rejected = Cell::new(0);
        let SceneBatch { scene, geometries, rays, answers, options } = self.batch;
        let (room, top_room) = (geometries.stack, scene.top_tree().stack());
        let (mut children, mut t) = (Vec::new(), Vec::new());
        lengthen(&mut children, room * FLIGHT, DONE)?;
        lengthen(&mut t, room * FLIGHT, 0.0)?;
        let mut top_stacks: Vec<TopStack> = Vec::new();
        lengthen(&mut top_stacks, top_room * FLIGHT, TopStack::default())?;
        let mut lanes: Vec<Lane<'_, T, L>> = Vec::new();
        lanes.try_reserve_exact(FLIGHT)?;
        lanes.extend((0..FLIGHT).map(|_| Lane {
            ray_state: RayState::none(),
            child: DONE,
            top: 0,
            best: BestHit::NONE,
            lines: core::ptr::null(),
            within: None,
            instance: InstanceId(0),
            geometry: GeometryId(0),
            index: RayState::NO_RAY,
            world: WorldRay::none(),
            top_ray: VectorRay::NONE,
            tops: 0,
            answer: T::NONE,
        }));
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
        let (nodes, reach) = (scene.top_tree().nodes(), scene.top_tree().reach());
        let placements = scene.all_placements();
        let (mut following, mut entered) = (0usize, 0u64);
        let mut leaf_room = L::room();
        let mut queues = Queues::IDLE;
        loop {
            for number in queues.take(Turn::Refill) {
                // SAFETY: lanes are below FLIGHT.
                let lane = unsafe { lanes.get_unchecked_mut(number) };
                let top_stack = &mut top_stacks[number * top_room..][..top_room];
                // Without a ray there is nothing to be answered.
                let mut is_done = lane.index == RayState::NO_RAY || lane.take(lane.best.hit);
                loop {
                    if is_done {
                        if lane.index != RayState::NO_RAY {
                            answers[lane.index as usize] = lane.answer;
                            lane.index = RayState::NO_RAY;
                        }
                        let Some(ray) = rays.get(following) else { break };
                        following += 1;
                        let Some(top_ray) = TopRay::new(ray) else {
                            answers[following - 1] = T::NONE;
                            continue;
                        };
                        lane.index = following as u32 - 1;
                        let top_ray = VectorRay::new(&top_ray, options.accuracy, reach);
                        (lane.top_ray, lane.answer) = (top_ray, T::NONE);
                        lane.world = WorldRay::new(ray);
                        lane.tops = scene.top_tree().begin(top_stack);
                    }
                    let ray = &rays[lane.index as usize];
                    let best = lane.answer.best();
                    let stop = TopRay::stop_after(ray.t_max.min(best.t));
                    let top_stack = top_stack.as_mut_ptr();
                    // SAFETY: the caller's contract; the tree's nodes, and a stack for it.
                    let found = unsafe {
                        next::<S::Eight, T>(nodes, &lane.top_ray, stop, top_stack, &mut lane.tops)
                    };
                    let Some(name) = found else {
                        is_done = true;
                        continue;
                    };
                    is_done = false;
                    lane.instance = InstanceId(name);
                    let placement = placements.as_ptr().wrapping_add(name as usize).cast::<u8>();
                    for line in 0..size_of::<Placement>().div_ceil(64) {
                        prefetch(placement.wrapping_add(64 * line));
                    }
                    queues.wait(number, Turn::Enter);
                    break;
                }
            }
            for number in queues.take(Turn::Enter) {
                // SAFETY: lanes are below FLIGHT.
                let lane = unsafe { lanes.get_unchecked_mut(number) };
                // What it does not enter it does not hit.
                lane.best = BestHit::NONE;
                let turn = 'enter: {
                    let placement = placements.get(lane.instance.0 as usize);
                    let Some(Some(placement)) = placement else { break 'enter Turn::Refill };
                    let asked = Asked::of(lane.instance, placement, options);
                    let Some(asked) = asked else { break 'enter Turn::Refill };
                    lane.geometry = placement.instance.geometry;
                    let Some(reached) = geometries.get(lane.geometry) else {
                        break 'enter Turn::Refill;
                    };
                    let of = (lane.geometry, lane.instance);
                    let keep = KeepSome::within(scene, of, options, &rejected);
                    let ray = &rays[lane.index as usize];
                    let query = options.of_geometry(asked.culling, asked.ignore, None);
                    let accelerator = match reached {
                        Reached::Triangles(accelerator) => accelerator,
                        Reached::Shapes(shapes) => {
                            entered += 1;
                            let seen = seen_by(placement, ray, &lane.answer.best());
                            let keep = |hit: &Hit| keep.keeps(hit);
                            lane.best.hit = shapes.trace(&seen, &query, T::QUERY, keep);
                            break 'enter Turn::Refill;
                        }
                    };
                    let (layout, scale) = accelerator.parts();
                    let Some(leaves) = L::of(layout) else { break 'enter Turn::Refill };
                    if layout.wide.lines().is_empty() {
                        break 'enter Turn::Refill;
                    }
                    entered += 1;
                    let limits = [ray.t_min, limit_within(ray, &lane.answer.best())];
                    let seen = lane.world.seen_by(placement, limits);
                    // SAFETY: the caller's contract.
                    let readiness =
                        unsafe { lane.ray_state.prepare_loaded::<S>(&seen, scale, T::QUERY) };
                    match readiness {
                        Readiness::Misses => break 'enter Turn::Refill,
                        Readiness::Ready => {}
                        Readiness::Special => {
                            let ray = &seen_by(placement, ray, &lane.answer.best());
                            // A hit of which not all parts are known cannot be judged.
                            let first = if keep.keeps_all() { T::QUERY } else { Query::Closest };
                            let hit = match RayState::prepare_by_core(
                                ray,
                                scale,
                                query.accuracy,
                                T::QUERY,
                            ) {
                                Some(ScalarOutcome::Traced(moved)) => {
                                    lane.ray_state = moved;
                                    None
                                }
                                Some(ScalarOutcome::Answer(hit)) => Some(hit),
                                None => {
                                    let (scene, options, query) = (scale, &query, first);
                                    let single = Single { layout, scene, ray, options, query };
                                    // SAFETY: the caller's contract.
                                    Some(unsafe { S::call(single) })
                                }
                            };
                            if let Some(hit) = hit {
                                let asked = (&query, T::QUERY);
                                lane.best.hit = keep.settle(scene, lane.geometry, ray, hit, asked);
                                break 'enter Turn::Refill;
                            }
                        }
                    }
                    lane.lines = layout.wide.lines().as_ptr();
                    lane.within = Some(Within { leaves, keep, options: query });
                    (lane.child, lane.top) = (0, 0);
                    let mut stack = stack!(number);
                    // SAFETY: stacks have the space.
                    unsafe { stack.begin() };
                    Turn::Node
                };
                queues.wait(number, turn);
            }
            if queues.is_empty() {
                return Ok(Work { entered, rejected: rejected.get() });
            }
            for number in queues.take(Turn::Node) {
                // SAFETY: lanes are below FLIGHT.
                let lane = unsafe { lanes.get_unchecked_mut(number) };
                let Some(within) = &lane.within else { continue };
                let stack = stack!(number);
                // SAFETY: the caller's contract; the child is a node; stacks have the space.
                let (child, more) = unsafe {
                    let top = stack.at(lane.top);
                    step_in_turn::<S>(&lane.ray_state, lane.lines, lane.child, top)
                };
                (lane.child, lane.top) = (child, (lane.top + more).wrapping_sub(1));
                ask_for::<S, L>(lane.lines, within.leaves, child);
                queues.put(number, child);
            }
            for number in queues.take(Turn::Block) {
                // SAFETY: lanes are below FLIGHT.
                let lane = unsafe { lanes.get_unchecked_mut(number) };
                let mut stack = stack!(number);
                let Lane { ray_state, best, child, within: Some(within), .. } = lane else {
                    continue;
                };
                let test = &TestContext {
                    leaves: within.leaves,
                    options: &within.options,
                    query: T::QUERY,
                    keep: within.keep,
                };
                let leaves = within.leaves;
                let room = &mut leaf_room;
                let tested = &mut RayTest { test, room, ray_state, best, exact: None };
                // SAFETY: the caller's contract; children name nodes or leaves; wide rays are not
                // ready.
                let better = unsafe { TestLeaf(*child, tested).run::<S>() };
                if better {
                    if T::QUERY == Query::Any {
                        queues.put(number, DONE);
                        continue;
                    }
                    let stop = lane.best.stop.min(lane.ray_state.stop);
                    lane.ray_state.stop = stop;
                    // SAFETY: the caller's contract; stacks have the space.
                    lane.top = unsafe { stack.cull::<S>(lane.top, stop) };
                }
                // SAFETY: entries that were written.
                let child = unsafe { *stack.children.add(lane.top) };
                (lane.child, lane.top) = (child, lane.top.wrapping_sub(1));
                ask_for::<S, L>(lane.lines, leaves, child);
                queues.put(number, child);
            }
        }
    }
}

impl<T: SceneAnswer, L> Lane<'_, T, L> {
    /// Takes a hit in the instance that the ray is in. True when the ray is done.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn take(&mut self, hit: Hit) -> bool {
        let found = SceneHit::of(&hit, self.geometry, self.instance);
        found.is_hit() && found.precedes(&self.answer.best()) && self.answer.take(found)
    }
}

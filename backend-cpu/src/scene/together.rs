//! Rays of a batch that go the same way, as many as are prepared at once: found in the tree over instances together, and made ready
//! together in each instance that some of them enter.
//!
//! A node's boxes are tested for all rays at once, by the intervals in which their origins and reciprocals lie; a child that any of them may meet is
//! tested by each, as many as a vector has lanes at a time, when its turn comes. The rays that meet an instance's box go into its space and are
//! prepared by vectors, and take their steps in the mesh in turn. The roundings of
//! intervals are those of the core's test of a box, so no ray misses an instance that could have a hit, and hits do not depend on the way.

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::scene::{Asked, BuiltScene, SceneAnswer, seen_by};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, Ray, Rays};
use splitplane_core::scene::{InstanceId, SceneOptions, TOP_WIDTH};

use super::found::Found;
use super::parts::{Geometries, Reached};
use super::seen::WorldRay;
use super::way::{Entry, Way, range};
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};
use crate::trace::batch::RayBatch;
use crate::trace::bunch::{Bunch, FlyReady, PART, ReadyMany, lanes_of};
use crate::trace::prepare::{CHUNK, RECORD};

/// So few rays, times the lanes of a vector, are prepared one by one: to prepare all takes the fewer steps the more lanes there are.
const FEW_VECTORS: u32 = 64;

/// Memory, kept from one to the next.
pub(super) struct Room {
    bunch: Box<Bunch>,
    stack: Vec<Entry>,
    pub(super) way: Box<Way>,
}

impl Room {
    /// For a scene whose tree over instances needs so many entries, and whose meshes so many.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn new(top: usize, room: usize) -> Result<Room, TryReserveError> {
        let mut stack = Vec::new();
        lengthen(&mut stack, top + TOP_WIDTH, Entry::NONE)?;
        Ok(Room { bunch: Bunch::new(room)?, stack, way: boxed(|| Way::NONE)? })
    }
}

/// Rays, as many as are prepared at once, of which the way has been loaded; they go the same way.
pub(super) struct Together<'a, 'b, T, L> {
    pub(super) scene: &'a BuiltScene,
    pub(super) geometries: &'b Geometries<'a>,
    pub(super) options: &'a SceneOptions<'a>,
    pub(super) rays: &'b [Ray],
    pub(super) answers: &'b mut [T],
    pub(super) room: &'b mut Room,
    pub(super) of: PhantomData<L>,
}

impl<'a, T: SceneAnswer, L: Found<'a>> Compiled for Together<'a, '_, T, L> {
    /// How many instances they entered, all together.
    type Output = u64;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u64 {
        let Together { scene, geometries, options, rays, answers, room, .. } = self;
        let Room { bunch, stack, way } = room;
        let tree = scene.top_tree();
        let nodes = tree.nodes();
        answers.fill(T::NONE);
        let mut entered = 0;
        let few = FEW_VECTORS / S::N as u32;
        let stack = stack.as_mut_ptr();
        let mut seen = [[[0.0; PART]; RECORD]; CHUNK / PART];
        // SAFETY: the caller's contract; the tree's nodes, and a stack for it.
        let mut top = unsafe { way.step::<S::Eight>(&nodes[0], 0, stack) };
        // SAFETY: as above.
        while let Some((name, met)) = unsafe { way.next::<S>(nodes, stack, &mut top) } {
            let instance = InstanceId(name);
            let Some(placement) = scene.placement(instance) else { continue };
            let Some(asked) = Asked::of(instance, placement, options) else { continue };
            let geometry = placement.instance.geometry;
            let Some(reached) = geometries.get(geometry) else { continue };
            let query = options.of_geometry(asked.culling, asked.ignore, None);
            bunch.clear();
            match reached {
                Reached::Shapes(shapes) => {
                    for lane in lanes_of(met) {
                        let seen = seen_by(placement, &rays[lane], &answers[lane].best());
                        bunch.answer(lane, shapes.trace(&seen, &query, T::QUERY, |_| true));
                    }
                }
                Reached::Triangles(accelerator) => {
                    let (layout, scale) = accelerator.parts();
                    let Some(leaves) = L::of(layout) else { continue };
                    if layout.wide.lines().is_empty() {
                        continue;
                    }
                    let batch = RayBatch {
                        layout,
                        scene: scale,
                        rays: Rays::Records(&[]),
                        options: &query,
                        query: T::QUERY,
                    };
                    // SAFETY: the caller's contract.
                    unsafe {
                        let many = met.count_ones() > few && placement.ordinary;
                        let special = if many {
                            way.seen_by::<S>(placement, met, &mut seen);
                            S::call(ReadyMany { bunch, batch: &batch, rows: &seen, asked: met })
                        } else {
                            let mut special = 0;
                            for lane in lanes_of(met) {
                                let limits = [way.t_min[lane], way.limit[lane]];
                                let seen = WorldRay::new(&rays[lane]).seen_by(placement, limits);
                                special |= bunch.ready_one::<S>(&batch, &seen, lane) << lane;
                            }
                            special
                        };
                        for lane in lanes_of(special) {
                            let seen = &seen_by(placement, &rays[lane], &answers[lane].best());
                            bunch.ready_special::<S>(&batch, seen, lane);
                        }
                        let batch = &batch;
                        match T::QUERY {
                            Query::Any => S::call(FlyReady::<_, true> { bunch, batch, leaves }),
                            Query::Closest => {
                                S::call(FlyReady::<_, false> { bunch, batch, leaves });
                            }
                        }
                    }
                }
            }
            entered += u64::from(met.count_ones());
            let mut better = false;
            for lane in lanes_of(bunch.hits()) {
                let hit = match T::QUERY {
                    Query::Any => Hit { t: 0.0, triangle: 0, u: 0.0, v: 0.0 },
                    Query::Closest => *bunch.hit(lane),
                };
                better |= way.improve(
                    &mut answers[lane],
                    (&rays[lane], lane),
                    &hit,
                    (geometry, instance),
                );
            }
            if better {
                way.all.stop = range(&way.stop)[1];
            }
        }
        entered
    }
}

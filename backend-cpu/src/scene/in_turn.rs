//! Watertight batches whose hits all count: many rays at a time, each in the tree over instances or in an instance of its own, which take their
//! steps in turn.
//!
//! A ray's way is the same in both trees. A step at a node puts the children that it meets on its stack, without a branch, and the last of them is
//! where it goes next: a node, a leaf, or the end of the stack. So while one ray's step waits for memory, or for what comes of its own operations, others
//! take theirs. Rays that have come to an instance wait until there are several, and go into their instances' spaces and are prepared together
//! ([`enter`]). Rays that have left an instance go on from the stack of the tree over instances. A better hit drops from that what lies behind it.
//!
//! Rays come to this as many at a time as are prepared at once, and those that go the same way are followed together ([`super::together`]).

mod at_top;
mod enter;
mod in_mesh;
pub(super) mod lane;

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::scene::{BuiltScene, SceneAnswer};
use splitplane_core::ray::{Culling, QueryOptions, Ray};
use splitplane_core::scene::{Placement, SceneOptions};

use super::found::Found;
use super::parts::Geometries;
use super::single::{Followed as Single, Following, SceneSingle};
use super::stream::{Followed, SceneStream};
use super::together::{Room, Together};
use super::top_walk::ALIKE_MOST;
use crate::layout::wide_node::DONE;
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};
use crate::trace::prepare::CHUNK;
use crate::trace::ray_state::RayState;
use at_top::AtTop;
use enter::{Enter, Group};
use in_mesh::{AtBlocks, AtNodes, Leave};
use lane::{LANES, Lane, TurnRay, Waiting, lanes_of};

/// Rays that have come to an instance wait until there are so many.
const MANY: u32 = 12;

/// Rays through a scene on one thread, of which [`serves`] is true.
pub(super) struct InTurn<'a, T, L> {
    pub(super) stream: SceneStream<'a, T>,
    pub(super) of: PhantomData<L>,
}

/// Whether these rays can be followed here, but for the accuracy and for which hits count.
pub(super) fn serves<T>(stream: &SceneStream<'_, T>) -> bool {
    let tree = stream.scene.top_tree();
    stream.rays.len() >= CHUNK
        && stream.options.ignore.is_none()
        && !tree.nodes().is_empty()
        && tree.reach() <= ALIKE_MOST
        && stream.geometries.are_listed()
}

/// What all rays have in common.
struct Shared<'a> {
    geometries: &'a Geometries<'a>,
    rays: &'a [Ray],
    options: &'a SceneOptions<'a>,
    placements: &'a [Option<Placement>],
    /// How geometries are asked, by culling.
    asked: [QueryOptions<'a>; 3],
    /// Entries of a stack in an instance, and of one in the tree over instances.
    room: usize,
    top_room: usize,
}

/// Rays that are ready to begin.
struct Supply {
    /// The first ray that is not loaded.
    next: usize,
    /// Where the loaded ones begin.
    start: usize,
    /// Those that have not begun, as bits.
    left: u32,
    ready: [TurnRay; CHUNK],
}

impl<'a, T: SceneAnswer, L: Found<'a>> Compiled for InTurn<'a, T, L> {
    type Output = Result<Followed, TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Followed, TryReserveError> {
        let SceneStream { scene, geometries, rays, answers, options } = self.stream;
        let tree = scene.top_tree();
        // A step may write as many entries more as a node has children, and dropping as many as a vector has lanes.
        let (room, top_room) = (geometries.stack, tree.stack() + 2 * S::N);
        let (mut stacks, mut lanes) = (Vec::new(), Vec::new());
        lengthen(&mut stacks, 2 * (room + top_room) * LANES, DONE)?;
        lanes.try_reserve_exact(LANES)?;
        for stack in stacks.chunks_exact_mut(2 * (room + top_room)) {
            let (top, own) = stack.split_at_mut(2 * top_room);
            lanes.push(Lane::<T, L>::new(top.as_mut_ptr(), own.as_mut_ptr()));
        }
        let lanes: &mut [Lane<'_, T, L>] = &mut lanes;
        let lanes = lanes.as_mut_ptr();
        let asked = [Culling::None, Culling::Back, Culling::Front]
            .map(|culling| options.of_geometry(culling, None, None));
        let placements = scene.all_placements();
        let shared = &Shared { geometries, rays, options, placements, asked, room, top_room };
        let mut together = Room::new(tree.stack(), room)?;
        let mut supply =
            boxed(|| Supply { next: 0, start: 0, left: 0, ready: [TurnRay::NONE; CHUNK] })?;
        let mut group = boxed(Group::new)?;
        let mut leaf_room = L::room();
        let (mut own, mut entered) = (Waiting::IDLE, 0);
        let waiting = &mut own;
        let top = (tree.nodes().as_ptr(), placements.as_ptr());
        loop {
            for number in lanes_of(core::mem::take(&mut waiting.done)) {
                // SAFETY: lanes are below LANES.
                let lane = unsafe { &mut *lanes.add(number) };
                if lane.index != RayState::NO_RAY {
                    answers[lane.index as usize] = lane.answer;
                    lane.index = RayState::NO_RAY;
                }
                while supply.left == 0 && supply.next < rays.len() {
                    let (answers, room) = (&mut *answers, &mut together);
                    let load = Load {
                        scene,
                        shared,
                        supply: &mut supply,
                        answers,
                        room,
                        of: PhantomData::<L>,
                    };
                    // SAFETY: the caller's contract.
                    entered += unsafe { S::call(load) };
                }
                if supply.left == 0 {
                    continue;
                }
                let place = supply.left.trailing_zeros() as usize;
                supply.left &= supply.left - 1;
                lane.turn_ray = supply.ready[place];
                lane.index = (supply.start + place) as u32;
                (lane.answer, lane.limit) = (T::NONE, rays[supply.start + place].t_max);
                (lane.top_child, lane.top_last) = (0, lane.top_stack);
                waiting.top |= 1 << number;
            }
            let (nodes, placements) = top;
            // SAFETY: the caller's contract; as many lanes; the tree's nodes, and stacks for it and for all meshes.
            unsafe {
                S::call(AtTop { lanes, waiting: &mut *waiting, nodes, placements, room: top_room });
                let Waiting { top, enter, done, node, block, leave } = *waiting;
                let others = top | node | block;
                if enter.count_ones() >= MANY || (enter != 0 && others == 0) {
                    let (group, entered) = (&mut *group, &mut entered);
                    S::call(Enter { lanes, waiting: &mut *waiting, shared, group, entered });
                } else if enter | others | done | leave == 0 {
                    break;
                }
                if waiting.node != 0 {
                    S::call(AtNodes { lanes, waiting: &mut *waiting, room });
                }
                if waiting.block != 0 {
                    let leaf_room = &mut leaf_room;
                    S::call(AtBlocks { lanes, waiting: &mut *waiting, room, leaf_room });
                }
                if waiting.leave != 0 {
                    S::call(Leave { lanes, waiting: &mut *waiting, rays, room: top_room });
                }
            }
        }
        together.give_back();
        Ok(Followed { entered, rejected: 0 })
    }
}

/// Loads the next rays. Answers those that go the same way, and those that are unusual.
struct Load<'a, 'b, T, L> {
    scene: &'b BuiltScene,
    shared: &'a Shared<'b>,
    supply: &'a mut Supply,
    answers: &'a mut [T],
    room: &'a mut Room,
    of: PhantomData<L>,
}

impl<'b, T: SceneAnswer, L: Found<'b>> Compiled for Load<'_, 'b, T, L> {
    /// How many instances they entered, all together.
    type Output = u64;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> u64 {
        let Load { scene, shared, supply, answers, room, of } = self;
        let Shared { geometries, options, .. } = *shared;
        let rest = &shared.rays[supply.next..];
        let count = rest.len().min(CHUNK);
        let mut last;
        let rays = match rest.first_chunk() {
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
        // SAFETY: the caller's contract.
        let usual = unsafe { room.way.load::<S>(rays, scene.top_tree().reach()) };
        if count == CHUNK && usual == u32::MAX {
            let (room, answers) = (&mut *room, &mut *answers);
            let asked = Together { scene, geometries, options, rays, answers, room, of };
            // SAFETY: the caller's contract.
            if let Some(entered) = unsafe { S::call(asked) } {
                return entered;
            }
        }
        let there = u32::MAX >> (CHUNK - count);
        for lane in lanes_of(there & !usual) {
            let ray = &rays[lane];
            let single = SceneSingle { scene, ray, options, set: geometries.set };
            // SAFETY: the caller's contract.
            let found = unsafe { S::call(Following(single, PhantomData)) };
            if let Single::Answer(answer) = found {
                answers[lane] = answer;
            }
        }
        supply.left = there & usual;
        // SAFETY: the caller's contract.
        unsafe { room.way.top_rays::<S>(&mut supply.ready) };
        0
    }
}

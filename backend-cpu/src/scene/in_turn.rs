//! Watertight batches whose hits all count: many rays at a time, each in the tree over instances or in an instance of its own, which take their
//! steps in turn.
//!
//! A ray's way is the same in both trees. A step at a node puts the children that it meets on its stack, without a branch, and the last of them is
//! where it goes next: a node, a leaf, or the end of the stack. So while one ray's step waits for memory, or for what comes of its own operations, others
//! take theirs. Rays that have come to an instance wait until there are several, and go into their instances' spaces and are prepared together
//! ([`enter`]). Rays that have left an instance go on from the stack of the tree over instances. A better hit drops from that what lies behind it.
//!
//! Rays that go the same way find together which instances they enter ([`supply`]).

mod at_top;
mod enter;
mod in_mesh;
mod lane;
mod supply;

use core::marker::PhantomData;
use std::collections::TryReserveError;

use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::ray::{Culling, QueryOptions, Ray};
use splitplane_core::scene::{Placement, SceneOptions};

use super::batch::{SceneBatch, Work};
use super::found::Found;
use super::parts::{Geometries, Listed};
use super::top_walk::ALIKE_MOST;
use crate::layout::wide_node::DONE;
use crate::memory::{boxed, lengthen};
use crate::simd::{Compiled, Simd};
use crate::trace::prepare::CHUNK;
use at_top::AtTop;
use enter::{Enter, Group};
use in_mesh::{AtBlocks, AtNodes, Leave};
use lane::{LANES, Lane, Waiting};
use supply::{Refill, Supply};

/// Rays that have come to an instance wait until there are so many.
const MANY: u32 = 12;

/// Rays through a scene on one thread, of which [`serves`] is true.
pub(super) struct InTurn<'a, T, L> {
    pub(super) batch: SceneBatch<'a, T>,
    pub(super) of: PhantomData<L>,
}

/// Whether these rays can be followed here, but for the accuracy and for which hits count.
pub(super) fn serves<T>(batch: &SceneBatch<'_, T>) -> bool {
    let tree = batch.scene.top_tree();
    batch.rays.len() >= CHUNK
        && batch.options.ignore.is_none()
        && !tree.nodes().is_empty()
        && tree.reach() <= ALIKE_MOST
        && batch.geometries.listed().is_some()
}

/// What all rays have in common.
struct Shared<'a> {
    geometries: &'a Geometries<'a>,
    /// All of them.
    listed: &'a [Listed<'a>],
    rays: &'a [Ray],
    options: &'a SceneOptions<'a>,
    placements: &'a [Option<Placement>],
    /// How geometries are asked, by culling.
    asked: [QueryOptions<'a>; 3],
    /// Entries of a stack in an instance, and of one in the tree over instances.
    room: usize,
    top_room: usize,
}

impl<'a, T: SceneAnswer, L: Found<'a>> Compiled for InTurn<'a, T, L> {
    type Output = Result<Work, TryReserveError>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Result<Work, TryReserveError> {
        let SceneBatch { scene, geometries, rays, answers, options } = self.batch;
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
        let listed = geometries.listed().unwrap_or_default();
        let shared =
            &Shared { geometries, listed, rays, options, placements, asked, room, top_room };
        let mut supply = Supply::new(tree.stack(), room)?;
        let mut group = boxed(Group::new)?;
        let mut leaf_room = L::room();
        let (mut own, mut entered) = (Waiting::IDLE, 0);
        let waiting = &mut own;
        let top = (tree.nodes().as_ptr(), placements.as_ptr());
        loop {
            if waiting.done != 0 {
                let (waiting, supply, answers) = (&mut *waiting, &mut supply, &mut *answers);
                let entered = &mut entered;
                // SAFETY: the caller's contract; as many lanes.
                unsafe {
                    S::call(Refill {
                        lanes,
                        waiting,
                        scene,
                        shared,
                        supply,
                        answers,
                        entered,
                        of: PhantomData::<L>,
                    });
                }
            }
            let (nodes, placements) = top;
            // SAFETY: the caller's contract; as many lanes; the tree's nodes, and stacks for it and for all meshes.
            unsafe {
                S::call(AtTop { lanes, waiting: &mut *waiting, nodes, placements, room: top_room });
                let Waiting { top, enter, done, node, block, leave } = *waiting;
                let others = top | node | block;
                if enter.count_ones() >= MANY || (enter != 0 && (others | done) == 0) {
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
        Ok(Work { entered, rejected: 0 })
    }
}

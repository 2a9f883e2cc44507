//! A ray under way through a scene, and what rays wait for.

use core::mem::offset_of;

use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::ray::QueryOptions;
use splitplane_core::scene::{GeometryId, InstanceId, TOP_WIDTH, TopNode};

use crate::layout::wide_node::{CacheLine, DONE, leaf_bit};
use crate::scene::turn_ray::TurnRay;
use crate::trace::block_test::BestHit;
use crate::trace::ray_state::RayState;

/// Rays under way.
pub(super) const LANES: usize = 32;

/// Where a node has the planes that rays of an octant meet first, and those that they meet last, in bytes.
#[derive(Clone, Copy)]
pub(super) struct Rows {
    pub(super) first: [u32; 3],
    pub(super) last: [u32; 3],
}

/// By [`TurnRay::octant`].
pub(super) static ROWS: [Rows; 8] = {
    let mut rows = [Rows { first: [0; 3], last: [0; 3] }; 8];
    let mut octant = 0;
    while octant < 8 {
        let mut axis = 0;
        while axis < 3 {
            let row = axis * size_of::<[f32; TOP_WIDTH]>();
            let (lo, hi) = (offset_of!(TopNode, lo) + row, offset_of!(TopNode, hi) + row);
            let (first, last) = if octant >> axis & 1 != 0 { (hi, lo) } else { (lo, hi) };
            (rows[octant].first[axis], rows[octant].last[axis]) = (first as u32, last as u32);
            axis += 1;
        }
        octant += 1;
    }
    rows
};

/// A ray under way.
#[repr(C, align(64))]
pub(super) struct Lane<'a, T, L> {
    /// In an instance.
    pub(super) ray_state: RayState,
    /// In the tree over instances.
    pub(super) turn_ray: TurnRay,
    /// Its place in the batch; [`RayState::NO_RAY`] for none.
    pub(super) index: u32,
    /// In the tree over instances: its current child, a node or an instance. The last entry of its stack, or the place before the first. The
    /// stack's children, and behind as many entries where the ray enters them.
    pub(super) top_child: u32,
    pub(super) top_last: *mut u32,
    pub(super) top_stack: *mut u32,
    /// The same in the instance.
    pub(super) child: u32,
    pub(super) instance: InstanceId,
    pub(super) last: *mut u32,
    pub(super) stack: *mut u32,
    pub(super) lines: *const CacheLine,
    /// `None` before the first instance.
    pub(super) leaves: Option<L>,
    pub(super) options: *const QueryOptions<'a>,
    pub(super) best: BestHit,
    pub(super) geometry: GeometryId,
    /// Up to where it is asked in instances.
    pub(super) limit: f32,
    pub(super) answer: T,
}

impl<T: SceneAnswer, L> Lane<'_, T, L> {
    /// No ray, with its stacks, whose lowest entries are the ends.
    pub(super) fn new(top_stack: *mut u32, stack: *mut u32) -> Self {
        Lane {
            ray_state: RayState::none(),
            turn_ray: TurnRay::NONE,
            index: RayState::NO_RAY,
            top_child: DONE,
            top_last: top_stack,
            top_stack,
            child: DONE,
            instance: InstanceId(0),
            last: stack,
            stack,
            lines: core::ptr::null(),
            leaves: None,
            options: core::ptr::null(),
            best: BestHit::NONE,
            geometry: GeometryId(0),
            limit: 0.0,
            answer: T::NONE,
        }
    }

    /// The last entry of the stack of the tree over instances becomes the current child, which is returned.
    ///
    /// # Safety
    /// The entry must have been written.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn pop_top(&mut self) -> u32 {
        // SAFETY: the caller's contract.
        self.top_child = unsafe { *self.top_last };
        self.top_last = self.top_last.wrapping_sub(1);
        self.top_child
    }
}

/// The lanes by what their rays wait for, a bit each.
#[derive(Clone, Copy)]
pub(super) struct Waiting {
    /// At a node of the tree over instances.
    pub(super) top: u32,
    /// To go into an instance.
    pub(super) enter: u32,
    /// For the next ray.
    pub(super) done: u32,
    /// At a node in an instance, at a block, and to leave the instance.
    pub(super) node: u32,
    pub(super) block: u32,
    pub(super) leave: u32,
}

impl Waiting {
    /// All lanes wait for a ray.
    pub(super) const IDLE: Waiting =
        Waiting { top: 0, enter: 0, done: u32::MAX >> (32 - LANES), node: 0, block: 0, leave: 0 };

    /// Puts a lane where a child of the tree over instances calls for, without a branch, since no predictor could get it right. An instance
    /// is to that tree what a block is to a mesh's.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn put_top(&mut self, lane: usize, child: u32) {
        let [node, leaf, done] = kinds(child);
        self.top |= node << lane;
        self.enter |= leaf << lane;
        self.done |= done << lane;
    }

    /// Puts a lane where a child in an instance calls for.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn put(&mut self, lane: usize, child: u32) {
        let [node, leaf, done] = kinds(child);
        self.node |= node << lane;
        self.block |= leaf << lane;
        self.leave |= done << lane;
    }
}

/// One of them is 1: for a node, a leaf, and [`DONE`].
#[cfg_attr(not(unoptimised), inline(always))]
fn kinds(child: u32) -> [u32; 3] {
    let (leaf, done) = (leaf_bit(child) as u32, u32::from(child == DONE));
    [leaf ^ 1, leaf ^ done, done]
}

/// The lanes of bits.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < LANES).then_some(lane)
    })
}

//! The turn of rays in the tree over instances: a step at a node of each.

use splitplane_core::backend::scene::SceneAnswer;
use splitplane_core::query::traverse::Query;
use splitplane_core::scene::{Placement, TOP_INSTANCE, TopNode};

use super::lane::{Lane, ROWS, Waiting, lanes_of};
use crate::layout::wide_node::leaf_bit;
use crate::simd::{Compiled, Simd, prefetch};

/// A step of all rays that are at nodes.
pub(super) struct AtTop<'a, 'b, T, L> {
    pub(super) lanes: *mut Lane<'b, T, L>,
    pub(super) waiting: &'a mut Waiting,
    pub(super) nodes: *const TopNode,
    pub(super) placements: *const Option<Placement>,
    /// Entries of a stack.
    pub(super) room: usize,
}

impl<T: SceneAnswer, L> Compiled for AtTop<'_, '_, T, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) {
        let AtTop { lanes, waiting, nodes, placements, room } = self;
        let mut left = *waiting;
        for number in lanes_of(core::mem::take(&mut left.top)) {
            // SAFETY: the caller's contract; lanes are below LANES.
            let lane = unsafe { &mut *lanes.add(number) };
            // SAFETY: the caller's contract; children are nodes of the tree; stacks have the space.
            let child = unsafe { step::<S::Eight, T, L>(lane, nodes, room) };
            let node = nodes.wrapping_add(child as usize) as usize;
            let placement = placements.wrapping_add((child & !TOP_INSTANCE) as usize) as usize;
            // Without a branch, since no predictor could get it right.
            let is_instance = 0usize.wrapping_sub(leaf_bit(child));
            let at = (node ^ ((node ^ placement) & is_instance)) as *const u8;
            for line in 0..size_of::<TopNode>() / 64 {
                prefetch(at.wrapping_add(64 * line));
            }
            left.put_top(number, child);
        }
        *waiting = left;
    }
}

/// Puts the children that the ray meets on the stack, the nearest last. That one becomes its child, which is returned.
///
/// # Safety
/// The processor must have the set, which must have eight lanes; the child must be a node of these; the stack must have space for eight more entries.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn step<S: Simd, T: SceneAnswer, L>(
    lane: &mut Lane<'_, T, L>,
    nodes: *const TopNode,
    room: usize,
) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let ray = &lane.turn_ray;
        let node = nodes.add(lane.top_child as usize);
        let rows = ROWS.get_unchecked(ray.octant as usize);
        let plane = |row: u32| S::load(node.cast::<u8>().add(row as usize).cast());
        // Where there is no child, the planes are in the wrong order, and nothing is met.
        let (mut near, mut far) = (S::splat(ray.enter), S::splat(ray.stop));
        for axis in 0..3 {
            let reciprocal = S::splat(ray.reciprocal[axis]);
            let enter = S::mul_sub(plane(rows.first[axis]), reciprocal, S::splat(ray.first[axis]));
            let leave = S::mul_sub(plane(rows.last[axis]), reciprocal, S::splat(ray.last[axis]));
            (near, far) = (S::max(enter, near), S::min(leave, far));
        }
        let near = S::max(S::min(near, S::splat(f32::MAX)), S::splat(-f32::MAX));
        let met = S::le(near, far);
        let (children, to) = ((&raw const (*node).children).cast::<u32>(), lane.top_last.add(1));
        let count = match T::QUERY {
            // Any order does, and a hit ends the ray: nothing is dropped by where it is entered.
            Query::Any => {
                let bits = S::bits(met);
                S::compress(S::load(children.cast()), bits, to.cast());
                bits.count_ones() as usize
            }
            Query::Closest => S::push_nearest_last(children, near, met, to, to.add(room).cast()),
        };
        // Read back from the stack; meanwhile others take their steps. Where nothing is met, it is the entry from before.
        lane.top_last = lane.top_last.add(count);
        lane.pop_top()
    }
}

//! One ray at a time: the reference loop over blocks.

use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::PreparedRay;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::traverse::Query;

use super::blocks::{Block, Blocks, WalkNode};
use super::leaf::{InstructionSet, Sifted, sift};
use super::sieve::ExactLane;

/// The best hit so far and what follows from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Best {
    /// The hit, in the caller's units.
    pub hit: Hit,
    /// Inner `t` beyond which nothing can precede it.
    pub stop: f32,
}

impl Best {
    /// No hit yet.
    pub const NONE: Best = Best { hit: Hit::MISS, stop: f32::INFINITY };
}

/// Tests the blocks of a leaf, `sifted` being room for the wide test. True when the query is answered: any hit was asked for and found.
///
/// # Safety
/// The processor must have `set`.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "one inner loop, cut out for reading")]
pub(crate) unsafe fn test_leaf<'a>(
    set: InstructionSet,
    ray: &PreparedRay,
    blocks: impl Iterator<Item = Block<'a>>,
    options: &QueryOptions,
    query: Query,
    sifted: &mut Sifted,
    best: &mut Best,
) -> bool {
    for block in blocks {
        let limit = ray.t_max.min(best.stop);
        if ray.wide {
            // Such exponents call for the scaled test.
            (sifted.met, sifted.unclear) = (0, (1 << block.count) - 1);
        } else {
            // SAFETY: the caller's contract.
            unsafe { sift(set, ray, &block, limit, options, sifted) }
        }
        let mut bits = sifted.met | sifted.unclear;
        while bits != 0 {
            let index = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let triangle = block.triangle(index);
            if options.ignore == Some(triangle) {
                continue;
            }
            let Some(found) = sifted.candidate(ray, &block, index, options) else { continue };
            let Some(t) = ray.outer_t::<Strict>(found.t) else { continue };
            let hit = Hit { t, triangle, u: found.u, v: found.v };
            if query == Query::Any {
                best.hit = hit;
                return true;
            }
            if hit.precedes(&best.hit) {
                *best = Best { hit, stop: ray.stop_after(found.t, t) };
            }
        }
    }
    false
}

/// Traces one ray from the root; `interval` is that of [`PreparedRay::enter`]. With `exact` that
/// decides what is hit, and has the answer in the end.
///
/// # Safety
/// The processor must have `set`.
#[inline(always)]
pub(crate) unsafe fn trace(
    set: InstructionSet,
    blocks: &Blocks,
    ray: &PreparedRay,
    interval: (f32, f32),
    options: &QueryOptions,
    query: Query,
    mut exact: Option<&mut ExactLane>,
) -> Hit {
    let (mut enter, mut exit) = interval;
    let back_to_front = query == Query::Any && far_end_is_solid(ray, interval);
    let mut best = Best::NONE;
    let mut sifted = Sifted::new();
    let mut stack = [(0u32, 0.0f32, 0.0f32); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        let WalkNode { word, tagged } = blocks.nodes[node as usize];
        let axis = (tagged & 3) as usize;
        if axis < 3 {
            let (least, greatest) = ray.plane_interval::<Strict>(axis, f32::from_bits(word));
            let (left, right) = (node + 1, tagged >> WalkNode::SHIFT);
            let left_empty = tagged & WalkNode::LEFT_EMPTY != 0;
            let right_empty = tagged & WalkNode::RIGHT_EMPTY != 0;
            let backwards = ray.direction[axis] < 0.0;
            let (near, far) = if backwards { (right, left) } else { (left, right) };
            let (near_empty, far_empty) =
                if backwards { (right_empty, left_empty) } else { (left_empty, right_empty) };
            let before = greatest < enter;
            let behind = !before && least > exit;
            let (far_enter, near_exit) = if before || behind {
                (enter, exit)
            } else {
                (least.max(enter), exit.min(greatest))
            };
            let visit_near = !before && !near_empty;
            let visit_far = !behind && !far_empty;
            match (visit_near, visit_far) {
                (true, true) if back_to_front => {
                    stack[top] = (near, enter, near_exit);
                    top += 1;
                    (node, enter) = (far, far_enter);
                    continue;
                }
                (true, true) => {
                    stack[top] = (far, far_enter, exit);
                    top += 1;
                    (node, exit) = (near, near_exit);
                    continue;
                }
                (true, false) => {
                    (node, exit) = (near, near_exit);
                    continue;
                }
                (false, true) => {
                    (node, enter) = (far, far_enter);
                    continue;
                }
                (false, false) => {}
            }
        } else {
            let leaf = blocks.leaf(word, tagged >> WalkNode::SHIFT);
            // SAFETY: the caller's contract.
            let answered = unsafe {
                match exact.as_deref_mut() {
                    Some(exact) => exact.test_leaf(set, ray, leaf, options, query, &mut best.stop),
                    None => test_leaf(set, ray, leaf, options, query, &mut sifted, &mut best),
                }
            };
            if answered {
                return best.hit;
            }
        }
        loop {
            if top == 0 {
                return best.hit;
            }
            top -= 1;
            (node, enter, exit) = stack[top];
            if enter <= best.stop {
                break;
            }
        }
    }
}

/// Whether a ray probably ends at something solid: it starts within the bounds and runs out of them.
/// Such rays, indoors, meet the walls first when they ask for any hit from the far end.
#[inline]
pub(crate) fn far_end_is_solid(ray: &PreparedRay, (enter, exit): (f32, f32)) -> bool {
    enter <= ray.t_min && exit < ray.t_max
}

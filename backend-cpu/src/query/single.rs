//! One ray at a time: the reference loop over blocks.

use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PreparedRay, stop_after};
use splitplane_core::node::NodeKind;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::traverse::Query;

use super::blocks::{Block, Blocks};
use super::leaf::{InstructionSet, decide, sift};

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

/// Tests the blocks of a leaf. True when the query is answered: any hit was asked for and found.
///
/// # Safety
/// The processor must have `set`.
#[inline(always)]
pub(crate) unsafe fn test_leaf<'a>(
    set: InstructionSet,
    ray: &PreparedRay,
    blocks: impl Iterator<Item = Block<'a>>,
    options: &QueryOptions,
    query: Query,
    best: &mut Best,
) -> bool {
    for block in blocks {
        let limit = ray.t_max.min(best.stop);
        let mut bits = if ray.wide {
            // Such exponents call for the scaled test.
            (1 << block.count) - 1
        } else {
            // SAFETY: the caller's contract.
            unsafe { sift(set, ray, &block, limit, options.accuracy) }
        };
        while bits != 0 {
            let index = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let triangle = block.triangle(index);
            if options.ignore == Some(triangle) {
                continue;
            }
            let Some(found) = decide(ray, &block.corners(index), options) else { continue };
            let t = ray.outer_t::<Strict>(found.t);
            let hit = Hit { t, triangle, u: found.u, v: found.v };
            if query == Query::Any {
                best.hit = hit;
                return true;
            }
            if hit.precedes(&best.hit) {
                *best = Best { hit, stop: stop_after(found.t) };
            }
        }
    }
    false
}

/// Traces one ray from the root; `interval` is that of [`PreparedRay::enter`].
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
) -> Hit {
    let (mut enter, mut exit) = interval;
    let mut best = Best::NONE;
    let mut stack = [(0u32, 0.0f32, 0.0f32); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        match blocks.nodes[node as usize].kind() {
            NodeKind::Interior { axis, split, right } => {
                let axis = axis.index();
                let (least, greatest) = ray.plane_interval::<Strict>(axis, split);
                let backwards = ray.direction[axis] < 0.0;
                let (near, far) = if backwards { (right, node + 1) } else { (node + 1, right) };
                if greatest < enter {
                    node = far;
                } else if least > exit {
                    node = near;
                } else {
                    stack[top] = (far, least.max(enter), exit);
                    top += 1;
                    node = near;
                    exit = exit.min(greatest);
                }
                continue;
            }
            NodeKind::Leaf { first, count } => {
                // SAFETY: the caller's contract.
                if count > 0
                    && unsafe {
                        test_leaf(set, ray, blocks.leaf(first, count), options, query, &mut best)
                    }
                {
                    return best.hit;
                }
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

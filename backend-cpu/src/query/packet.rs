//! Coherent rays together: 16 rays at one node (AVX-512).
//!
//! All rays of a packet go through the same nodes in the same order, each with its own interval, and
//! drop out of subtrees that they do not meet. A step costs a few instructions for all 16, where
//! [`super::lanes`] must fetch 16 nodes; it pays as soon as two rays share their way. Only rays of
//! one octant form a packet: so each ray visits what it would visit alone, in the same order.

use core::arch::x86_64::*;

use splitplane_core::config::MAX_DEPTH;
use splitplane_core::intersect::{PLANE_SLACK, PreparedRay, SceneScale};
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_core::traverse::Query;

use super::blocks::{Blocks, WalkNode};
use super::leaf::InstructionSet;
use super::prepare::{LANES, Lanes, PreparedRays};
use super::single::{Best, test_leaf};

/// Fewest rays worth a packet.
const FEWEST: u32 = 4;
/// Directions of a packet differ by less than this on all axes together; the largest component of
/// each is between 1 and 2.
const DIRECTION_SPREAD: f32 = 0.6;
/// Origins of a packet differ by less than this part of the scene's extents together.
const ORIGIN_SPREAD: f32 = 0.2;

/// 16 numbers in one cache line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Row(Lanes<f32>);

/// A far child, the rays that may meet it, and their intervals in it.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Entry {
    enter: Row,
    exit: Row,
    node: u32,
    rays: __mmask16,
}

/// Memory of a packet, kept between packets.
pub(crate) struct Packet {
    stack: Vec<Entry>,
    rays: Vec<PreparedRay>,
}

impl Packet {
    /// Memory for one packet.
    pub fn new() -> Packet {
        let row = Row([0.0; LANES]);
        let entry = Entry { enter: row, exit: row, node: 0, rays: 0 };
        Packet {
            stack: vec![entry; MAX_DEPTH as usize + 1],
            rays: vec![PreparedRays::new().ray(0); LANES],
        }
    }

    /// Whether these rays are worth tracing as one packet: many, of one octant, side by side.
    pub fn is_worthwhile(ready: &PreparedRays, alive: __mmask16, scene: &SceneScale) -> bool {
        if alive.count_ones() < FEWEST {
            return false;
        }
        let (mut directions, mut origins, mut extents) = (0.0, 0.0, 0.0);
        let mut same_octant = true;
        for axis in 0..3 {
            let (mut d, mut o) = ((f32::MAX, -f32::MAX), (f32::MAX, -f32::MAX));
            let mut backwards: __mmask16 = 0;
            for lane in 0..LANES {
                let here = alive >> lane & 1 == 1;
                let pick = |x: f32, other: f32| if here { x } else { other };
                d.0 = pick(ready.direction[axis][lane], d.0).min(d.0);
                d.1 = pick(ready.direction[axis][lane], d.1).max(d.1);
                o.0 = pick(ready.origin[axis][lane], o.0).min(o.0);
                o.1 = pick(ready.origin[axis][lane], o.1).max(o.1);
                backwards |= __mmask16::from(ready.direction[axis][lane] < 0.0) << lane;
            }
            same_octant &= backwards & alive == 0 || backwards & alive == alive;
            directions += d.1 - d.0;
            origins += o.1 - o.0;
            extents += scene.bounds.hi[axis] - scene.bounds.lo[axis];
        }
        same_octant && directions < DIRECTION_SPREAD && origins < ORIGIN_SPREAD * extents
    }

    /// Traces the rays of a mask; answers of others are not written.
    ///
    /// # Safety
    /// The processor must have [`InstructionSet::Avx512`]; the rays must be of one octant.
    #[target_feature(enable = "avx512f,avx512dq")]
    pub unsafe fn trace(
        &mut self,
        blocks: &Blocks,
        ready: &PreparedRays,
        rays: __mmask16,
        options: &QueryOptions,
        query: Query,
    ) -> [Hit; LANES] {
        let mut best = [Best::NONE; LANES];
        let mut stop = Row([f32::INFINITY; LANES]);
        let one = rays.trailing_zeros() as usize;
        let backwards = [0, 1, 2].map(|axis| ready.direction[axis][one] < 0.0);
        // Rays that end at something solid go back to front, if all do; see `far_end_is_solid`.
        let mut back_to_front = query == Query::Any;
        for lane in 0..LANES {
            let solid =
                ready.enter[lane] <= ready.t_min[lane] && ready.exit[lane] < ready.t_max[lane];
            back_to_front &= solid || rays >> lane & 1 == 0;
        }
        let mut made: __mmask16 = 0;
        let mut open = rays;
        let mut active = rays;
        let (mut enter, mut exit) = (load(&ready.enter), load(&ready.exit));
        let mut node = 0;
        let mut top = 0;
        loop {
            let WalkNode { word, tagged } = blocks.nodes[node as usize];
            let axis = (tagged & 3) as usize;
            let mut go_back = true;
            if axis < 3 {
                let split = _mm512_set1_ps(f32::from_bits(word));
                let distance = _mm512_sub_ps(split, load(&ready.origin[axis]));
                let t = _mm512_mul_ps(distance, load(&ready.reciprocal[axis]));
                let part = _mm512_mul_ps(_mm512_abs_ps(t), _mm512_set1_ps(PLANE_SLACK));
                let error = _mm512_add_ps(part, load(&ready.slack[axis]));
                let (least, greatest) = (_mm512_sub_ps(t, error), _mm512_add_ps(t, error));
                let (left, right) = (node + 1, tagged >> WalkNode::SHIFT);
                let left_empty = tagged & WalkNode::LEFT_EMPTY != 0;
                let right_empty = tagged & WalkNode::RIGHT_EMPTY != 0;
                let (near, far, near_empty, far_empty) = if backwards[axis] {
                    (right, left, right_empty, left_empty)
                } else {
                    (left, right, left_empty, right_empty)
                };
                let mut to_near = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(active, greatest, enter);
                let mut to_far = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(active, least, exit);
                to_near = if near_empty { 0 } else { to_near };
                to_far = if far_empty { 0 } else { to_far };
                let far_enter = _mm512_max_ps(least, enter);
                let near_exit = _mm512_min_ps(greatest, exit);
                if to_near != 0 && to_far != 0 {
                    // One entry a level at most, and a valid tree has at most MAX_DEPTH levels.
                    let entry = &mut self.stack[top];
                    top += 1;
                    if back_to_front {
                        store(&mut entry.enter, enter);
                        store(&mut entry.exit, near_exit);
                        (entry.node, entry.rays) = (near, to_near);
                        (node, active, enter) = (far, to_far, far_enter);
                    } else {
                        store(&mut entry.enter, far_enter);
                        store(&mut entry.exit, exit);
                        (entry.node, entry.rays) = (far, to_far);
                        (node, active, exit) = (near, to_near, near_exit);
                    }
                    go_back = false;
                } else if to_near != 0 {
                    (node, active, exit) = (near, to_near, near_exit);
                    go_back = false;
                } else if to_far != 0 {
                    (node, active, enter) = (far, to_far, far_enter);
                    go_back = false;
                }
            } else {
                let count = tagged >> WalkNode::SHIFT;
                let mut rest = active;
                while rest != 0 {
                    let lane = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    if made >> lane & 1 == 0 {
                        self.rays[lane] = ready.ray(lane);
                        made |= 1 << lane;
                    }
                    let leaf = blocks.leaf(word, count);
                    let ray = &self.rays[lane];
                    let set = InstructionSet::Avx512;
                    // SAFETY: the instruction set, by contract.
                    if unsafe { test_leaf(set, ray, leaf, options, query, &mut best[lane]) } {
                        open &= !(1 << lane);
                    }
                    stop.0[lane] = best[lane].stop;
                }
            }
            if go_back {
                loop {
                    if top == 0 {
                        return best.map(|best| best.hit);
                    }
                    top -= 1;
                    let entry = &self.stack[top];
                    enter = load(&entry.enter.0);
                    active = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(
                        entry.rays & open,
                        enter,
                        load(&stop.0),
                    );
                    if active != 0 {
                        exit = load(&entry.exit.0);
                        node = entry.node;
                        break;
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn load(lanes: &Lanes<f32>) -> __m512 {
    // SAFETY: 16 floats; only code that has AVX-512 calls this.
    unsafe { _mm512_loadu_ps(lanes.as_ptr()) }
}

#[inline(always)]
fn store(row: &mut Row, value: __m512) {
    // SAFETY: a row is 64 aligned bytes; only code that has AVX-512 calls this.
    unsafe { _mm512_store_ps(row.0.as_mut_ptr(), value) }
}

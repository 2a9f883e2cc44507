//! Coherent rays together: 16 rays at one node (AVX-512).
//!
//! All rays of a packet go through the same nodes in the same order, each with its own interval, and
//! drop out of subtrees that they do not meet. A step costs a few instructions for all 16, where
//! [`super::lanes`] must fetch 16 nodes; it pays as soon as two rays share their way. Only rays of
//! one octant form a packet: so each ray visits what it would visit alone, in the same order.

use core::arch::x86_64::*;

use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::Strict;
use splitplane_core::config::MAX_DEPTH;
use splitplane_core::exact::{self, ExactRay};
use splitplane_core::intersect::{
    EDGE_LEAST, INTERPOLATION_ERROR, PLANE_SLACK, PreparedRay, STOP_SLACK, SceneScale,
};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::{Block, Blocks, WalkNode};
use super::leaf::{self, InstructionSet, Sifted, decide};
use super::prepare::{LANES, Lanes, PreparedRays};
use super::sieve::{self, CORNER_ERROR, DEPTH_ERROR, EDGE_ERROR, Reach, TINY};

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
    /// Rays as the scalar tests take them, made when first needed.
    rays: Vec<PreparedRay>,
    made: __mmask16,
    /// Accuracy `exact` only: the rays as given, and what they hit.
    exact: Vec<(ExactRay, exact::Best)>,
    /// What the sieve must know of them.
    reach: Reaches,
}

impl Packet {
    /// Memory for one packet.
    pub fn new() -> Packet {
        let row = Row([0.0; LANES]);
        let entry = Entry { enter: row, exit: row, node: 0, rays: 0 };
        Packet {
            stack: vec![entry; MAX_DEPTH as usize + 1],
            rays: vec![PreparedRays::new().ray(0); LANES],
            made: 0,
            exact: vec![(NO_RAY, exact::Best::default()); LANES],
            reach: Reaches { edge: row, least: row, t_min: row, t_max: row },
        }
    }

    /// Whether these rays are worth tracing as one packet: many, of one octant, side by side.
    ///
    /// # Safety
    /// The processor must have [`InstructionSet::Avx512`].
    #[target_feature(enable = "avx512f,avx512dq")]
    pub unsafe fn is_worthwhile(
        ready: &PreparedRays,
        alive: __mmask16,
        scene: &SceneScale,
    ) -> bool {
        if alive.count_ones() < FEWEST {
            return false;
        }
        // Most groups of incoherent rays fall at the first axis.
        for axis in 0..3 {
            let zero = _mm512_setzero_ps();
            let d = load(&ready.direction[axis]);
            let backwards = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(alive, d, zero);
            if backwards != 0 && backwards != alive {
                return false;
            }
        }
        let spread = |lanes: &Lanes<f32>| {
            let x = load(lanes);
            _mm512_mask_reduce_max_ps(alive, x) - _mm512_mask_reduce_min_ps(alive, x)
        };
        let (mut directions, mut origins, mut extents) = (0.0, 0.0, 0.0);
        for axis in 0..3 {
            directions += spread(&ready.direction[axis]);
            origins += spread(&ready.origin[axis]);
            extents += scene.bounds.hi[axis] - scene.bounds.lo[axis];
        }
        directions < DIRECTION_SPREAD && origins < ORIGIN_SPREAD * extents
    }

    /// Traces the rays of a mask; answers of others are not written. `given` are the rays that were made
    /// ready.
    ///
    /// # Safety
    /// The processor must have [`InstructionSet::Avx512`]; the rays must be of one octant.
    #[target_feature(enable = "avx512f,avx512dq")]
    #[allow(clippy::too_many_arguments, reason = "what a batch has at hand")]
    pub unsafe fn trace(
        &mut self,
        blocks: &Blocks,
        scene: &SceneScale,
        given: &[Ray],
        ready: &PreparedRays,
        rays: __mmask16,
        options: &QueryOptions,
        query: Query,
    ) -> [Hit; LANES] {
        let mut best = Bests::new();
        let exactly = options.accuracy == Accuracy::Exact;
        if exactly {
            self.reach.fill(ready, &scene.bounds);
            for (ray, exact) in given.iter().zip(&mut self.exact) {
                // Rays that can hit nothing are not in the mask.
                *exact = (ExactRay::new(ray).unwrap_or(NO_RAY), exact::Best::default());
            }
        }
        let one = rays.trailing_zeros() as usize;
        let backwards = [0, 1, 2].map(|axis| ready.direction[axis][one] < 0.0);
        // Rays that end at something solid go back to front, if all do; see `far_end_is_solid`.
        let mut back_to_front = query == Query::Any;
        for lane in 0..LANES {
            let solid =
                ready.enter[lane] <= ready.t_min[lane] && ready.exit[lane] < ready.t_max[lane];
            back_to_front &= solid || rays >> lane & 1 == 0;
        }
        let axes = ready.ray(one).axes;
        let mut same_shear = options.accuracy != Accuracy::Fast;
        for lane in 0..LANES {
            same_shear &= ready.largest[lane] == ready.largest[one] || rays >> lane & 1 == 0;
        }
        self.made = 0;
        let mut sifted = Sifted::new();
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
                for block in blocks.leaf(word, count) {
                    let (few, many) = (block.count as u32, active.count_ones());
                    if same_shear && few * COST_OF_A_TRIANGLE <= many * COST_OF_A_RAY {
                        for index in 0..block.count {
                            let tested = active & open;
                            // SAFETY: the instruction set, by contract.
                            let undecided = unsafe {
                                if exactly {
                                    let reach = &self.reach;
                                    let left =
                                        sift(ready, reach, axes, &block, index, tested, &best.stop);
                                    let sure = match query {
                                        Query::Any => best.take_sure(&left, &block, index, options),
                                        Query::Closest => 0,
                                    };
                                    left.perhaps & !sure
                                } else {
                                    best.test(ready, axes, &block, index, tested, options, query)
                                }
                            };
                            self.decide(
                                ready,
                                undecided,
                                &block,
                                1 << index,
                                options,
                                query,
                                &mut best,
                            );
                        }
                    } else {
                        let mut rest = active & open;
                        while rest != 0 {
                            let lane = rest.trailing_zeros() as usize;
                            rest &= rest - 1;
                            let stop = best.stop.0[lane];
                            let set = InstructionSet::Avx512;
                            // SAFETY: as above.
                            let bits = unsafe {
                                if exactly {
                                    let reach = self.reach.of(lane);
                                    let limit = reach.t_max.min(stop);
                                    let ray = self.ray(ready, lane);
                                    sieve::sift(set, ray, &reach, &block, limit)
                                } else {
                                    let ray = self.ray(ready, lane);
                                    let limit = ray.t_max.min(stop);
                                    leaf::sift(set, ray, &block, limit, options, &mut sifted);
                                    sifted.met | sifted.unclear
                                }
                            };
                            self.decide(ready, 1 << lane, &block, bits, options, query, &mut best);
                        }
                    }
                    if query == Query::Any {
                        open &= !best.hit_lanes();
                        if open == 0 {
                            return self.hits(&best, rays, exactly, query);
                        }
                    }
                }
            }
            if go_back {
                loop {
                    if top == 0 {
                        return self.hits(&best, rays, exactly, query);
                    }
                    top -= 1;
                    let entry = &self.stack[top];
                    enter = load(&entry.enter.0);
                    active = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(
                        entry.rays & open,
                        enter,
                        load(&best.stop.0),
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

impl Packet {
    /// The answers of the rays of a mask.
    fn hits(&self, best: &Bests, rays: __mmask16, exactly: bool, query: Query) -> [Hit; LANES] {
        core::array::from_fn(|lane| match query {
            Query::Closest if exactly && rays >> lane & 1 != 0 => self.exact[lane].1.hit(),
            _ => best.hit(lane),
        })
    }

    #[inline(always)]
    fn ray(&mut self, ready: &PreparedRays, lane: usize) -> &PreparedRay {
        if self.made >> lane & 1 == 0 {
            self.rays[lane] = ready.ray(lane);
            self.made |= 1 << lane;
        }
        &self.rays[lane]
    }

    /// Decides triangles of a block (`bits`) for some rays by the reference test, or exactly.
    #[allow(clippy::too_many_arguments, reason = "one inner loop, cut out for reading")]
    fn decide(
        &mut self,
        ready: &PreparedRays,
        mut lanes: __mmask16,
        block: &Block<'_>,
        bits: u32,
        options: &QueryOptions,
        query: Query,
        best: &mut Bests,
    ) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let mut rest = bits;
            if options.accuracy == Accuracy::Exact {
                let (ray, exact) = &mut self.exact[lane];
                while rest != 0 {
                    let index = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    if sieve::decide(ray, exact, block, index, options, query) {
                        best.triangle[lane] = block.triangle(index);
                        best.stop.0[lane] = sieve::inner_stop(exact.stop(), ready.exponent[lane]);
                        if query == Query::Any {
                            break;
                        }
                    }
                }
                continue;
            }
            let ray = *self.ray(ready, lane);
            while rest != 0 {
                let index = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let triangle = block.triangle(index);
                if options.ignore == Some(triangle) {
                    continue;
                }
                let Some(found) = decide(&ray, &block.corners(index), options) else { continue };
                let Some(t) = ray.outer_t::<Strict>(found.t) else { continue };
                let hit = Hit { t, triangle, u: found.u, v: found.v };
                if hit.precedes(&best.hit(lane)) {
                    best.set(lane, hit, ray.stop_after(found.t, t));
                }
                if query == Query::Any {
                    break;
                }
            }
        }
    }
}

/// Instructions for one triangle against all rays, and for one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 6;
const COST_OF_A_RAY: u32 = 8;

/// The best hits so far, by field.
struct Bests {
    t: Row,
    triangle: [u32; LANES],
    u: Row,
    v: Row,
    /// Inner `t` beyond which nothing can precede them.
    stop: Row,
}

impl Bests {
    fn new() -> Bests {
        Bests {
            t: Row([Hit::MISS.t; LANES]),
            triangle: [Hit::MISS.triangle; LANES],
            u: Row([0.0; LANES]),
            v: Row([0.0; LANES]),
            stop: Row([f32::INFINITY; LANES]),
        }
    }

    #[inline(always)]
    fn hit(&self, lane: usize) -> Hit {
        Hit {
            t: self.t.0[lane],
            triangle: self.triangle[lane],
            u: self.u.0[lane],
            v: self.v.0[lane],
        }
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, hit: Hit, stop: f32) {
        (self.t.0[lane], self.triangle[lane]) = (hit.t, hit.triangle);
        (self.u.0[lane], self.v.0[lane], self.stop.0[lane]) = (hit.u, hit.v, stop);
    }

    /// Answers the rays that certainly hit a triangle, where any hit will do; which they are.
    fn take_sure(
        &mut self,
        sifted: &Sieved,
        block: &Block<'_>,
        index: usize,
        options: &QueryOptions,
    ) -> __mmask16 {
        let triangle = block.triangle(index);
        let mut rays = match options.culling {
            _ if options.ignore == Some(triangle) => 0,
            Culling::None => sifted.front | sifted.back,
            Culling::Back => sifted.front,
            Culling::Front => sifted.back,
        };
        let sure = rays;
        while rays != 0 {
            let lane = rays.trailing_zeros() as usize;
            rays &= rays - 1;
            self.triangle[lane] = triangle;
        }
        sure
    }

    /// Lanes that have a hit.
    fn hit_lanes(&self) -> __mmask16 {
        let mut lanes = 0;
        for lane in 0..LANES {
            lanes |= __mmask16::from(self.triangle[lane] != Hit::MISS.triangle) << lane;
        }
        lanes
    }

    /// The watertight test of one triangle against the rays of a mask, by the operations of the
    /// reference in their order; keeps what precedes. Returns the rays for which the triangle is seen
    /// at too grazing an angle or from too near for interpolation, for the reference to decide.
    ///
    /// # Safety
    /// The processor must have [`InstructionSet::Avx512`]; all rays must have these axes.
    #[target_feature(enable = "avx512f,avx512dq")]
    #[inline]
    #[allow(clippy::too_many_arguments, reason = "one inner loop, cut out for reading")]
    unsafe fn test(
        &mut self,
        ready: &PreparedRays,
        [kx, ky, kz]: [usize; 3],
        block: &Block<'_>,
        index: usize,
        rays: __mmask16,
        options: &QueryOptions,
        query: Query,
    ) -> __mmask16 {
        let from = |corner: usize, axis: usize| {
            let x = _mm512_set1_ps(block.words[(corner * 3 + axis) * block.stride + index]);
            _mm512_sub_ps(x, load(&ready.origin[axis]))
        };
        let shear = [load(&ready.shear[0]), load(&ready.shear[1]), load(&ready.shear[2])];
        let corner = |corner: usize| {
            let (x, y, z) = (from(corner, kx), from(corner, ky), from(corner, kz));
            let flat_x = _mm512_sub_ps(x, _mm512_mul_ps(shear[0], z));
            let flat_y = _mm512_sub_ps(y, _mm512_mul_ps(shear[1], z));
            (x, y, z, flat_x, flat_y)
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let edge = |p: (__m512, __m512), q: (__m512, __m512)| {
            let value = _mm512_sub_ps(_mm512_mul_ps(p.0, q.1), _mm512_mul_ps(p.1, q.0));
            let least = _mm512_set1_ps(EDGE_LEAST);
            let counts = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(_mm512_abs_ps(value), least);
            _mm512_maskz_mov_ps(counts, value)
        };
        let (u, v, w) = (
            edge((c.3, c.4), (b.3, b.4)),
            edge((a.3, a.4), (c.3, c.4)),
            edge((b.3, b.4), (a.3, a.4)),
        );
        let zero = _mm512_setzero_ps();
        let least = |x, y, z| _mm512_min_ps(_mm512_min_ps(x, y), z);
        let most = |x, y, z| _mm512_max_ps(_mm512_max_ps(x, y), z);
        let below = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(least(u, v, w), zero);
        let above = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(most(u, v, w), zero);
        let mut left = rays & !(below & above);
        if left == 0 {
            return 0;
        }
        // Within the bounds of the sheared corners.
        for (p, q, r) in [(a.3, b.3, c.3), (a.4, b.4, c.4)] {
            left &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(least(p, q, r), zero);
            left &= _mm512_cmp_ps_mask::<_CMP_GE_OQ>(most(p, q, r), zero);
        }
        let det = _mm512_add_ps(_mm512_add_ps(u, v), w);
        left &= match options.culling {
            Culling::None => _mm512_cmp_ps_mask::<_CMP_NEQ_OQ>(det, zero),
            Culling::Back => _mm512_cmp_ps_mask::<_CMP_GT_OQ>(det, zero),
            Culling::Front => _mm512_cmp_ps_mask::<_CMP_LT_OQ>(det, zero),
        };
        let depths = [a.2, b.2, c.2].map(|z| _mm512_mul_ps(shear[2], z));
        let nearest = least(depths[0], depths[1], depths[2]);
        let farthest = most(depths[0], depths[1], depths[2]);
        let (t_min, t_max) = (load(&ready.t_min), load(&ready.t_max));
        left &= _mm512_cmp_ps_mask::<_CMP_GE_OQ>(farthest, t_min);
        left &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(nearest, t_max);
        left &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(nearest, load(&self.stop.0));
        let triangle = block.triangle(index);
        if left == 0 || options.ignore == Some(triangle) {
            return 0;
        }
        let sum = _mm512_add_ps(
            _mm512_add_ps(_mm512_mul_ps(u, depths[0]), _mm512_mul_ps(v, depths[1])),
            _mm512_mul_ps(w, depths[2]),
        );
        let magnitude = |x, y, z| most(_mm512_abs_ps(x), _mm512_abs_ps(y), _mm512_abs_ps(z));
        let reach =
            most(magnitude(a.0, a.1, a.2), magnitude(b.0, b.1, b.2), magnitude(c.0, c.1, c.2));
        let width = _mm512_max_ps(magnitude(a.3, b.3, c.3), magnitude(a.4, b.4, c.4));
        let spread = _mm512_sub_ps(farthest, nearest);
        let disorder = _mm512_mul_ps(_mm512_mul_ps(reach, width), spread);
        let enough = _mm512_mul_ps(_mm512_set1_ps(8.0), _mm512_abs_ps(sum));
        let fine = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(left, disorder, enough);
        // As in the reference: most such triangles are the one that the ray starts on.
        let part = _mm512_div_ps(disorder, _mm512_abs_ps(det));
        let error = _mm512_mul_ps(part, _mm512_set1_ps(INTERPOLATION_ERROR));
        let interpolated = _mm512_div_ps(sum, det);
        let before = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_add_ps(interpolated, error), t_min);
        let behind = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(_mm512_sub_ps(interpolated, error), t_max);
        let undecided = left & !fine & !before & !behind;

        let inner = _mm512_min_ps(_mm512_max_ps(interpolated, nearest), farthest);
        let mut kept = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(fine, inner, t_min);
        kept = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(kept, inner, t_max);
        // The caller's t: packets hold no moved rays, and exponents within one power of two.
        let bias = _mm512_set1_epi32(127);
        // SAFETY: 16 words.
        let exponent = unsafe { _mm512_loadu_si512(ready.exponent.as_ptr().cast()) };
        let power = _mm512_slli_epi32::<23>(_mm512_sub_epi32(bias, exponent));
        let t = _mm512_mul_ps(inner, _mm512_castsi512_ps(power));
        let t =
            _mm512_min_ps(_mm512_max_ps(t, _mm512_set1_ps(-f32::MAX)), _mm512_set1_ps(f32::MAX));
        let t = snapped(t);
        kept = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(kept, load(&ready.limits[0]), t);
        kept = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(kept, t, load(&ready.limits[1]));
        let best_t = load(&self.t.0);
        // SAFETY: 16 words.
        let best_triangle = unsafe { _mm512_loadu_si512(self.triangle.as_ptr().cast()) };
        let number = _mm512_set1_epi32(triangle as i32);
        let nearer = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(kept, t, best_t);
        let tied = _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(kept, t, best_t);
        let lower = _mm512_mask_cmplt_epu32_mask(tied, number, best_triangle);
        let take = nearer | lower;
        if take != 0 {
            // SAFETY: 16 words.
            unsafe {
                let to = self.triangle.as_mut_ptr().cast();
                _mm512_mask_storeu_epi32(to, take, number);
            }
            let put = |row: &mut Row, value| {
                let kept = load(&row.0);
                store(row, _mm512_mask_mov_ps(kept, take, value));
            };
            put(&mut self.t, t);
            put(&mut self.u, snapped(_mm512_div_ps(v, det)));
            put(&mut self.v, snapped(_mm512_div_ps(w, det)));
            let slack = _mm512_mul_ps(_mm512_abs_ps(inner), _mm512_set1_ps(STOP_SLACK));
            let stop = _mm512_add_ps(inner, slack);
            // As `PreparedRay::stop_after`: what is flushed to 0 or clamped is equal outside.
            let back = _mm512_slli_epi32::<23>(_mm512_add_epi32(bias, exponent));
            let least = _mm512_set1_ps(f32::MIN_POSITIVE * (1.0 + STOP_SLACK));
            let least = _mm512_mul_ps(least, _mm512_castsi512_ps(back));
            let most = _mm512_set1_ps(f32::MAX);
            let clamped = _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(_mm512_abs_ps(t), most);
            let stop = _mm512_max_ps(stop, least);
            let infinity = _mm512_set1_ps(f32::INFINITY);
            put(&mut self.stop, _mm512_mask_mov_ps(stop, clamped, infinity));
        }
        // Any hit needs no second one.
        if query == Query::Any { undecided & !kept } else { undecided }
    }
}

/// A ray of no packet.
const NO_RAY: ExactRay =
    ExactRay { origin: [0.0; 3], direction: [1.0, 0.0, 0.0], t_min: 1.0, t_max: 0.0 };

/// [`Reach`] of 16 rays.
struct Reaches {
    edge: Row,
    least: Row,
    t_min: Row,
    t_max: Row,
}

impl Reaches {
    fn fill(&mut self, ready: &PreparedRays, bounds: &Aabb) {
        let mut reach = [0.0f32; LANES];
        for axis in 0..3 {
            let (lo, hi) = (bounds.lo[axis], bounds.hi[axis]);
            for lane in 0..LANES {
                let origin = ready.origin[axis][lane];
                reach[lane] = reach[lane].max(hi - origin).max(origin - lo);
            }
        }
        for lane in 0..LANES {
            let reach = Reach::of(reach[lane], ready.t_min[lane], ready.t_max[lane]);
            (self.edge.0[lane], self.least.0[lane]) = (reach.edge, reach.least);
            (self.t_min.0[lane], self.t_max.0[lane]) = (reach.t_min, reach.t_max);
        }
    }

    fn of(&self, lane: usize) -> Reach {
        Reach {
            edge: self.edge.0[lane],
            least: self.least.0[lane],
            t_min: self.t_min.0[lane],
            t_max: self.t_max.0[lane],
        }
    }
}

/// Far more than flushing can change a limit by.
const LIMIT_LEAST: f32 = 7.888_609e-31; // 2^-100

/// What the sieve says of 16 rays and a triangle.
struct Sieved {
    /// Rays that may meet it.
    perhaps: __mmask16,
    /// Those of them that certainly do, from the front, between their limits.
    front: __mmask16,
    /// The same from the back.
    back: __mmask16,
}

impl Sieved {
    const NOTHING: Sieved = Sieved { perhaps: 0, front: 0, back: 0 };
}

/// The rays of a mask that may meet a triangle: [`sieve`] turned around. Its bounds also say what is
/// certainly met: where all edge functions are beyond their error on one side, and the distance with
/// its own within the limits, as narrowed as they are widened otherwise.
///
/// # Safety
/// The processor must have [`InstructionSet::Avx512`]; all rays must have these axes.
#[target_feature(enable = "avx512f,avx512dq")]
#[inline]
unsafe fn sift(
    ready: &PreparedRays,
    reach: &Reaches,
    [kx, ky, kz]: [usize; 3],
    block: &Block<'_>,
    index: usize,
    rays: __mmask16,
    stop: &Row,
) -> Sieved {
    let set = |x: f32| _mm512_set1_ps(x);
    let from = |corner: usize, axis: usize| {
        let x = set(block.words[(corner * 3 + axis) * block.stride + index]);
        _mm512_sub_ps(x, load(&ready.origin[axis]))
    };
    let shear = [load(&ready.shear[0]), load(&ready.shear[1]), load(&ready.shear[2])];
    let corner = |corner: usize| {
        let (x, y, z) = (from(corner, kx), from(corner, ky), from(corner, kz));
        (x, y, z, _mm512_fnmadd_ps(shear[0], z, x), _mm512_fnmadd_ps(shear[1], z, y))
    };
    let (a, b, c) = (corner(0), corner(1), corner(2));
    let edge = |p: (__m512, __m512), q: (__m512, __m512)| {
        _mm512_fmsub_ps(p.0, q.1, _mm512_mul_ps(p.1, q.0))
    };
    let (u, v, w) =
        (edge((c.3, c.4), (b.3, b.4)), edge((a.3, a.4), (c.3, c.4)), edge((b.3, b.4), (a.3, a.4)));
    // The greater of two magnitudes.
    let greater = |x, y| _mm512_range_ps::<0b1011>(x, y);
    let least = |x, y, z| _mm512_min_ps(_mm512_min_ps(x, y), z);
    let most = |x, y, z| _mm512_max_ps(_mm512_max_ps(x, y), z);
    let width = greater(greater(greater(a.3, a.4), greater(b.3, b.4)), greater(c.3, c.4));
    let error = _mm512_fmadd_ps(load(&reach.edge.0), width, load(&reach.least.0));
    let less = _mm512_sub_ps(_mm512_setzero_ps(), error);
    let (lowest, highest) = (least(u, v, w), most(u, v, w));
    let below = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(lowest, less);
    let above = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(highest, error);
    let front = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(lowest, error);
    let back = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(highest, less);
    let mut left = rays & !(below & above);
    if left == 0 {
        return Sieved::NOTHING;
    }
    let depths = [a.2, b.2, c.2].map(|z| _mm512_mul_ps(shear[2], z));
    let nearest = least(depths[0], depths[1], depths[2]);
    let farthest = most(depths[0], depths[1], depths[2]);
    let (t_min, limit) = (load(&reach.t_min.0), _mm512_min_ps(load(&reach.t_max.0), load(&stop.0)));
    left &= _mm512_cmp_ps_mask::<_CMP_GE_OQ>(farthest, t_min);
    left &= _mm512_cmp_ps_mask::<_CMP_LE_OQ>(nearest, limit);
    if left == 0 {
        return Sieved::NOTHING;
    }
    let own = greater(greater(greater(a.0, a.1), greater(b.0, b.1)), greater(c.0, c.1));
    let own = greater(own, greater(greater(a.2, b.2), c.2));
    let room = _mm512_fmadd_ps(set(CORNER_ERROR), own, width);
    let error = _mm512_fmadd_ps(_mm512_mul_ps(set(EDGE_ERROR), own), room, set(EDGE_LEAST));
    let det = _mm512_add_ps(_mm512_add_ps(u, v), w);
    let size = _mm512_abs_ps(det);
    let sum = _mm512_fmadd_ps(v, depths[1], _mm512_mul_ps(w, depths[2]));
    let t = _mm512_div_ps(_mm512_fmadd_ps(u, depths[0], sum), det);
    let spread = _mm512_mul_ps(set(5.0), _mm512_sub_ps(farthest, nearest));
    let shift = _mm512_div_ps(_mm512_fmadd_ps(error, spread, set(TINY)), size);
    let shift = _mm512_fmadd_ps(set(DEPTH_ERROR), greater(nearest, farthest), shift);
    let sure = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(size, _mm512_mul_ps(set(8.0), error));
    let (early, late) = (_mm512_sub_ps(t, shift), _mm512_add_ps(t, shift));
    let reached = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(late, t_min)
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(early, limit);
    let perhaps = left & (!sure | reached);
    // Limits next to zero may have been flushed on the way.
    let narrowed = |t| _mm512_fmadd_ps(_mm512_abs_ps(t), set(STOP_SLACK), set(LIMIT_LEAST));
    let (t_min, t_max) = (load(&ready.t_min), load(&ready.t_max));
    let within = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(early, _mm512_add_ps(t_min, narrowed(t_min)))
        & _mm512_cmp_ps_mask::<_CMP_LE_OQ>(late, _mm512_sub_ps(t_max, narrowed(t_max)));
    let certain = perhaps & sure & within;
    Sieved { perhaps, front: certain & front, back: certain & back }
}

/// Zero for what is below the normal range; see [`splitplane_core::arithmetic::snap`].
#[target_feature(enable = "avx512f,avx512dq")]
#[inline]
fn snapped(x: __m512) -> __m512 {
    let least = _mm512_set1_ps(f32::MIN_POSITIVE);
    let counts = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(_mm512_abs_ps(x), least);
    _mm512_maskz_mov_ps(counts, x)
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

//! As many rays of a packet as a vector has lanes: which of them meet a box, and their tests of a block.

use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions};

use super::packet_block::PacketBlock;
use super::row::{GroupRow, ZERO, load, store};
use super::{FEW, PacketRays};
use crate::simd::{Compiled, MOST_LANES, Simd};
use crate::trace::block_test as leaf;
use crate::trace::block_test::BestHit;
use crate::trace::keep::KeepAll;
use crate::trace::step::Octant;
use crate::trace::triangle_block::TriangleBlock;
use crate::trace::watertight::or_zero;

/// The costs of one triangle against all rays, and of one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 2;
const COST_OF_A_RAY: u32 = 3;

/// The numbers of two vectors, by runs from the one and the other in turn: which of them come in a first
/// vector, and which in a second.
const fn in_turn(lanes: usize, run: usize) -> [[u8; MOST_LANES]; 2] {
    let mut places = [[0; MOST_LANES]; 2];
    let mut i = 0;
    while i < 2 * lanes {
        let (pair, within) = (i / (2 * run), i % (2 * run));
        let other = within / run;
        places[i / lanes][i % lanes] = (pair * run + within % run + other * lanes) as u8;
        i += 1;
    }
    places
}

/// One by one, then two by two.
static IN_TURN_OF_8: [[[u8; MOST_LANES]; 2]; 2] = [in_turn(8, 1), in_turn(8, 2)];
static IN_TURN_OF_16: [[[u8; MOST_LANES]; 2]; 2] = [in_turn(16, 1), in_turn(16, 2)];

/// As many rays of a packet as a vector has lanes.
#[derive(Clone, Copy)]
pub(super) struct Group {
    pub(super) axes: [usize; 3],
    /// Where rays leave the bounds, or nothing can precede their best hits; minus infinity for rays
    /// that are answered or not there.
    pub(super) stop: GroupRow,
    /// Powers of two that lead from inner `t` to the caller's.
    pub(super) outwards: GroupRow,
    /// Inner `t` from which on none is flushed to 0 on the way. Never below the normal range: numbers
    /// there take processors as long as a whole test.
    pub(super) least: GroupRow,
    /// The best hits so far; for any hit the triangle alone.
    pub(super) t: GroupRow,
    pub(super) triangle: GroupRow,
    /// Edge functions opposite the second and the third corner, and the sum of all three.
    pub(super) v: GroupRow,
    pub(super) w: GroupRow,
    pub(super) det: GroupRow,
    /// Inner `t` beyond which nothing can precede them.
    pub(super) beyond: GroupRow,
}

impl Group {
    /// No rays.
    pub(super) const NONE: Group = Group {
        axes: [0, 1, 2],
        stop: ZERO,
        outwards: ZERO,
        least: ZERO,
        t: ZERO,
        triangle: ZERO,
        v: ZERO,
        w: ZERO,
        det: ZERO,
        beyond: ZERO,
    };

    /// The rays that meet a box, whose first coordinate is at `corner` and the others a row on each.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn meets<S: Simd>(
        &self,
        rays: &PacketRays<'_>,
        octant: &Octant,
        corner: *const u8,
    ) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let mut enter = rays.row::<S>(&rays.ready.enter);
            let mut exit = load::<S>(&self.stop);
            for axis in 0..3 {
                let near = S::splat(*corner.add(octant.near[axis] as usize).cast::<f32>());
                let far = S::splat(*corner.add(octant.far[axis] as usize).cast::<f32>());
                let reciprocal = rays.row::<S>(&rays.ready.reciprocal[axis]);
                let near = S::mul_sub(near, reciprocal, rays.row::<S>(&rays.ready.near[axis]));
                let reciprocal = rays.row::<S>(&rays.ready.exit_reciprocal[axis]);
                let far = S::mul_sub(far, reciprocal, rays.row::<S>(&rays.ready.far[axis]));
                // NaN bounds nothing, as in a step of one ray.
                (enter, exit) = (S::max(near, enter), S::min(far, exit));
            }
            S::bits(S::le(enter, exit))
        }
    }

    /// Tests some triangles of a block for some rays. True when a best hit changed.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn block<'b, S: Simd, T: PacketBlock<'b>>(
        &mut self,
        block: &T,
        rays: &mut PacketRays<'_>,
        mut triangles: u32,
        mut active: u32,
        options: &QueryOptions<'_>,
        query: Query,
    ) -> bool {
        let fast = options.accuracy == Accuracy::Fast;
        let many = active.count_ones();
        let mut better = false;
        // SAFETY: the caller's contract.
        unsafe {
            let singly =
                many <= FEW || triangles.count_ones() * COST_OF_A_TRIANGLE > many * COST_OF_A_RAY;
            if singly && triangles != 0 {
                return S::call(Singly { group: self, block, rays, active, options, query });
            }
            if !fast && triangles & triangles.wrapping_sub(1) != 0 {
                // All edges first: no predictor could tell which triangles rays are within.
                let mut rest = triangles;
                while rest != 0 {
                    let index = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    let met = self.within::<S, _>(block, rays, index) & active != 0;
                    triangles ^= u32::from(!met) << index;
                }
            }
            while triangles != 0 && active != 0 {
                let index = triangles.trailing_zeros() as usize;
                triangles &= triangles - 1;
                if options.ignore == Some(block.triangle(index)) {
                    continue;
                }
                let (taken, unclear) = if fast {
                    (self.test_fast::<S, _>(block, rays, index, active, options.culling, query), 0)
                } else {
                    self.test::<S, _>(block, rays, index, active, options.culling, query)
                };
                if taken | unclear == 0 {
                    continue;
                }
                let taken = taken | self.decide(block, index, unclear, rays, options);
                better |= taken != 0;
                if query == Query::Any {
                    active &= !taken;
                    let stop = load::<S>(&self.stop);
                    let nothing = S::splat(f32::NEG_INFINITY);
                    store::<S>(&mut self.stop, S::select(S::mask(taken), nothing, stop));
                }
            }
            if better && query == Query::Closest {
                let stop = S::min(load::<S>(&self.beyond), load::<S>(&self.stop));
                store::<S>(&mut self.stop, stop);
            }
        }
        better
    }

    /// Tests a block for one ray. True when its best hit changed.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn test_ray<S: Simd, T: TriangleBlock>(
        &mut self,
        block: &T,
        rays: &mut PacketRays<'_>,
        lane: usize,
        options: &QueryOptions<'_>,
        query: Query,
    ) -> bool {
        let mut best = self.best(lane);
        // SAFETY: the caller's contract.
        let better = unsafe {
            leaf::test::<S, _, _>(
                rays.ray_state::<S>(lane),
                block,
                (options, query, KeepAll),
                &mut best,
            )
        };
        if better {
            self.set(lane, &best);
            if query == Query::Any {
                self.stop.0[lane] = f32::NEG_INFINITY;
            } else if best.stop < self.stop.0[lane] {
                self.stop.0[lane] = best.stop;
            }
        }
        better
    }

    /// The best hit of a ray so far, except its place in the triangle.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn best(&self, lane: usize) -> BestHit {
        let (t, triangle) = (self.t.0[lane], self.triangle.0[lane].to_bits());
        BestHit { hit: Hit { t, triangle, ..Hit::MISS }, stop: self.beyond.0[lane] }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn set(&mut self, lane: usize, best: &BestHit) {
        self.t.0[lane] = best.hit.t;
        self.triangle.0[lane] = f32::from_bits(best.hit.triangle);
        (self.v.0[lane], self.w.0[lane], self.det.0[lane]) = (best.hit.u, best.hit.v, 1.0);
        self.beyond.0[lane] = best.stop;
    }

    /// Whether a ray has a hit.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn is_hit(&self, lane: usize) -> bool {
        self.best(lane).hit.is_hit()
    }

    /// The best hits.
    ///
    /// # Safety
    /// As for [`super::Packet::trace`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) unsafe fn hits<S: Simd>(&self, accuracy: Accuracy) -> [Hit; MOST_LANES] {
        let [singles, pairs] = if S::N == 16 { &IN_TURN_OF_16 } else { &IN_TURN_OF_8 };
        let mut hits = [Hit::MISS; MOST_LANES];
        let to = hits.as_mut_ptr().cast::<f32>();
        // SAFETY: the caller's contract; a hit is four numbers, and there are as many hits as lanes.
        unsafe {
            let det = load::<S>(&self.det);
            // Only here: divisions take long, and most hits are not the last.
            let mut u = S::div(load::<S>(&self.v), det);
            let mut v = S::div(load::<S>(&self.w), det);
            if accuracy != Accuracy::Fast {
                u = or_zero::<S>(u, f32::MIN_POSITIVE);
                v = or_zero::<S>(v, f32::MIN_POSITIVE);
            }
            let (front, back) = ([load::<S>(&self.t), load::<S>(&self.triangle)], [u, v]);
            for (half, single) in singles.iter().enumerate() {
                let single = S::places(single.as_ptr());
                let numbers = [S::look_up(front, single), S::look_up(back, single)];
                for (quarter, pair) in pairs.iter().enumerate() {
                    let row = S::look_up(numbers, S::places(pair.as_ptr()));
                    S::store(to.add((2 * half + quarter) * S::N), row);
                }
            }
        }
        hits
    }
}

/// Tests of a block for some rays, one at a time, in a separate function: inlined they would take
/// registers from the loops around them.
struct Singly<'a, 'b, T> {
    group: &'a mut Group,
    block: &'a T,
    rays: &'a mut PacketRays<'b>,
    active: u32,
    options: &'a QueryOptions<'a>,
    query: Query,
}

impl<T: TriangleBlock> Compiled for Singly<'_, '_, T> {
    /// Whether a best hit changed.
    type Output = bool;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> bool {
        let Singly { group, block, rays, mut active, options, query } = self;
        let mut better = false;
        while active != 0 {
            let lane = active.trailing_zeros() as usize;
            active &= active - 1;
            // SAFETY: the caller's contract.
            better |= unsafe { group.test_ray::<S, T>(block, rays, lane, options, query) };
        }
        better
    }
}

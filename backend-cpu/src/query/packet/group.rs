//! As many rays of a packet as a vector has lanes: which of them meet a box, and their tests of a block.

use splitplane_core::ray::{Accuracy, Hit, QueryOptions};
use splitplane_core::traverse::Query;

use super::row::{Row, ZERO, load, store};
use super::{FEW, Rays};
use crate::query::leaf::{self, Best};
use crate::query::record::Record;
use crate::query::simd::Simd;
use crate::query::step::Octant;

/// What one triangle against all rays costs, and one ray against a whole block.
const COST_OF_A_TRIANGLE: u32 = 2;
const COST_OF_A_RAY: u32 = 3;

/// As many rays of a packet as a vector has lanes.
#[derive(Clone, Copy)]
pub(super) struct Group {
    pub(super) axes: [usize; 3],
    /// Where rays leave the bounds, or nothing can precede their best hits; minus infinity for rays
    /// that are answered or not there.
    pub(super) stop: Row,
    /// Powers of two that lead from inner `t` to the caller's, and back.
    pub(super) outwards: Row,
    pub(super) inwards: Row,
    /// The best hits so far.
    pub(super) t: Row,
    pub(super) u: Row,
    pub(super) v: Row,
    pub(super) triangle: Row,
    /// Inner `t` beyond which nothing can precede them.
    pub(super) beyond: Row,
}

impl Group {
    /// No rays.
    pub(super) const NONE: Group = Group {
        axes: [0, 1, 2],
        stop: ZERO,
        outwards: ZERO,
        inwards: ZERO,
        t: ZERO,
        u: ZERO,
        v: ZERO,
        triangle: ZERO,
        beyond: ZERO,
    };

    /// The rays that meet a box, whose first coordinate is at `corner` and the others a row on each.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    pub(super) unsafe fn meets<S: Simd>(
        &self,
        rays: &Rays<'_>,
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
                let far = S::mul_sub(far, reciprocal, rays.row::<S>(&rays.ready.far[axis]));
                // What is no number bounds nothing, as in a step of one ray.
                (enter, exit) = (S::max(near, enter), S::min(far, exit));
            }
            S::bits(S::le(enter, exit))
        }
    }

    /// Tests some triangles of a block for some rays. True when a best hit changed.
    ///
    /// # Safety
    /// As for [`Packet::trace`].
    #[inline(always)]
    pub(super) unsafe fn block<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &mut Rays<'_>,
        mut triangles: u32,
        mut active: u32,
        options: &QueryOptions,
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
                while active != 0 {
                    let lane = active.trailing_zeros() as usize;
                    active &= active - 1;
                    better |= self.test_ray::<S>(record, rays, lane, options, query);
                }
                return better;
            }
            if !fast {
                // All edges first: nobody could foresee which triangles rays are within.
                let mut rest = triangles;
                while rest != 0 {
                    let index = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    let met = self.within::<S>(record, rays, index) & active != 0;
                    triangles ^= u32::from(!met) << index;
                }
            }
            while triangles != 0 && active != 0 {
                let index = triangles.trailing_zeros() as usize;
                triangles &= triangles - 1;
                if options.ignore == Some(record.triangle(index)) {
                    continue;
                }
                let (taken, unclear) = if fast {
                    (0, self.test_fast::<S>(record, rays, index, active))
                } else {
                    self.test::<S>(record, rays, index, active, options.culling)
                };
                if taken | unclear == 0 {
                    continue;
                }
                let taken = taken | self.decide(record, index, unclear, rays, options);
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
    /// As for [`Packet::trace`].
    #[inline(always)]
    pub(super) unsafe fn test_ray<S: Simd>(
        &mut self,
        record: &Record<'_>,
        rays: &mut Rays<'_>,
        lane: usize,
        options: &QueryOptions,
        query: Query,
    ) -> bool {
        let mut best = Best { hit: self.hit(lane), stop: self.beyond.0[lane] };
        // SAFETY: the caller's contract.
        let better =
            unsafe { leaf::test::<S, _>(rays.way::<S>(lane), record, options, query, &mut best) };
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

    #[inline(always)]
    pub(super) fn hit(&self, lane: usize) -> Hit {
        Hit {
            t: self.t.0[lane],
            triangle: self.triangle.0[lane].to_bits(),
            u: self.u.0[lane],
            v: self.v.0[lane],
        }
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, best: &Best) {
        self.t.0[lane] = best.hit.t;
        self.triangle.0[lane] = f32::from_bits(best.hit.triangle);
        (self.u.0[lane], self.v.0[lane]) = (best.hit.u, best.hit.v);
        self.beyond.0[lane] = best.stop;
    }
}

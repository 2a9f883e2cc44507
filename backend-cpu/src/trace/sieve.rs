//! The sieve of accuracy `exact`: which triangles of a block a ray may meet in real arithmetic.
//!
//! It is the watertight test with slack for every rounding, and rejects only what is certainly no
//! hit; the rest is decided by [`splitplane_core::exact`]. u is 2^-24, R the greatest distance of
//! the origin to any corner along an axis, P the greatest sheared coordinate of a triangle; scenes
//! are not wide: their coordinates, distances and sheared products are 0 or well within the normal
//! range.
//!
//! *Rays that are changed* by preparation: the coordinates of an origin next to 0 move by up to
//! 2^-59, and those of one that is far away along the ray, where they are rounded once, by u M with
//! M the greatest of them then. (Rays from further off than 2^60 might lose more: they are not
//! sieved.) Both move a sheared coordinate by 4 u M or less, with M = 2^-36 for the former. R is
//! taken longer by M, which allows for 4.1 u M; and `t` by 8 u M, in addition to the rounding error
//! of the difference from the offset, in `f64`.
//!
//! *Corners.* A sheared coordinate `(p_x - o_x) - s (p_z - o_z)` with |s| <= 1 errs by u R from its
//! first difference, 3 u R from slope, difference and product, 2^-40 R for a slope taken as zero, and
//! u P from the last difference: by e <= 4.1 u R + u P.
//!
//! *Edge functions.* `a_x b_y - a_y b_x` errs by 4 P e + 2 e^2 from its factors and by 4.1 u P^2 from
//! its own roundings. P is at most 2.1 R, so this is less than 34 u R P + 34 u^2 R^2. The sieve takes
//! 36 u R (P + 2 u R), and [`EDGE_LEAST`] more for products that underflow. Only where two rounded edge
//! functions of different signs are both greater than that is the ray certainly outside.
//!
//! *Depths.* The depth of a corner errs by three roundings of itself, far less than the amount by
//! which the limits are widened, 2^-13 of themselves; and the ray meets a triangle between the
//! nearest and the farthest.
//!
//! *Distances.* Let m bound the error of the edge functions (here with the R of the triangle itself)
//! and D be their sum. Interpolated with the rounded ones in place of the true ones, `t` shifts by
//! `sum (U' - U) (z - t) / D`, which is at most 3 m spread / |D| with spread the difference of the
//! depths. Where |D| >= 8 m, the weights sum to at most 1.5 |D| in magnitude, and the roundings of
//! depths, products, sums and quotient come to less than 12 * 1.5 u of the greatest depth. The sieve
//! takes 5 m spread / |D| and 32 u, and 2^-120 / |D| for products that underflow.

use splitplane_core::aabb::Aabb;
use splitplane_core::exact::ExactRay;
use splitplane_core::query::intersect::{EDGE_LEAST, STOP_SLACK};
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact::Best;
use splitplane_core::ray::{Hit, QueryOptions, Ray};

use super::ray_state::RayState;
use super::triangle_block::TriangleBlock;
use crate::simd::Simd;

/// The error of an edge function, in R P.
pub(crate) const EDGE_ERROR: f32 = 36.0 * ROUNDING;
/// The factor of R in that bound.
pub(crate) const CORNER_ERROR: f32 = 2.0 * ROUNDING;
/// Part of the greatest depth by which a distance may be off.
pub(crate) const DEPTH_ERROR: f32 = 32.0 * ROUNDING;
/// The amount that products which underflow may add to the numerator of a distance.
pub(crate) const TINY: f32 = 7.523_164e-37; // 2^-120
/// Error of the difference of the offset from a `t` in `f64`, as a part of the offset, and more.
const OFFSET_ERROR: f32 = 3.552_713_7e-15; // 2^-48
/// M of rays whose origin is next to 0, and of all others, since it is so little.
const SHIFTED: f32 = 1.455_191_5e-11; // 2^-36
/// The rounding error of 1.
const ROUNDING: f32 = 5.960_464_5e-8; // 2^-24

/// The data of a ray that the sieve needs, in addition to those of all tests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// Error of an edge function of [large](crate::layout::large) triangles, and of all others: per
    /// unit of P, and the part that does not depend on P. (Large ones in blocks of others may be
    /// rejected: they are in their own as well.)
    pub errors: [[f32; 2]; 2],
    /// M, where the ray was changed.
    pub moved: f32,
    /// The resulting error of `t`.
    pub late: f32,
    /// The ray's inner limits, widened.
    pub t_min: f32,
    /// See `t_min`.
    pub t_max: f32,
}

impl Reach {
    /// The reach of a prepared, ordinary ray.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn new(ray: &RayState, bounds: &[Aabb; 2]) -> Reach {
        let (mut reach, mut moved) = ([0.0f32; 2], 0.0f32);
        for (axis, origin) in ray.axes().into_iter().zip(ray.origin) {
            for (reach, bounds) in reach.iter_mut().zip(bounds) {
                *reach = reach.max(bounds.hi[axis] - origin).max(origin - bounds.lo[axis]);
            }
            moved = moved.max(origin.abs());
        }
        let moved = if ray.offset == 0.0 { SHIFTED } else { moved.max(SHIFTED) };
        let late = 8.0 * ROUNDING * moved + ray.offset.abs() * OFFSET_ERROR;
        Reach {
            moved,
            late,
            ..Reach::of(reach.map(|reach| reach + moved), ray.t_min - late, ray.t_max + late)
        }
    }

    /// The same from R, of large triangles and of others, and the inner limits.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn of(reach: [f32; 2], t_min: f32, t_max: f32) -> Reach {
        let error = |reach: f32| {
            let edge = EDGE_ERROR * reach;
            [edge, edge * (CORNER_ERROR * reach) + EDGE_LEAST]
        };
        Reach {
            errors: reach.map(error),
            moved: 0.0,
            late: 0.0,
            t_min: t_min - t_min.abs() * STOP_SLACK,
            t_max: t_max + t_max.abs() * STOP_SLACK,
        }
    }
}

/// A ray under way, as the exact test takes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactLane {
    ray: ExactRay,
    reach: Reach,
    best: Best,
}

impl ExactLane {
    /// A lane that has no ray.
    pub(crate) fn idle() -> ExactLane {
        let ray = ExactRay { origin: [0.0; 3], direction: [1.0, 0.0, 0.0], t_min: 1.0, t_max: 0.0 };
        ExactLane { ray, reach: Reach::of([0.0; 2], 0.0, 0.0), best: Best::default() }
    }

    /// A ray about to start, if it can hit anything. The first bounds hold all triangles, the second those that are not
    /// [large](crate::layout::large).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn new(ray: &Ray, ray_state: &RayState, bounds: &[Aabb; 2]) -> Option<ExactLane> {
        let ray = ExactRay::new(ray)?;
        Some(ExactLane { ray, reach: Reach::new(ray_state, bounds), best: Best::default() })
    }

    /// The answer.
    #[inline]
    pub(crate) fn hit(&self, query: Query) -> Hit {
        answer(&self.best, query)
    }

    /// Tests a block; `stop` is the inner `t` beyond which nothing can precede the best hit. True when
    /// the best hit changed.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn test<S: Simd, T: TriangleBlock>(
        &mut self,
        ray_state: &RayState,
        block: &T,
        options: &QueryOptions<'_>,
        query: Query,
        stop: &mut f32,
    ) -> bool {
        let limit = self.reach.t_max.min(*stop);
        // SAFETY: the caller's contract.
        let bits = unsafe { sift::<S, T>(ray_state, &self.reach, block, limit) };
        bits != 0 && self.decide(block, bits, ray_state, options, query, stop)
    }

    /// Decides some triangles of a block.
    #[inline(never)]
    fn decide<T: TriangleBlock>(
        &mut self,
        block: &T,
        mut bits: u32,
        ray_state: &RayState,
        options: &QueryOptions<'_>,
        query: Query,
        stop: &mut f32,
    ) -> bool {
        let mut better = false;
        while bits != 0 {
            let index = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let triangle = block.triangle(index);
            // Or met before, in another leaf.
            if self.best.triangle() == Some(triangle) || options.ignore == Some(triangle) {
                continue;
            }
            self.best.test(&self.ray, &block.corners(index), triangle, options.culling, query);
            if self.best.triangle() == Some(triangle) {
                better = true;
                if query == Query::Any {
                    break;
                }
                let outer = self.best.stop();
                *stop = inner_stop(outer, ray_state.exponent, ray_state.offset) + self.reach.late;
            }
        }
        better
    }
}

/// The answer to a query: the hit, or the record of a miss; for any hit the triangle says it all.
#[inline]
pub(crate) fn answer(best: &Best, query: Query) -> Hit {
    match query {
        Query::Closest => best.hit(),
        Query::Any => best.triangle().map_or(Hit::MISS, |triangle| Hit { triangle, ..Hit::MISS }),
    }
}

/// The inner `t` beyond which no cell can hold a hit at or before an outer one.
#[inline]
pub(crate) fn inner_stop(t: f64, exponent: i32, offset: f32) -> f32 {
    // Exact in `f64`, except for what is beyond all floats anyway.
    let scaled = t * f64::from_bits(((exponent + 1023) as u64) << 52);
    let inner = (scaled - f64::from(offset)) as f32;
    inner + inner.abs() * STOP_SLACK
}

/// Bits of the triangles that the ray may meet at an inner `t` of at most `limit`, which is widened.
///
/// # Safety
/// The processor must have the set, and a block of its width must follow the triangles' words.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn sift<S: Simd, T: TriangleBlock>(
    ray_state: &RayState,
    reach: &Reach,
    block: &T,
    limit: f32,
) -> u32 {
    // SAFETY: the caller's contract.
    unsafe {
        let [kx, ky, kz] = ray_state.axes();
        let [ox, oy, oz] = [
            S::splat(ray_state.origin[0]),
            S::splat(ray_state.origin[1]),
            S::splat(ray_state.origin[2]),
        ];
        let [sx, sy, sz] = [
            S::splat(ray_state.shear[0]),
            S::splat(ray_state.shear[1]),
            S::splat(ray_state.shear[2]),
        ];
        let zero = S::splat(0.0);
        // Of each corner: sheared coordinates and depth, and the greatest magnitudes before and after.
        let mut flat_x = [zero; 3];
        let (mut flat_y, mut depth, mut own, mut width) = (flat_x, flat_x, flat_x, flat_x);
        for i in 0..T::VECTORS {
            let x = S::sub(block.coordinates::<S>(kx, i), ox);
            let y = S::sub(block.coordinates::<S>(ky, i), oy);
            let z = S::sub(block.coordinates::<S>(kz, i), oz);
            flat_x[i] = S::sub(x, S::mul(sx, z));
            flat_y[i] = S::sub(y, S::mul(sy, z));
            depth[i] = S::mul(sz, z);
            own[i] = S::magnitude(S::magnitude(x, y), z);
            width[i] = S::magnitude(flat_x[i], flat_y[i]);
        }
        let places = block.places::<S>();
        let [ax, bx, cx] = T::of_corners::<S>(flat_x, places);
        let [ay, by, cy] = T::of_corners::<S>(flat_y, places);
        let [da, db, dc] = T::of_corners::<S>(depth, places);
        let [wa, wb, wc] = T::of_corners::<S>(width, places);
        let u = S::sub(S::mul(cx, by), S::mul(cy, bx));
        let v = S::sub(S::mul(ax, cy), S::mul(ay, cx));
        let w = S::sub(S::mul(bx, ay), S::mul(by, ax));
        let width = S::max(wa, S::max(wb, wc));
        let [edge, least] = reach.errors[usize::from(!block.is_large())];
        let error = S::add(S::mul(S::splat(edge), width), S::splat(least));
        let below = S::le(S::min(u, S::min(v, w)), S::sub(zero, error));
        let above = S::le(error, S::max(u, S::max(v, w)));
        let nearest = S::min(da, S::min(db, dc));
        let farthest = S::max(da, S::max(db, dc));
        let (t_min, limit) = (S::splat(reach.t_min), S::splat(limit));
        let reached = S::and(S::le(t_min, farthest), S::le(nearest, limit));
        let mut bits = S::bits(reached) & !S::bits(S::and(below, above));
        // Lanes after the last triangle do not count.
        bits &= (1u32 << block.count()) - 1;
        if bits == 0 {
            return 0;
        }
        let [a, b, c] = T::of_corners::<S>(own, places);
        let own = S::add(S::max(a, S::max(b, c)), S::splat(reach.moved));
        let room = S::add(S::mul(S::splat(CORNER_ERROR), own), width);
        let error = S::mul(S::mul(S::splat(EDGE_ERROR), own), room);
        let error = S::add(error, S::splat(EDGE_LEAST));
        // Again with the triangle's own distance: far triangles make that of the scene large.
        let below = S::le(S::min(u, S::min(v, w)), S::sub(zero, error));
        let above = S::le(error, S::max(u, S::max(v, w)));
        bits &= !S::bits(S::and(below, above));
        let det = S::add(S::add(u, v), w);
        let size = S::abs(det);
        let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
        let t = S::div(sum, det);
        let spread = S::mul(S::splat(5.0), S::sub(farthest, nearest));
        let shift = S::div(S::add(S::mul(error, spread), S::splat(TINY)), size);
        let deepest = S::magnitude(nearest, farthest);
        let shift = S::add(S::mul(S::splat(DEPTH_ERROR), deepest), shift);
        let shift = S::add(shift, S::splat(reach.late));
        let sure = S::le(S::mul(S::splat(8.0), error), size);
        let reached = S::and(S::le(t_min, S::add(t, shift)), S::le(S::sub(t, shift), limit));
        bits & (!S::bits(sure) | S::bits(reached))
    }
}

#[cfg(test)]
mod tests;

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
//!
//! *Certain hits.* The same bounds say where a ray certainly meets a triangle: where all three edge functions are of one sign and greater
//! than their error, and all of the interval that holds `t` is within the limits, taken narrower by as much as they are taken
//! wider above. What is certainly met at a `t` certainly less than that of all others is the closest hit, and any of it is a hit: then the exact
//! test is for the numbers of one hit, or for nothing.

use splitplane_core::aabb::Aabb;
use splitplane_core::exact::{ExactRay, meet};
use splitplane_core::query::intersect::{EDGE_LEAST, STOP_SLACK};
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact::Best;
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray, Rays};
use splitplane_core::triangle::Triangle;

use super::ray_state::RayState;
use super::triangle_block::{TriangleBlock, WrittenBlock};
use crate::simd::{Compiled, MOST_LANES, Simd};

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
/// The part by which limits are taken narrower for hits that are certain, beyond [`STOP_SLACK`]: a `t` that counts as 0 is below it.
const NARROWER: f32 = 7.888_609e-31; // 2^-100
/// Of a `t` in `f64` the part by which it may differ after it was rounded to a float, and more; and what may be lost to zero.
const FLOAT_ERROR: f32 = 4.0 * ROUNDING;
const FLOAT_LEAST: f32 = 4.0 * f32::MIN_POSITIVE;
/// The rounding error of 1.
pub(crate) const ROUNDING: f32 = 5.960_464_5e-8; // 2^-24

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
    /// The same, narrowed.
    pub within: [f32; 2],
}

impl Reach {
    /// The reach of a ray that may have been moved.
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
        let [t_min, t_max] = [ray.t_min - late, ray.t_max + late];
        // The core has widened the limits of moved rays, by more than a rounding: of these nothing is certain.
        let is_moved = ray.offset != 0.0;
        let within = if is_moved {
            [f32::INFINITY, f32::NEG_INFINITY]
        } else {
            [least_within(ray.t_min), most_within(ray.t_max)]
        };
        Reach { moved, late, within, ..Reach::of(reach.map(|reach| reach + moved), t_min, t_max) }
    }

    /// Errors of edge functions from R, of large triangles and of others.
    pub(crate) fn errors(reach: [f32; 2]) -> [[f32; 2]; 2] {
        reach.map(|reach| {
            let edge = EDGE_ERROR * reach;
            [edge, edge * (CORNER_ERROR * reach) + EDGE_LEAST]
        })
    }

    /// The reach of a ray that was not moved, from its inner limits and the [`Reach::errors`] of one that reaches as far.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn with_errors(errors: [[f32; 2]; 2], t_min: f32, t_max: f32) -> Reach {
        Reach {
            errors,
            moved: 0.0,
            late: 0.0,
            t_min: t_min - t_min.abs() * STOP_SLACK,
            t_max: t_max + t_max.abs() * STOP_SLACK,
            within: [least_within(t_min), most_within(t_max)],
        }
    }

    /// The same from R, of large triangles and of others, and the inner limits.
    pub(crate) fn of(reach: [f32; 2], t_min: f32, t_max: f32) -> Reach {
        Reach::with_errors(Reach::errors(reach), t_min, t_max)
    }
}

/// A lower limit, narrowed: what is not before it is certainly within. Limits are clamped and snapped on the way in.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn least_within(t_min: f32) -> f32 {
    (t_min + t_min.abs() * STOP_SLACK) + NARROWER
}

/// An upper limit, narrowed.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn most_within(t_max: f32) -> f32 {
    (t_max - t_max.abs() * STOP_SLACK) - NARROWER
}

/// A ray under way, as the exact test takes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExactLane {
    reach: Reach,
    /// The triangle of the best hit so far, if there is one.
    triangle: u32,
    /// Whether it was decided; else it is certain.
    is_decided: bool,
    /// Inner `t` between which that hit certainly is; infinite without one.
    between: [f32; 2],
    /// Its corners, where it is certain.
    corners: Triangle,
    /// The hit, where it was decided.
    best: Best,
}

/// A hit that is certain, and of which the numbers are not known.
#[derive(Clone, Copy)]
pub(crate) struct CertainHit<'a> {
    pub corners: &'a Triangle,
    pub triangle: u32,
}

impl CertainHit<'_> {
    /// The hit of a ray with its numbers.
    pub(crate) fn hit(&self, ray: &Ray) -> Hit {
        // It is met, and faces the ray as it must.
        let met = ExactRay::new(ray).and_then(|ray| meet(&ray, self.corners, Culling::None));
        debug_assert!(met.is_some(), "certain: {ray:?} {:?}", self.corners);
        met.map_or(Hit::MISS, |met| met.hit(self.triangle))
    }
}

impl ExactLane {
    /// A lane that has no ray.
    pub(crate) fn idle() -> ExactLane {
        ExactLane {
            reach: Reach::of([0.0; 2], 0.0, 0.0),
            triangle: Hit::MISS.triangle,
            is_decided: false,
            between: [f32::INFINITY; 2],
            corners: [[0.0; 3]; 3],
            best: Best::default(),
        }
    }

    /// A ray about to start. Only what is read before it is written.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn begin(&mut self, reach: Reach) {
        self.reach = reach;
        (self.triangle, self.is_decided) = (Hit::MISS.triangle, false);
        self.between = [f32::INFINITY; 2];
    }

    /// The answer: for any hit the triangle says it all. A closest hit that is certain needs more work.
    #[inline]
    pub(crate) fn hit(&self, query: Query) -> Result<Hit, CertainHit<'_>> {
        if query == Query::Any || self.triangle == Hit::MISS.triangle {
            return Ok(Hit { triangle: self.triangle, ..Hit::MISS });
        }
        if self.is_decided {
            return Ok(self.best.hit());
        }
        Err(CertainHit { corners: &self.corners, triangle: self.triangle })
    }

    /// Tests a block for a ray of a batch, which is given as one with corners written out too where it is that; `stop` is the inner `t`
    /// beyond which nothing can precede the best hit. True when the best hit changed.
    ///
    /// # Safety
    /// The processor must have the set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn test<S: Simd, T: TriangleBlock>(
        &mut self,
        (rays, ray_state): (&Rays<'_>, &RayState),
        block: (&T, Option<WrittenBlock<'_>>),
        options: &QueryOptions<'_>,
        query: Query,
        stop: &mut f32,
    ) -> bool {
        let limit = self.reach.t_max.min(*stop);
        // SAFETY: the caller's contract.
        match unsafe { sift_either::<S, T>(ray_state, &self.reach, block, limit, options.culling) }
        {
            Some(sifted) => self.take(block.0, &sifted, (rays, ray_state), options, query, stop),
            None => false,
        }
    }

    /// Takes what is met of a block, deciding what is not certain.
    #[inline(never)]
    fn take<T: TriangleBlock>(
        &mut self,
        block: &T,
        sifted: &Sifted,
        (rays, ray_state): (&Rays<'_>, &RayState),
        options: &QueryOptions<'_>,
        query: Query,
        stop: &mut f32,
    ) -> bool {
        let mut better = false;
        let mut bits = sifted.in_order();
        while let Some((index, certain)) = next_of(&mut bits) {
            let triangle = block.triangle(index);
            // Or met before, in another leaf.
            if self.triangle == triangle || options.ignore == Some(triangle) {
                continue;
            }
            let [low, high] = [sifted.low[index], sifted.high[index]];
            if low > self.between[1] {
                continue;
            }
            if certain && query == Query::Any {
                self.triangle = triangle;
                return true;
            }
            let corners = block.corners(index);
            if certain && high < self.between[0] {
                (self.triangle, self.corners, self.between) = (triangle, corners, [low, high]);
                self.is_decided = false;
            } else if let ray = &rays.ray(ray_state.index as usize)
                && self.decide(ray, (&corners, triangle), options.culling, query)
            {
                let of = (ray_state.exponent, ray_state.offset);
                self.between = inner_interval(&self.best, of, self.reach.late);
            } else {
                continue;
            }
            better = true;
            if query == Query::Any {
                break;
            }
            let last = self.between[1];
            *stop = last + last.abs() * STOP_SLACK;
        }
        better
    }

    /// Decides a triangle by the exact test. True when it is the best hit then.
    #[inline(never)]
    fn decide(
        &mut self,
        ray: &Ray,
        (corners, triangle): (&Triangle, u32),
        culling: Culling,
        query: Query,
    ) -> bool {
        let Some(ray) = ExactRay::new(ray) else { return false };
        if !self.is_decided {
            self.best = Best::default();
            if self.triangle != Hit::MISS.triangle {
                // It is met, and faces the ray as it must.
                self.best.test(&ray, &self.corners, self.triangle, Culling::None, query);
            }
            self.is_decided = true;
        }
        self.best.test(&ray, corners, triangle, culling, query);
        let is_best = self.best.triangle() == Some(triangle);
        if is_best {
            self.triangle = triangle;
        }
        is_best
    }
}

/// Inner `t` between which the best hit is, which was decided; `late` is the error of inner `t` beside their rounding.
pub(crate) fn inner_interval(best: &Best, (exponent, offset): (i32, f32), late: f32) -> [f32; 2] {
    // Exact in `f64`, except for what is beyond all floats anyway.
    let power = f64::from_bits(((exponent + 1023) as u64) << 52);
    let (least, most) = best.t_interval();
    let [least, most] = [least, most].map(|t| (t * power - f64::from(offset)) as f32);
    let error = |t: f32| t.abs() * FLOAT_ERROR + FLOAT_LEAST + late;
    // Beyond all floats nothing is known.
    let low = if least.is_finite() { least - error(least) } else { f32::NEG_INFINITY };
    [low, if most.is_finite() { most + error(most) } else { f32::INFINITY }]
}

/// A number of each lane.
type Row = [f32; MOST_LANES];

/// What the sieve keeps of a block, or of rays: whatever may be met.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Sifted {
    /// Inner `t` before which a lane meets nothing, and after which.
    pub low: Row,
    pub high: Row,
    /// The lanes that may meet, as bits.
    pub bits: u32,
    /// Those that certainly do, within the limits.
    pub certain: u32,
}

impl Sifted {
    /// The lanes as [`next_of`] takes them: certain ones first, since they may spare the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn in_order(&self) -> u64 {
        u64::from(self.certain) | u64::from(self.bits & !self.certain) << 32
    }
}

/// The next lane, and whether it is certain.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn next_of(bits: &mut u64) -> Option<(usize, bool)> {
    if *bits == 0 {
        return None;
    }
    let bit = bits.trailing_zeros() as usize;
    *bits &= *bits - 1;
    Some((bit % 32, bit < 32))
}

/// Triangles as rays see them, a pair in each lane.
pub(crate) struct Sight<S: Simd> {
    /// Edge functions.
    edges: [S::Floats; 3],
    /// The least and the greatest of them.
    least: S::Floats,
    most: S::Floats,
    /// Inner `t` of the corners.
    depths: [S::Floats; 3],
    /// Of the nearest and of the farthest.
    nearest: S::Floats,
    farthest: S::Floats,
}

/// Inner limits of rays, one in each lane: widened, and narrowed.
pub(crate) struct Ends<S: Simd> {
    pub t_min: S::Floats,
    /// Beyond it nothing can precede the best hit either.
    pub limit: S::Floats,
    pub within: [S::Floats; 2],
}

/// What is known of lanes.
pub(crate) struct Judged<S: Simd> {
    pub bits: u32,
    pub certain: u32,
    /// Inner `t` between which the plane is met; all, where that is not known.
    pub low: S::Floats,
    pub high: S::Floats,
}

/// # Safety
/// All methods: the processor must have the set.
impl<S: Simd> Sight<S> {
    /// From sheared coordinates of the corners, and their depths.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn new(
        [[ax, bx, cx], [ay, by, cy]]: [[S::Floats; 3]; 2],
        depths: [S::Floats; 3],
    ) -> Sight<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let u = S::sub(S::mul(cx, by), S::mul(cy, bx));
            let v = S::sub(S::mul(ax, cy), S::mul(ay, cx));
            let w = S::sub(S::mul(bx, ay), S::mul(by, ax));
            let [da, db, dc] = depths;
            Sight {
                edges: [u, v, w],
                least: S::min(u, S::min(v, w)),
                most: S::max(u, S::max(v, w)),
                depths,
                nearest: S::min(da, S::min(db, dc)),
                farthest: S::max(da, S::max(db, dc)),
            }
        }
    }

    /// Where the ray is certainly outside, given the error of edge functions.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn outside(&self, error: S::Floats) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            let below = S::le(self.least, S::sub(S::splat(0.0), error));
            S::bits(S::and(below, S::le(error, self.most)))
        }
    }

    /// Where the depths of the corners reach into the limits.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn reaches(&self, ends: &Ends<S>) -> u32 {
        // SAFETY: the caller's contract.
        unsafe {
            S::bits(S::and(S::le(ends.t_min, self.farthest), S::le(self.nearest, ends.limit)))
        }
    }

    /// What is known of some lanes, given each triangle's own greatest distance, with what rays were moved by, and its greatest
    /// sheared coordinate; far triangles make the distance of the scene large.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn judge(
        &self,
        mut bits: u32,
        [own, width]: [S::Floats; 2],
        late: S::Floats,
        ends: &Ends<S>,
        culling: Culling,
    ) -> Judged<S> {
        // SAFETY: the caller's contract.
        unsafe {
            let room = S::add(S::mul(S::splat(CORNER_ERROR), own), width);
            let error = S::mul(S::mul(S::splat(EDGE_ERROR), own), room);
            let error = S::add(error, S::splat(EDGE_LEAST));
            bits &= !self.outside(error);
            let [u, v, w] = self.edges;
            let [da, db, dc] = self.depths;
            let det = S::add(S::add(u, v), w);
            let size = S::abs(det);
            let sum = S::add(S::add(S::mul(u, da), S::mul(v, db)), S::mul(w, dc));
            let t = S::div(sum, det);
            let spread = S::mul(S::splat(5.0), S::sub(self.farthest, self.nearest));
            let shift = S::div(S::add(S::mul(error, spread), S::splat(TINY)), size);
            let deepest = S::magnitude(self.nearest, self.farthest);
            let shift = S::add(S::mul(S::splat(DEPTH_ERROR), deepest), shift);
            let shift = S::add(shift, late);
            let sure = S::le(S::mul(S::splat(8.0), error), size);
            let low = S::select(sure, S::sub(t, shift), S::splat(f32::NEG_INFINITY));
            let high = S::select(sure, S::add(t, shift), S::splat(f32::INFINITY));
            bits &= S::bits(S::and(S::le(ends.t_min, high), S::le(low, ends.limit)));
            let front = S::bits(S::le(error, self.least));
            let back = S::bits(S::le(self.most, S::sub(S::splat(0.0), error)));
            let inside = match culling {
                Culling::None => front | back,
                Culling::Back => front,
                Culling::Front => back,
            };
            let [first, last] = ends.within;
            let within = S::bits(S::and(S::le(first, low), S::le(high, last)));
            Judged { bits, certain: bits & inside & within, low, high }
        }
    }
}

/// [`sift`] of a block that is given as one with corners `written` out too where it is that. Those are sifted in a function of their own, as in
/// [`test_either`](super::block_test::test_either).
///
/// # Safety
/// As for [`sift`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn sift_either<S: Simd, T: TriangleBlock>(
    ray_state: &RayState,
    reach: &Reach,
    (block, written): (&T, Option<WrittenBlock<'_>>),
    limit: f32,
    culling: Culling,
) -> Option<Sifted> {
    // SAFETY: the caller's contract.
    unsafe {
        if S::WRITES_OUT
            && let Some(block) = written
        {
            return S::call(SiftWritten { ray_state, reach, block, limit, culling });
        }
        sift::<S, T>(ray_state, reach, block, limit, culling)
    }
}

/// What [`sift`] takes, of a block with corners written out.
struct SiftWritten<'a> {
    ray_state: &'a RayState,
    reach: &'a Reach,
    block: WrittenBlock<'a>,
    limit: f32,
    culling: Culling,
}

impl Compiled for SiftWritten<'_> {
    type Output = Option<Sifted>;

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn run<S: Simd>(self) -> Option<Sifted> {
        let SiftWritten { ray_state, reach, block, limit, culling } = self;
        // SAFETY: the caller's contract.
        unsafe { sift::<S, _>(ray_state, reach, &block, limit, culling) }
    }
}

/// What of a block the ray may meet at an inner `t` of at most `limit`, which is widened; `None` where that is nothing.
///
/// # Safety
/// The processor must have the set, and a block of its width must follow the triangles' words.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) unsafe fn sift<S: Simd, T: TriangleBlock>(
    ray_state: &RayState,
    reach: &Reach,
    block: &T,
    limit: f32,
    culling: Culling,
) -> Option<Sifted> {
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
        let flat = [T::of_corners::<S>(flat_x, places), T::of_corners::<S>(flat_y, places)];
        let sight = Sight::<S>::new(flat, T::of_corners::<S>(depth, places));
        let [wa, wb, wc] = T::of_corners::<S>(width, places);
        let width = S::max(wa, S::max(wb, wc));
        let [edge, least] = reach.errors[usize::from(!block.is_large())];
        let error = S::add(S::mul(S::splat(edge), width), S::splat(least));
        let ends = Ends::<S> {
            t_min: S::splat(reach.t_min),
            limit: S::splat(limit),
            within: [S::splat(reach.within[0]), S::splat(reach.within[1])],
        };
        // Lanes after the last triangle do not count.
        let there = (1u32 << block.count()) - 1;
        let bits = there & sight.reaches(&ends) & !sight.outside(error);
        if bits == 0 {
            return None;
        }
        let [a, b, c] = T::of_corners::<S>(own, places);
        let own = S::add(S::max(a, S::max(b, c)), S::splat(reach.moved));
        let judged = sight.judge(bits, [own, width], S::splat(reach.late), &ends, culling);
        if judged.bits == 0 {
            return None;
        }
        let Judged { bits, certain, low, high } = judged;
        let mut sifted = Sifted { low: [0.0; MOST_LANES], high: [0.0; MOST_LANES], bits, certain };
        S::store(sifted.low.as_mut_ptr(), low);
        S::store(sifted.high.as_mut_ptr(), high);
        Some(sifted)
    }
}

#[cfg(test)]
mod tests;

//! The sieve of accuracy `exact`: which triangles of a block a ray may meet in real arithmetic.
//!
//! It is the watertight test with room for every rounding, and lets go only what certainly is no hit;
//! the rest is decided by [`splitplane_core::exact`]. u is 2^-24, R the greatest distance of the origin
//! to any corner along an axis, P the greatest sheared coordinate of a triangle; the rays are those of
//! the wide test: neither moved nor changed by being made ready, in scenes that are not wide, whose coordinates, distances and sheared products are 0 or well within the normal
//! range.
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
//! *Depths.* The depth of a corner errs by three roundings of itself, far less than the limits are
//! widened by, 2^-13 of themselves; and the ray meets a triangle between the nearest and the farthest.
//!
//! *Distances.* Let m bound the error of the edge functions (here with the R of the triangle itself)
//! and D be their sum. Interpolated with the rounded ones in place of the true ones, `t` shifts by
//! `sum (U' - U) (z - t) / D`, which is at most 3 m spread / |D| with spread the difference of the
//! depths. Where |D| >= 8 m, the weights sum to at most 1.5 |D| in magnitude, and the roundings of
//! depths, products, sums and quotient come to less than 12 * 1.5 u of the greatest depth. The sieve
//! takes 5 m spread / |D| and 32 u, and 2^-120 / |D| for products that underflow.

use splitplane_core::aabb::Aabb;
use splitplane_core::exact::{Best, ExactRay};
use splitplane_core::intersect::{EDGE_LEAST, PreparedRay, STOP_SLACK};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::traverse::Query;

use super::blocks::Block;
use super::instruction_set::InstructionSet;
use super::leaves::WrittenOut;
use super::simd::{MOST_LANES, Simd};

/// The error of an edge function, in R P.
pub(crate) const EDGE_ERROR: f32 = 36.0 * UNIT;
/// What stands beside P in it, in R.
pub(crate) const CORNER_ERROR: f32 = 2.0 * UNIT;
/// Part of the greatest depth by which a distance may be off.
pub(crate) const DEPTH_ERROR: f32 = 32.0 * UNIT;
/// What products that underflow may add to the numerator of a distance.
pub(crate) const TINY: f32 = 7.523_164e-37; // 2^-120
/// The rounding error of 1.
const UNIT: f32 = 5.960_464_5e-8; // 2^-24

/// What the sieve must know of a ray besides what all tests do.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// Error of an edge function, per unit of P.
    pub edge: f32,
    /// The part of it that does not depend on P.
    pub least: f32,
    /// The ray's inner limits, widened.
    pub t_min: f32,
    /// See `t_min`.
    pub t_max: f32,
}

impl Reach {
    /// The reach of a ray that is made ready and ordinary.
    #[inline]
    pub fn new(ray: &PreparedRay, bounds: &Aabb) -> Reach {
        let mut reach = 0.0f32;
        for axis in 0..3 {
            let origin = ray.origin[axis];
            reach = reach.max(bounds.hi[axis] - origin).max(origin - bounds.lo[axis]);
        }
        Reach::of(reach, ray.t_min, ray.t_max)
    }

    /// The same from R and the inner limits.
    #[inline(always)]
    pub fn of(reach: f32, t_min: f32, t_max: f32) -> Reach {
        let edge = EDGE_ERROR * reach;
        Reach {
            edge,
            least: edge * (CORNER_ERROR * reach) + EDGE_LEAST,
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
    pub fn idle() -> ExactLane {
        let ray = ExactRay { origin: [0.0; 3], direction: [1.0, 0.0, 0.0], t_min: 1.0, t_max: 0.0 };
        ExactLane { ray, reach: Reach::of(0.0, 0.0, 0.0), best: Best::default() }
    }

    /// A ray about to start, if it can hit anything.
    #[inline]
    pub fn new(ray: &Ray, prepared: &PreparedRay, bounds: &Aabb) -> Option<ExactLane> {
        let ray = ExactRay::new(ray)?;
        Some(ExactLane { ray, reach: Reach::new(prepared, bounds), best: Best::default() })
    }

    /// The answer.
    #[inline]
    pub fn hit(&self, query: Query) -> Hit {
        answer(&self.best, query)
    }

    /// Tests a block; `stop` is the inner `t` beyond which nothing can precede the best hit. True when
    /// the query is answered: any hit was asked for and found.
    ///
    /// # Safety
    /// The processor must have the set.
    #[inline(always)]
    pub unsafe fn test_record<S: Simd>(
        &mut self,
        prepared: &PreparedRay,
        record: &impl WrittenOut,
        options: &QueryOptions,
        query: Query,
        stop: &mut f32,
    ) -> bool {
        let mut room = [0.0; 11 * MOST_LANES];
        let block = record.written_out(&mut room);
        let limit = self.reach.t_max.min(*stop);
        // SAFETY: the caller's contract.
        let mut bits = unsafe { sift(S::SET, prepared, &self.reach, &block, limit) };
        while bits != 0 {
            let index = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            if decide(&self.ray, &mut self.best, &block, index, options, query) {
                if query == Query::Any {
                    return true;
                }
                *stop = inner_stop(self.best.stop(), prepared.exponent);
            }
        }
        false
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

/// Decides one triangle of a block; whether it is the best hit now.
#[inline]
pub(crate) fn decide(
    ray: &ExactRay,
    best: &mut Best,
    block: &Block<'_>,
    index: usize,
    options: &QueryOptions,
    query: Query,
) -> bool {
    let triangle = block.triangle(index);
    // Met before, in another leaf.
    if best.triangle() == Some(triangle) || options.ignore == Some(triangle) {
        return false;
    }
    best.test(ray, &block.corners(index), triangle, options.culling, query);
    best.triangle() == Some(triangle)
}

/// The inner `t` beyond which no cell can hold a hit at or before an outer one.
#[inline]
pub(crate) fn inner_stop(t: f64, exponent: i32) -> f32 {
    // Exact in `f64`, but for what is beyond all floats anyway.
    let inner = (t * f64::from_bits(((exponent + 1023) as u64) << 52)) as f32;
    inner + inner.abs() * STOP_SLACK
}

/// Bits of the triangles of a block that the ray may meet at an inner `t` of at most `limit`, which is
/// widened.
///
/// # Safety
/// The processor must have `set`.
#[inline(always)]
pub(crate) unsafe fn sift(
    set: InstructionSet,
    ray: &PreparedRay,
    reach: &Reach,
    block: &Block<'_>,
    limit: f32,
) -> u32 {
    match set {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the caller's contract; a block's words reach 16 behind the start of any row.
        InstructionSet::Avx512 => unsafe { x86::sift_16(ray, reach, block, limit) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        InstructionSet::Avx2 => unsafe { x86::sift_8(ray, reach, block, limit) },
        _ => portable(ray, reach, block, limit),
    }
}

fn portable(ray: &PreparedRay, reach: &Reach, block: &Block<'_>, limit: f32) -> u32 {
    let [sx, sy, sz] = ray.shear;
    let origin = ray.axes.map(|axis| ray.origin[axis]);
    let mut bits = 0;
    for i in 0..block.count {
        let from: [[f32; 3]; 3] = core::array::from_fn(|corner| {
            core::array::from_fn(|k| {
                block.words[(corner * 3 + ray.axes[k]) * block.stride + i] - origin[k]
            })
        });
        let [a, b, c] = from.map(|p| [p[0] - sx * p[2], p[1] - sy * p[2]]);
        let width = [a, b, c].as_flattened().iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let error = reach.edge * width + reach.least;
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let depths = from.map(|p| sz * p[2]);
        let nearest = depths[0].min(depths[1]).min(depths[2]);
        let farthest = depths[0].max(depths[1]).max(depths[2]);
        let outside = u.min(v).min(w) <= -error && u.max(v).max(w) >= error;
        if outside || farthest < reach.t_min || nearest > limit {
            continue;
        }
        let own = from.as_flattened().iter().fold(0.0f32, |most, x| most.max(x.abs()));
        let error = EDGE_ERROR * own * (width + CORNER_ERROR * own) + EDGE_LEAST;
        let det = (u + v + w).abs();
        let t = (u * depths[0] + v * depths[1] + w * depths[2]) / (u + v + w);
        let shift = (5.0 * error * (farthest - nearest) + TINY) / det;
        let shift = shift + DEPTH_ERROR * nearest.abs().max(farthest.abs());
        let beside = t + shift < reach.t_min || t - shift > limit;
        if det < 8.0 * error || !beside {
            bits |= 1 << i;
        }
    }
    bits
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    //! The same with vector instructions. Fused operations may stand here: they only round less.

    use super::{
        Block, CORNER_ERROR, DEPTH_ERROR, EDGE_ERROR, EDGE_LEAST, PreparedRay, Reach, TINY,
    };
    use core::arch::x86_64::*;

    macro_rules! sieve {
        ($sift:ident, $features:literal, $width:literal, $load:path, $set:path, $add:path, $sub:path,
         $mul:path, $div:path, $min:path, $max:path, $less_product:expr, $product_less:expr,
         $product_plus:expr, $magnitude:expr, $magnitudes:expr, $le:expr) => {
            /// Triangles that the ray may meet.
            ///
            /// # Safety
            /// The processor must have the instruction set, and a wide load from any row must stay
            /// within the block's words.
            #[target_feature(enable = $features)]
            #[inline]
            pub unsafe fn $sift(
                ray: &PreparedRay,
                reach: &Reach,
                block: &Block<'_>,
                limit: f32,
            ) -> u32 {
                let [kx, ky, kz] = ray.axes;
                let (ox, oy, oz) =
                    ($set(ray.origin[kx]), $set(ray.origin[ky]), $set(ray.origin[kz]));
                let [sx, sy, sz] = ray.shear.map(|x| $set(x));
                let zero = $set(0.0);
                let mut all = 0;
                let mut at = 0;
                while at < block.count {
                    let start = block.words.as_ptr();
                    // SAFETY: rows and what follows them are within the words, by contract.
                    let row = |corner: usize, axis: usize| unsafe {
                        $load(start.add((corner * 3 + axis) * block.stride + at))
                    };
                    let corner = |i: usize| {
                        let x = $sub(row(i, kx), ox);
                        let y = $sub(row(i, ky), oy);
                        let z = $sub(row(i, kz), oz);
                        (x, y, z, $less_product(x, sx, z), $less_product(y, sy, z))
                    };
                    let (a, b, c) = (corner(0), corner(1), corner(2));
                    let u = $product_less(c.3, b.4, $mul(c.4, b.3));
                    let v = $product_less(a.3, c.4, $mul(a.4, c.3));
                    let w = $product_less(b.3, a.4, $mul(b.4, a.3));
                    let width = $magnitudes(
                        $magnitudes($magnitudes(a.3, a.4), $magnitudes(b.3, b.4)),
                        $magnitudes(c.3, c.4),
                    );
                    let error = $product_plus($set(reach.edge), width, $set(reach.least));
                    let below = $le($min(u, $min(v, w)), $sub(zero, error));
                    let above = $le(error, $max(u, $max(v, w)));
                    let (da, db, dc) = ($mul(sz, a.2), $mul(sz, b.2), $mul(sz, c.2));
                    let nearest = $min(da, $min(db, dc));
                    let farthest = $max(da, $max(db, dc));
                    let before = $le($set(reach.t_min), farthest);
                    let behind = $le(nearest, $set(limit));
                    let mut bits: u32 = !(below & above) & before & behind;
                    // Of what follows the last triangle nothing counts.
                    bits &= (((1u64 << (block.count - at)) - 1) as u32) & ((1 << $width) - 1);
                    if bits != 0 {
                        let own = $magnitudes(
                            $magnitudes(
                                $magnitudes($magnitudes(a.0, a.1), $magnitudes(b.0, b.1)),
                                $magnitudes($magnitudes(c.0, c.1), $magnitudes(a.2, b.2)),
                            ),
                            c.2,
                        );
                        let room = $product_plus($set(CORNER_ERROR), own, width);
                        let error = $mul($mul($set(EDGE_ERROR), own), room);
                        let error = $add(error, $set(EDGE_LEAST));
                        let det = $add($add(u, v), w);
                        let size = $magnitude(det);
                        let sum = $product_plus(u, da, $product_plus(v, db, $mul(w, dc)));
                        let t = $div(sum, det);
                        let spread = $mul($set(5.0), $sub(farthest, nearest));
                        let shift = $div($product_plus(error, spread, $set(TINY)), size);
                        let deepest = $magnitudes(nearest, farthest);
                        let shift = $product_plus($set(DEPTH_ERROR), deepest, shift);
                        let sure = $le($mul($set(8.0), error), size);
                        let reached = $le($set(reach.t_min), $add(t, shift))
                            & $le($sub(t, shift), $set(limit));
                        bits &= !sure | reached;
                    }
                    all |= bits << at;
                    at += $width;
                }
                all
            }
        };
    }

    sieve!(
        sift_16,
        "avx512f,avx512dq",
        16,
        _mm512_loadu_ps,
        _mm512_set1_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        _mm512_min_ps,
        _mm512_max_ps,
        |x, s, z| _mm512_fnmadd_ps(s, z, x),
        |x, y, z| _mm512_fmsub_ps(x, y, z),
        |x, y, z| _mm512_fmadd_ps(x, y, z),
        |x| _mm512_abs_ps(x),
        // The greater of two magnitudes.
        |x, y| _mm512_range_ps::<0b1011>(x, y),
        |a, b| u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b))
    );

    sieve!(
        sift_8,
        "avx2",
        8,
        _mm256_loadu_ps,
        _mm256_set1_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        _mm256_min_ps,
        _mm256_max_ps,
        |x, s, z| _mm256_sub_ps(x, _mm256_mul_ps(s, z)),
        |x, y, z| _mm256_sub_ps(_mm256_mul_ps(x, y), z),
        |x, y, z| _mm256_add_ps(_mm256_mul_ps(x, y), z),
        |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x),
        |x, y| {
            let sign = _mm256_set1_ps(-0.0);
            _mm256_max_ps(_mm256_andnot_ps(sign, x), _mm256_andnot_ps(sign, y))
        },
        |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_ordinary(lane: &ExactLane, prepared: &PreparedRay) -> bool {
        !prepared.wide && prepared.offset == 0.0 && prepared.origin == lane.ray.origin
    }

    use splitplane_core::arithmetic::Strict;
    use splitplane_core::exact::meet;
    use splitplane_core::intersect::{Limits, SceneScale};
    use splitplane_core::ray::Culling;
    use splitplane_core::triangle::Triangle;
    use splitplane_test_support::random::Random;

    /// 16 triangles around one another: a fan, slivers, and some all over the place.
    fn triangles(random: &mut Random, scale: f64) -> Vec<Triangle> {
        let mut point = |spread: f64| [(); 3].map(|()| random.between(-spread, spread) * scale);
        let hub = point(1.0);
        let mut rim = [0, 1, 2].map(|k| hub[k] + point(0.1)[k]);
        (0..16)
            .map(|i| {
                let mut next = [0, 1, 2].map(|k| hub[k] + point(0.1)[k]);
                if i % 4 == 3 {
                    // A sliver: its third corner beside its second one.
                    next = [0, 1, 2].map(|k| rim[k] + point(1e-5)[k]);
                }
                let corners = if i % 5 == 4 {
                    [point(1.0), point(1.0), point(1.0)]
                } else {
                    [hub, rim, next]
                };
                rim = next;
                corners.map(|corner| corner.map(|x| x as f32))
            })
            .collect()
    }

    /// A block of 16 triangles, and what may be read behind it.
    fn words(triangles: &[Triangle]) -> Vec<f32> {
        let mut words = vec![0.0; 10 * 16 + 16];
        for (i, corners) in triangles.iter().enumerate() {
            for (row, &x) in corners.as_flattened().iter().enumerate() {
                words[row * 16 + i] = x;
            }
            words[9 * 16 + i] = f32::from_bits(i as u32);
        }
        words
    }

    /// A ray from near, from far or from a triangle itself to a corner, an edge, or inside.
    fn ray(random: &mut Random, triangles: &[Triangle], scale: f64) -> Ray {
        let on = |random: &mut Random| {
            let corners = random.pick(triangles);
            let mut weights = random.barycentric();
            match random.below(3) {
                0 => weights = [0.0, 1.0, 0.0],
                1 => weights = [weights[0], 1.0 - weights[0], 0.0],
                _ => {}
            }
            [0, 1, 2].map(|k| (0..3).map(|i| weights[i] * f64::from(corners[i][k])).sum::<f64>())
        };
        let target = on(random);
        let away = random.direction();
        let distance = random.pick(&[0.01, 1.0, 40.0]) * scale;
        let origin = match random.below(3) {
            0 => on(random),
            _ => [0, 1, 2].map(|k| target[k] + distance * away[k]),
        };
        let origin = origin.map(|x| x as f32);
        let direction = [0, 1, 2].map(|k| (target[k] - f64::from(origin[k])) as f32);
        let ray = Ray::new(origin, direction);
        match random.below(4) {
            0 => ray.with_limits(-1.0, 1.0),
            1 => ray.with_limits(1e-6, 0.999_999),
            2 => ray.with_limits(1.0, 2.0),
            _ => ray,
        }
    }

    /// Rays and triangles that are met but were let go, those met, and those kept, of all tried. What
    /// the sieve takes for the error of an edge function is multiplied by `share`.
    fn try_out(set: InstructionSet, share: f32) -> [usize; 4] {
        let (mut lost, mut met, mut kept, mut all) = (0, 0, 0, 0);
        for round in 0..1500 {
            let mut random = Random::new(round);
            let scale = random.pick(&[1.0, 1.0, 1e-9, 1e9]);
            let triangles = triangles(&mut random, scale);
            let words = words(&triangles);
            let count = 1 + random.below(16);
            let block = Block { words: &words, stride: 16, count };
            let limits = triangles.iter().fold(Limits::NONE, |all, t| all.union(Limits::of(t)));
            let bounds = Aabb::of_points(triangles.as_flattened());
            let scene = SceneScale::new(bounds, &limits);
            for _ in 0..16 {
                let ray = ray(&mut random, &triangles[..count], scale);
                let Some(prepared) = PreparedRay::new::<Strict>(&ray, &scene) else { continue };
                let Some(mut lane) = ExactLane::new(&ray, &prepared, &bounds) else { continue };
                if !is_ordinary(&lane, &prepared) {
                    continue;
                }
                lane.reach.edge *= share;
                lane.reach.least *= share;
                let found: Vec<_> = triangles[..count]
                    .iter()
                    .map(|corners| {
                        meet(&lane.ray, corners, Culling::None).filter(|met| met.is_within_limits())
                    })
                    .collect();
                let nearest = found.iter().flatten().min_by(|a, b| a.compare_t(b));
                let stop = nearest.map_or(f64::INFINITY, |met| met.t_interval().1);
                let stop = inner_stop(stop, prepared.exponent);
                for limit in [lane.reach.t_max, lane.reach.t_max.min(stop)] {
                    // SAFETY: the caller names sets that there are; the words reach on.
                    let bits = unsafe { sift(set, &prepared, &lane.reach, &block, limit) };
                    for (i, found) in found.iter().enumerate() {
                        let wanted = found.as_ref().is_some_and(|met| {
                            limit == lane.reach.t_max
                                || nearest.is_some_and(|best| met.compare_t(best).is_le())
                        });
                        let is_kept = bits >> i & 1 != 0;
                        lost += usize::from(wanted && !is_kept);
                        met += usize::from(wanted);
                        kept += usize::from(is_kept);
                        all += 1;
                    }
                    assert_eq!(u64::from(bits) >> count, 0, "triangles that are not there");
                }
            }
        }
        [lost, met, kept, all]
    }

    #[test]
    fn what_is_met_is_kept() {
        for set in InstructionSet::available() {
            let [lost, met, kept, all] = try_out(set, 1.0);
            println!("{set:?}: {lost} lost of {met} met, {kept} kept of {all}");
            assert_eq!(lost, 0, "{set:?}: {met} met");
            // And little else: these rays are aimed at edges.
            assert!(met > 30_000 && kept < 3 * met && kept * 4 < all, "{met} {kept} {all}");
        }
    }

    /// Without the room for rounding, rays aimed at edges are lost: the test above sees that.
    #[test]
    fn too_little_room_is_seen() {
        for set in InstructionSet::available() {
            assert!(try_out(set, 0.0)[0] > 100);
        }
    }
}

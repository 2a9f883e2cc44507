//! `t` and weights of triangles for which interpolation by rounded edge functions is not accurate
//! enough: those seen at a grazing angle or from very near, slivers, and those whose edge the ray
//! passes within rounding.

use super::Candidate;
use super::prepare::scale;
use crate::aabb::{max, min};
use crate::arithmetic::{Arithmetic, Double, exponent, snap};
use crate::triangle::Triangle;

/// With edge functions from here on, per R P, the ray certainly meets the triangle itself. Images
/// err by at most 4.1 u R + u P on either axis (u = 2^-24), which changes an edge function by 4 P
/// times that; with its own roundings, 4.1 u P^2, and P <= 2.1 R that is 34 u R P. This is 64 u.
pub const ROBUST: f32 = 3.814_697_3e-6; // 2^-18

/// Sheared coordinates from here on need no scaling. A normal is then at least 2^-17 of 2^-32, its
/// product with a corner 2^-65, and the rounding error of that 2^-113: normal numbers, unless a
/// coordinate is far smaller still.
pub const WIDTH_LEAST: f32 = 1.525_878_9e-5; // 2^-16
/// Smaller ones are brought near this power of two. Distances are at most 2^19 of them, or the triangle would not be
/// [`ROBUST`]; so products of three are below 2^120.
const WIDTH_POWER: i32 = 30;

/// Distances from a plane, times its normal, count as 0 below this: they are less than their
/// rounding error where widths are [`WIDTH_LEAST`] or more, and a device that flushes subnormal
/// numbers would leave something else.
pub const DISTANCE_LEAST: f32 = 8.077_936e-28; // 2^-90

/// Images deeper than this many times their greatest sheared coordinate are needles along the ray,
/// and taken unchanged: the planes of such triangles are not known well enough.
pub const NEEDLE: f32 = 7.0;

/// Images with less area than this, where coordinates are near 1 on both axes, are taken for their longest
/// edge, from which the ray is then less than 2^-21 away.
const THIN: f32 = 4.768_371_6e-7; // 2^-21

/// Products below this, of coordinates of which the greatest is near 1, count as 0: others have 46 bits that are
/// normal numbers, so that nothing is lost on devices that flush.
const PRODUCT_LEAST: f32 = 3.308_722_5e-24; // 2^-78

/// Whether the ray passes all three edges by more than images err: then it meets the triangle itself, too. `area` is R P.
#[inline(always)]
pub(super) fn is_robust<A: Arithmetic>([u, v, w]: [f32; 3], area: f32) -> bool {
    let least = min(min(u.abs(), v.abs()), w.abs());
    least > 0.0 && A::product(area, ROBUST) <= least
}

/// Where the ray meets the plane of a triangle, and the weights of that point: from differences without error and
/// products of about 46 bits (Moeller and Trumbore 1997, with the triangle's normal). `width` is P, the greatest
/// sheared coordinate.
///
/// For triangles whose edge functions are at least [`ROBUST`] R P, and which are no deeper than [`NEEDLE`] P.
/// With N the normal, d the direction, a the first corner from the origin and L the triangle's longest extent on any axis:
///
/// - With u = 2^-24, the rounded edge functions sum to at least 192 u R P. The triangle's own, which sum to N.d / d_z,
///   differ from that by at most 76 u R P: 8 P times an image's error, and roundings. So |N.d| >= 116 u R P d_z; and L <= 2 P + 2 * 7 P = 16 P.
/// - A product of double-float numbers errs by less than 8 u^2 of its factors. A component of N is
///   below 2 L^2 and errs by 30 u^2 L^2; a dot product with N errs by less than 208 u^2 L^2 times
///   the greatest component of the other factor.
/// - `t` = N.a / N.d: the numerator moves it by 208 u^2 L^2 R / |N.d| < 1.8 u L^2 / (P d_z) <= 29 u L / d_z, and so the ray's point by
///   29 u L on any axis; the denominator by 208 u^2 L^2 d_z / |N.d| < 1.8 u L^2 / (R P) <= 58 u < 2^-18 of itself, as L <= 2 R.
/// - Weights: d x a is below 4 R and errs by 60 u^2 R; by a corner's edge, 416 u^2 R L. Over |N.d| that is less than
///   3.6 u L / P <= 58 u; with the denominator's part less than 2^-17.
///
/// N.a is exactly 0 for a ray that starts in a plane across an axis.
pub fn refined<A: Arithmetic>(
    origin: &[f32; 3],
    direction: &[f32; 3],
    triangle: &Triangle,
    width: f32,
) -> Candidate {
    let power = if width < WIDTH_LEAST { WIDTH_POWER - exponent(width) } else { 0 };
    // Upward, and so without error.
    let scaled = |p: &[f32; 3]| if power == 0 { *p } else { p.map(|x| scale(x, power)) };
    let ([a, b, c], origin) = (triangle.each_ref().map(scaled), scaled(origin));
    let (ab, ac, oa) = (minus::<A>(&b, &a), minus::<A>(&c, &a), minus::<A>(&a, &origin));
    let normal = cross::<A>(&ab, &ac);
    let across = cross::<A>(&direction.map(Double::from_float), &oa);
    let det = dot::<A>(&normal, &direction.map(Double::from_float));
    let distance = dot::<A>(&normal, &oa);
    let t = A::quotient(if distance.abs() < DISTANCE_LEAST { 0.0 } else { distance }, det);
    Candidate {
        t: if power == 0 { t } else { scale(t, -power) },
        u: A::quotient(-dot::<A>(&across, &ac), det),
        v: A::quotient(dot::<A>(&across, &ab), det),
    }
}

/// The difference without error.
#[inline(always)]
fn minus<A: Arithmetic>(p: &[f32; 3], q: &[f32; 3]) -> [Double; 3] {
    [0, 1, 2].map(|k| Double::difference_of::<A>(p[k], q[k]))
}

/// The cross product.
#[inline(always)]
fn cross<A: Arithmetic>(p: &[Double; 3], q: &[Double; 3]) -> [Double; 3] {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let (one, other) = (p[i].times_loosely::<A>(q[j]), p[j].times_loosely::<A>(q[i]));
        one.minus::<A>(other)
    })
}

/// The dot product, rounded.
#[inline(always)]
fn dot<A: Arithmetic>(p: &[Double; 3], q: &[Double; 3]) -> f32 {
    let parts = [0, 1, 2].map(|k| p[k].times_loosely::<A>(q[k]));
    let (high, first) = A::two_sum(parts[0].high, parts[1].high);
    let (high, second) = A::two_sum(high, parts[2].high);
    let low = A::sum(A::sum(parts[0].low, parts[1].low), parts[2].low);
    A::sum(high, A::sum(low, A::sum(first, second)))
}

/// Where the ray meets the image of a triangle, and the weights of that point. The image may be as thin as it likes;
/// it has an area, whose sign is that of its front or back.
///
/// Both axes are scaled by powers of two so that coordinates are near 1, which changes neither weights nor `t`.
/// The ray is within the
/// image, so this is at least 1 long on either axis. Edge functions err by less than 2^-44; where the area is at
/// least [`THIN`], the point of
/// the weights is within 2^-22 of the ray. Else the ray is within [`THIN`] of the longest edge, and the point of
/// that edge is taken which is nearest to it. With the roundings of either that is less than 2^-20, and so 16 * 2^-24 of P.
pub(super) fn careful<A: Arithmetic>(
    flat: &[[f32; 2]; 3],
    depths: &[f32; 3],
    front: bool,
) -> Candidate {
    let greatest = |k: usize| max(max(flat[0][k].abs(), flat[1][k].abs()), flat[2][k].abs());
    let powers = [-exponent(greatest(0)), -exponent(greatest(1))];
    let flat = flat.map(|[x, y]| [scale(x, powers[0]), scale(y, powers[1])]);
    let weight = |a: usize, b: usize| {
        let (one, other) =
            (product::<A>(flat[a][0], flat[b][1]), product::<A>(flat[a][1], flat[b][0]));
        let edge = if front { one.minus::<A>(other) } else { other.minus::<A>(one) };
        // The ray is inside or on the edge.
        if edge.high > 0.0 { edge } else { Double::from_float(0.0) }
    };
    let weights = [weight(2, 1), weight(0, 2), weight(1, 0)];
    let det = weights[0].plus::<A>(weights[1]).plus::<A>(weights[2]);
    if det.high < THIN {
        return on_longest_edge::<A>(&flat, depths);
    }
    let part = |i: usize| weights[i].times_float::<A>(depths[i]);
    Candidate {
        t: A::quotient(part(0).plus::<A>(part(1)).plus::<A>(part(2)).high, det.high),
        u: A::quotient(weights[1].high, det.high),
        v: A::quotient(weights[2].high, det.high),
    }
}

/// The product without error, or 0.
#[inline]
fn product<A: Arithmetic>(a: f32, b: f32) -> Double {
    let (high, low) = A::two_product(a, b);
    if high.abs() < PRODUCT_LEAST { Double::from_float(0.0) } else { Double { high, low } }
}

/// The point of an image's longest edge that is nearest to the ray.
fn on_longest_edge<A: Arithmetic>(flat: &[[f32; 2]; 3], depths: &[f32; 3]) -> Candidate {
    let (mut longest, mut hit) = (0.0, Candidate { t: depths[0], u: 0.0, v: 0.0 });
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (p, q) = (flat[i], flat[j]);
        let edge = [A::difference(q[0], p[0]), A::difference(q[1], p[1])];
        let squared = A::snapped_sum(
            A::snapped_product(edge[0], edge[0]),
            A::snapped_product(edge[1], edge[1]),
        );
        if squared > longest {
            longest = squared;
            let along = product::<A>(edge[0], p[0]).plus::<A>(product::<A>(edge[1], p[1])).high;
            let along = snap(min(max(A::quotient(-along, squared), 0.0), 1.0));
            let depth = A::product(along, A::difference(depths[j], depths[i]));
            let mut weights = [0.0; 3];
            (weights[i], weights[j]) = (A::difference(1.0, along), along);
            hit = Candidate { t: A::sum(depths[i], depth), u: weights[1], v: weights[2] };
        }
    }
    hit
}

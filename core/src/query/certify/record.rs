//! The record of a hit whose triangle is known: distance and weights as [`exact`](crate::exact) rounds them, where
//! bounds on every error leave no doubt about their last bits.

use super::{Known, Normal, cross, cross_of_sizes, dot, minus, quotient};
use crate::aabb::max;
use crate::arithmetic::{Arithmetic, Double, exponent, snap};
use crate::query::intersect::scale;
use crate::ray::{Hit, Ray};
use crate::triangle::Triangle;

/// What a term of a point may lose, unless it has a factor of zero: what flushing takes is far below 2^-40 of it.
const TERM_LEAST: f32 = 2.117_582_4e-22; // 2^-72
/// Error of a weight as `exact` computes it in `f64`, per unit of the direction times the longest side times the farthest
/// corner over the denominator: 60 roundings of 2^-53, two and a half times, and slack.
const WIDE_NOISE: f32 = 2.842_171e-14; // 2^-45
/// Weights that `f64` may know less well than this are left to the CPU, which then computes them in another way.
const WIDE_MOST: f32 = 2.328_306_4e-10; // 2^-32
/// What adding to the low part of a number rounds away, per unit of it and of the error: 2^-24, and slack.
const ROUNDING: f32 = 2.384_185_8e-7; // 2^-22
/// Weights below this are left to the CPU.
const WEIGHT_LEAST: f32 = 8.673_617_4e-19; // 2^-60
/// Least exponent of a distance, as it is and as it was scaled, that is told: far from all limits of floats.
const EXPONENT_LEAST: i32 = -100;
/// See [`EXPONENT_LEAST`].
const EXPONENT_MOST: i32 = 99;

/// A number rounded to the nearest float; `None` where that may be another one.
fn rounded<A: Arithmetic>(value: Double, error: f32) -> Option<f32> {
    let Double { high, low } = value;
    let reach = A::sum(error, A::product(A::sum(error, low.abs()), ROUNDING));
    let up = A::sum(high, A::sum(low, reach));
    let down = A::sum(high, A::difference(low, reach));
    (up == high && down == high).then_some(high)
}

/// A distance, in the ray's own units, as it is reported: the exact one rounded to nearest. `None` where that is not certain.
pub(super) fn rounded_distance<A: Arithmetic>(t: Double, error: f32, power: i32) -> Option<f32> {
    if error == 0.0 {
        // Exactly zero.
        return Some(0.0);
    }
    let inner = rounded::<A>(t, error)?;
    let here = exponent(inner);
    let plain = |power| (EXPONENT_LEAST..=EXPONENT_MOST).contains(&power);
    (plain(here) && plain(here - power)).then(|| scale(inner, -power))
}

/// A vector of doubles, and bounds on what its components are made of.
struct Point {
    parts: [Double; 3],
    sizes: [f32; 3],
}

/// The way to the first corner from near where the ray meets the plane: the corner less the origin less `t` directions.
/// It may be taken in place of the way from the origin, since the weights do not depend on where on the ray one starts;
/// it is as short as the triangle is, and so are the errors.
fn way<A: Arithmetic>(corner: &[Double; 3], t: f32, direction: &[f32; 3]) -> Point {
    let mut out = Point { parts: *corner, sizes: [0.0; 3] };
    for axis in 0..3 {
        let (high, low) = A::two_product(t, direction[axis]);
        let first = Double::difference_of::<A>(corner[axis].high, high);
        let second = Double::difference_of::<A>(corner[axis].low, low);
        out.parts[axis] = first.plus::<A>(second);
        let size = max(first.high.abs(), second.high.abs());
        let is_nothing = t == 0.0 || direction[axis] == 0.0;
        out.sizes[axis] = if is_nothing { size } else { max(size, TERM_LEAST) };
    }
    out
}

fn greatest(p: &[Double; 3]) -> f32 {
    max(max(p[0].high.abs(), p[1].high.abs()), p[2].high.abs())
}

/// A weight, from its share of the denominator; `wide` is what `exact` may err.
fn weight<A: Arithmetic>(share: &Known, whole: &Known, wide: f32) -> Option<f32> {
    if share.error == 0.0 {
        return None;
    }
    let (value, error) = quotient::<A>(share, whole)?;
    let weight = rounded::<A>(value, A::sum(error, wide))?;
    (WEIGHT_LEAST..=1.0).contains(&weight).then_some(weight)
}

/// The record of a hit of a ray at a triangle (snapped corners) that [`trace`](super::trace) found to be its hit: what
/// [`exact`](crate::exact) gives, bit for bit. `None` where that is not certain.
pub fn record<A: Arithmetic>(ray: &Ray, corners: &Triangle, triangle: u32) -> Option<Hit> {
    let given = ray.direction.map(snap);
    let power = exponent(max(max(given[0].abs(), given[1].abs()), given[2].abs()));
    let direction = given.map(|d| scale(d, -power));
    let origin = ray.origin.map(snap);
    let doubled = direction.map(Double::from_float);
    let [a, b, c] = corners;
    let (ab, ac, oa) = (minus::<A>(b, a), minus::<A>(c, a), minus::<A>(a, &origin));
    let normal: Normal = cross::<A>(&ab, &ac);
    let whole = dot::<A>(&normal, &doubled);
    let speed = whole.value.high.abs();
    if speed <= A::product(2.0, whole.error) {
        return None;
    }
    let (t, error) = quotient::<A>(&dot::<A>(&normal, &oa), &whole)?;
    let way = way::<A>(&oa, t.high, &direction);
    let sizes = |p: &[Double; 3]| p.map(|x| x.high.abs());
    let of_second = cross_of_sizes::<A>(&ac, &way.parts, &sizes(&ac), &way.sizes);
    let of_third = cross_of_sizes::<A>(&way.parts, &ab, &way.sizes, &sizes(&ab));
    let longest = max(greatest(&ab), greatest(&ac));
    let farthest = max(longest, greatest(&oa));
    let reach = A::product(A::product(longest, farthest), WIDE_NOISE);
    // The direction's greatest component is below 2.
    let wide = A::quotient(A::product(2.0, reach), speed);
    if wide >= WIDE_MOST {
        return None;
    }
    let u = weight::<A>(&dot::<A>(&of_second, &doubled), &whole, wide)?;
    let v = weight::<A>(&dot::<A>(&of_third, &doubled), &whole, wide)?;
    let t = rounded_distance::<A>(t, error, power)?;
    let v = if A::sum(u, v) > 1.0 { A::difference(1.0, u) } else { v };
    Some(Hit { t, triangle, u, v })
}

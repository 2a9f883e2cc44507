//! `t` and weights of triangles that interpolation by rounded edge functions does not serve: those seen
//! at a grazing angle or from very near, slivers, and those whose edge the ray passes within rounding.

use super::Candidate;
use super::prepare::scale;
use crate::aabb::{max, min};
use crate::arithmetic::{Arithmetic, Double, exponent, snap};
use crate::triangle::Triangle;

/// Edge functions from here on, per R P, leave no doubt that the ray meets the triangle itself. Images err by at most
/// 4.1 u R + u P on either axis (u = 2^-24), which changes an edge function by 4 P times that; with its own
/// roundings, 4.1 u P^2, and P <= 2.1 R that is 34 u R P. This is 64 u.
pub const ROBUST: f32 = 3.814_697_3e-6; // 2^-18

/// Sheared coordinates from here on need no scaling: products of two, and what rounding leaves of these, are well above
/// the least normal number.
pub const WIDTH_LEAST: f32 = 9.313_226e-10; // 2^-30

/// Images deeper than this many times their greatest sheared coordinate are needles along the ray: their planes are found
/// less well than their depths at the ray.
pub const NEEDLE: f32 = 7.0;

/// Images with less area than this, where coordinates are near 1 on both axes, are taken for their longest
/// edge, from which the ray is then less than 2^-21 away.
const THIN: f32 = 4.768_371_6e-7; // 2^-21

/// Coordinates below this, where the greatest is near 1, count as 0: products of two are then multiples of the least
/// normal number, so that nothing is lost on devices that flush.
const FLAT_LEAST: f32 = 9.094_947e-13; // 2^-40

/// Whether the ray passes all three edges by more than images err: then it meets the triangle itself, too. `area` is R P.
#[inline(always)]
pub(super) fn is_robust<A: Arithmetic>([u, v, w]: [f32; 3], area: f32) -> bool {
    let least = min(min(u.abs(), v.abs()), w.abs());
    least > 0.0 && A::product(area, ROBUST) <= least
}

/// Where the ray meets the plane of a triangle, and the weights of that point: from differences without error and products of
/// about 46 bits. Images are not divided by the direction's largest component here, which spares rounding a slope;
/// that changes all edge functions by one factor. `width` is P, the greatest sheared coordinate; `spread` the difference of the
/// corners' depths.
///
/// With a the first corner from the origin, N the normal and d the direction, `t` is N.a / N.d, and the sum of the edge functions
/// is -d_z N.d. N.a is computed from the triangle's edges, so it is exactly 0 for a ray that starts in a plane across an axis.
///
/// For triangles whose edge functions are at least [`ROBUST`] R P: |N.d| is then at least 3 * 2^-18 R P. A step of doubled floats
/// errs by less than 2^-44 of the magnitudes that go in, so N.a, three products of a component below 2 L^2 with
/// one below R, errs by 28 * 2^-44 L^2 R, with L the triangle's longest extent, and `t` by 10 * 2^-26 L^2 / P. Where spread is at most [`NEEDLE`] P,
/// L is at most 16 P, and that is 40 * 2^-24 L. For needles `t` is the mean of the corners' depths by their weights, which errs by 2^-24 P.
pub fn refined<A: Arithmetic>(
    origin: &[f32; 3],
    direction: &[f32; 3],
    axes: [usize; 3],
    triangle: &Triangle,
    [width, spread]: [f32; 2],
) -> Candidate {
    let [dx, dy, dz] = axes.map(|axis| direction[axis]);
    let power = if width < WIDTH_LEAST { -exponent(width) } else { 0 };
    let scaled = |x: Double| Double { high: scale(x.high, power), low: scale(x.low, power) };
    let minus = |p: &[f32; 3], q: &[f32; 3]| axes.map(|k| Double::difference_of::<A>(p[k], q[k]));
    let from = triangle.map(|corner| minus(&corner, origin));
    let image = |[x, y, z]: [Double; 3]| {
        let x = x.times_float::<A>(dz).minus::<A>(z.times_float::<A>(dx));
        let y = y.times_float::<A>(dz).minus::<A>(z.times_float::<A>(dy));
        if power == 0 { [x, y] } else { [scaled(x), scaled(y)] }
    };
    let [a, b, c] = from.map(image);
    let edge =
        |p: [Double; 2], q: [Double; 2]| p[0].times::<A>(q[1]).minus::<A>(p[1].times::<A>(q[0]));
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let det = u.plus::<A>(v).plus::<A>(w);
    let t = if power == 0 && spread <= A::product(NEEDLE, width) {
        let (ab, ac) = (minus(&triangle[1], &triangle[0]), minus(&triangle[2], &triangle[0]));
        let along = |k: usize| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let normal = ab[i].times::<A>(ac[j]).minus::<A>(ab[j].times::<A>(ac[i]));
            normal.times::<A>(from[0][k])
        };
        let distance = along(0).plus::<A>(along(1)).plus::<A>(along(2));
        A::quotient(-distance.times_float::<A>(dz).high, det.high)
    } else {
        // From the corners' depths; three factors of a triangle that is scaled may underflow besides.
        let part = |weight: Double, corner: usize| weight.times::<A>(from[corner][2]);
        let sum = part(u, 0).plus::<A>(part(v, 1)).plus::<A>(part(w, 2));
        A::quotient(sum.high, det.times_float::<A>(dz).high)
    };
    Candidate { t, u: A::quotient(v.high, det.high), v: A::quotient(w.high, det.high) }
}

/// Where the ray meets the image of a triangle, and the weights of that point. The image may be as thin as it likes;
/// it has an area, whose sign is that of its front or back.
///
/// Both axes are scaled by powers of two so that coordinates are near 1, which changes neither weights nor `t`. Edge
/// functions of about 46 bits then put the point within 2^-20 of the ray, where the area is at least [`THIN`];
/// else the point of the longest edge that is nearest to the ray is as near.
pub(super) fn careful<A: Arithmetic>(
    flat: &[[f32; 2]; 3],
    depths: &[f32; 3],
    front: bool,
) -> Candidate {
    let greatest = |k: usize| max(max(flat[0][k].abs(), flat[1][k].abs()), flat[2][k].abs());
    let powers = [-exponent(greatest(0)), -exponent(greatest(1))];
    let coordinate = |x: f32, power: i32| {
        let x = scale(x, power);
        if x.abs() < FLAT_LEAST { 0.0 } else { x }
    };
    let flat = flat.map(|[x, y]| [coordinate(x, powers[0]), coordinate(y, powers[1])]);
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

/// The product without error.
#[inline]
fn product<A: Arithmetic>(a: f32, b: f32) -> Double {
    let (high, low) = A::two_product(a, b);
    Double { high, low }
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

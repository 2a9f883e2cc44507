//! Where a ray meets a triangle, decided exactly.
//!
//! With corners A, B, C relative to the origin and direction d, the three edge functions are
//! U = d.(C x B), V = d.(A x C), W = d.(B x A), positive all three or negative all three where the ray
//! passes inside. Their sum is -d.N for the triangle's normal N = (B - A) x (C - A), and the distance
//! is t = N.A / N.d.
//!
//! In `f64` they are computed as by Moeller and Trumbore 1997, from the differences ab = B - A and
//! ac = C - A: with p = d x ac and q = A x ab, V = -A.p, W = -d.q, N.d = -ab.p, N.A = ac.q. That takes
//! fewest operations, and errs with the size of the triangle times the distance, not with the distance squared.

use core::cmp::Ordering;

use super::ExactRay;
use super::doubled::{self, DOUBLED_ERROR, Doubled};
use super::integer::{Integer, quotient};
use crate::arithmetic::snap;
use crate::ray::{Culling, Hit};
use crate::triangle::Triangle;

/// Half a unit in the last place of 1 in `f64`.
pub(super) const EPSILON: f64 = f64::EPSILON / 2.0;
/// Relative to the sum of the magnitudes of its terms, a triple product of three vectors that were
/// each rounded once errs by less than this: at most eight roundings per term (one for each of
/// three factors, two products, a difference, two sums), and their products.
const TRIPLE_ERROR: f64 = 10.0 * EPSILON;

/// A number known in `f64`, and the bound on its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Approximate {
    pub value: f64,
    pub error: f64,
}

impl Approximate {
    /// The sign, if the error does not affect it.
    #[inline(always)]
    pub(super) fn sign(self) -> Option<Ordering> {
        if self.value > self.error {
            Some(Ordering::Greater)
        } else if self.value < -self.error {
            Some(Ordering::Less)
        } else if self.error == 0.0 {
            Some(Ordering::Equal)
        } else {
            None
        }
    }
}

#[inline(always)]
pub(super) fn minus(a: &[f32; 3], b: &[f32; 3]) -> [f64; 3] {
    core::array::from_fn(|i| f64::from(a[i]) - f64::from(b[i]))
}

/// `d . (p x q)`, all three known to within one rounding per component, with the tightest error:
/// none where every term is zero.
pub(super) fn triple(d: &[f64; 3], p: &[f64; 3], q: &[f64; 3]) -> Approximate {
    let (mut value, mut magnitude) = (0.0, 0.0);
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (left, right) = (p[i] * q[j], p[j] * q[i]);
        value += d[k] * (left - right);
        magnitude += d[k].abs() * (left.abs() + right.abs());
    }
    Approximate { value, error: magnitude * TRIPLE_ERROR }
}

#[inline(always)]
fn cross_product(p: &[f64; 3], q: &[f64; 3]) -> [f64; 3] {
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
}

#[inline(always)]
fn dot(p: &[f64; 3], q: &[f64; 3]) -> f64 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

/// The greatest magnitude of a component.
#[inline(always)]
fn greatest(p: &[f64; 3]) -> f64 {
    let greater = |a: f64, b: f64| if a > b { a } else { b };
    greater(greater(p[0].abs(), p[1].abs()), p[2].abs())
}

/// `d . (p x q)` in whole numbers.
pub(super) fn triple_exactly(d: &[Integer; 3], p: &[Integer; 3], q: &[Integer; 3]) -> Integer {
    let mut sum = Integer::ZERO;
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let minor = p[i].times(&q[j]).minus(&p[j].times(&q[i]));
        sum = sum.plus(&d[k].times(&minor));
    }
    sum
}

pub(super) fn difference_exactly(a: &[f32; 3], b: &[f32; 3]) -> [Integer; 3] {
    core::array::from_fn(|i| Integer::difference(a[i], b[i]))
}

/// The edge functions of a ray and a triangle: U, V, W.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edges<'a> {
    pub ray: &'a ExactRay,
    pub corners: &'a Triangle,
    pub(super) approximate: [Approximate; 3],
    /// N.A.
    numerator: Approximate,
    /// N.d.
    denominator: Approximate,
}

impl<'a> Edges<'a> {
    #[inline(always)]
    pub(super) fn new(ray: &'a ExactRay, corners: &'a Triangle) -> Edges<'a> {
        let d = ray.direction.map(f64::from);
        let [a, b, c] = corners;
        let (ab, ac, oa) = (minus(b, a), minus(c, a), minus(a, &ray.origin));
        let (p, q) = (cross_product(&d, &ac), cross_product(&oa, &ab));
        let (side, far, speed) = (dot(&oa, &p), dot(&d, &q), dot(&ab, &p));
        // A triple product has six terms, each at most the product of the greatest components.
        let reach = 6.0 * TRIPLE_ERROR * greatest(&oa);
        let (wide, high) = (greatest(&ab), greatest(&ac));
        let fast = greatest(&d);
        let v = Approximate { value: -side, error: reach * fast * high };
        let w = Approximate { value: -far, error: reach * fast * wide };
        let denominator =
            Approximate { value: -speed, error: 6.0 * TRIPLE_ERROR * fast * wide * high };
        // The two sums round twice at most what they add; a quarter of the ten roundings of each is
        // more.
        let error = 1.25 * (v.error + w.error + denominator.error);
        let u = Approximate { value: speed + side + far, error };
        Edges {
            ray,
            corners,
            approximate: [u, v, w],
            numerator: Approximate { value: dot(&ac, &q), error: reach * wide * high },
            denominator,
        }
    }

    /// The two corners of each edge, in the order of their product.
    pub(super) const ENDS: [[usize; 2]; 3] = [[2, 1], [0, 2], [1, 0]];

    pub(super) fn exactly(&self, edge: usize) -> Integer {
        let [p, q] =
            Self::ENDS[edge].map(|i| difference_exactly(&self.corners[i], &self.ray.origin));
        triple_exactly(&self.ray.direction.map(Integer::from_float), &p, &q)
    }

    /// The exact sign of an edge function.
    #[inline(always)]
    pub(super) fn sign(&self, edge: usize) -> Ordering {
        match self.approximate[edge].sign() {
            Some(sign) => sign,
            None => self.sign_closely(edge),
        }
    }

    #[cold]
    fn sign_closely(&self, edge: usize) -> Ordering {
        let d = self.ray.direction.map(f64::from);
        let [p, q] = Self::ENDS[edge].map(|i| minus(&self.corners[i], &self.ray.origin));
        triple(&d, &p, &q).sign().unwrap_or_else(|| self.exactly(edge).sign())
    }

    /// The distance, of edges whose functions are not all zero.
    #[inline(always)]
    fn distance(&self) -> Approximate {
        let (mut numerator, mut denominator) = (self.numerator, self.denominator);
        if numerator.sign().is_none() || denominator.sign().is_none() {
            (numerator, denominator) = self.plane_closely();
        }
        let value = numerator.value / denominator.value;
        let error = if denominator.value.abs() > 2.0 * denominator.error {
            // (n + e) / (d + f) - n / d = (e - f n / d) / (d + f), and |d + f| > |d| / 2; then the
            // rounding of the quotient and of this.
            let spread = numerator.error + denominator.error * value.abs();
            2.1 * spread / denominator.value.abs() + 2.0 * EPSILON * value.abs()
        } else {
            f64::INFINITY
        };
        // A quotient of subnormal numbers is no estimate; no other case gets here.
        Approximate { value, error: if value.is_finite() { error } else { f64::INFINITY } }
    }

    /// N.A and N.d with tight errors: they show when a ray starts in the plane.
    #[cold]
    fn plane_closely(&self) -> (Approximate, Approximate) {
        let [a, b, c] = self.corners;
        let (ab, ac, oa) = (minus(b, a), minus(c, a), minus(a, &self.ray.origin));
        (triple(&oa, &ab, &ac), triple(&self.ray.direction.map(f64::from), &ab, &ac))
    }
}

/// A triangle that a ray's line meets.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    ray: ExactRay,
    corners: Triangle,
    /// The distance.
    t: Approximate,
    /// V and W, the weights of the second and third corner before division by the sum of all.
    weights: [f64; 2],
    /// That sum, -N.d.
    sum: f64,
    /// The bounds on the errors of these three.
    error: f64,
    front: bool,
}

/// Whether the line of a ray meets a closed triangle ([snapped corners](crate::triangle::prepare)), in both
/// directions and whatever the limits.
#[inline]
pub fn meet(ray: &ExactRay, corners: &Triangle, culling: Culling) -> Option<Meeting> {
    let edges = Edges::new(ray, corners);
    let (mut positive, mut negative) = (false, false);
    for edge in 0..3 {
        match edges.sign(edge) {
            Ordering::Less => negative = true,
            Ordering::Equal => {}
            Ordering::Greater => positive = true,
        }
        if positive && negative {
            return None;
        }
    }
    // With none of either sign the triangle has no area as the ray sees it.
    let front = positive;
    let culled = match culling {
        Culling::None => false,
        Culling::Back => !front,
        Culling::Front => front,
    };
    ((positive || negative) && !culled).then(|| Meeting::new(&edges, front))
}

impl Meeting {
    #[inline(always)]
    pub(super) fn new(edges: &Edges<'_>, front: bool) -> Meeting {
        let [_, v, w] = edges.approximate;
        Meeting {
            ray: *edges.ray,
            corners: *edges.corners,
            t: edges.distance(),
            weights: [v.value, w.value],
            sum: -edges.denominator.value,
            error: v.error.max(w.error).max(edges.denominator.error),
            front,
        }
    }

    /// Whether the ray comes from the side from which the corners run counter-clockwise.
    pub fn is_front(&self) -> bool {
        self.front
    }

    fn normal_products(&self) -> (Integer, Integer) {
        let [a, b, c] = &self.corners;
        let (ab, ac) = (difference_exactly(b, a), difference_exactly(c, a));
        let numerator = triple_exactly(&difference_exactly(a, &self.ray.origin), &ab, &ac);
        let denominator = triple_exactly(&self.ray.direction.map(Integer::from_float), &ab, &ac);
        (numerator, denominator)
    }

    /// An interval of `f64` that holds the distance; unbounded where `f64` cannot decide.
    #[inline]
    pub fn t_interval(&self) -> (f64, f64) {
        if self.t.error.is_finite() {
            (self.t.value - self.t.error, self.t.value + self.t.error)
        } else {
            (f64::NEG_INFINITY, f64::INFINITY)
        }
    }

    /// How the exact distance compares with a limit, which is not NaN.
    #[inline]
    pub fn compare_limit(&self, limit: f32) -> Ordering {
        let (least, most) = self.t_interval();
        let wide = f64::from(limit);
        if most < wide {
            Ordering::Less
        } else if least > wide {
            Ordering::Greater
        } else {
            self.compare_limit_exactly(limit)
        }
    }

    #[cold]
    fn compare_limit_exactly(&self, limit: f32) -> Ordering {
        if limit.is_infinite() {
            return if limit > 0.0 { Ordering::Less } else { Ordering::Greater };
        }
        let (numerator, denominator) = self.normal_products();
        // In units of 2^-149 each: the distance counts in whole ones, the limit in parts.
        let one = Integer::from_float(1.0);
        let difference =
            numerator.times(&one).minus(&denominator.times(&Integer::from_float(limit))).sign();
        if denominator.sign().is_lt() { difference.reverse() } else { difference }
    }

    /// Whether the exact distance lies between the ray's limits, both included.
    #[inline]
    pub fn is_within_limits(&self) -> bool {
        self.compare_limit(self.ray.t_min).is_ge() && self.compare_limit(self.ray.t_max).is_le()
    }

    /// How the exact distances of two meetings of one ray compare.
    #[inline]
    pub fn compare_t(&self, other: &Meeting) -> Ordering {
        let ((a, b), (c, d)) = (self.t_interval(), other.t_interval());
        if b < c {
            Ordering::Less
        } else if a > d {
            Ordering::Greater
        } else {
            self.compare_t_exactly(other)
        }
    }

    #[cold]
    fn compare_t_exactly(&self, other: &Meeting) -> Ordering {
        if self.corners == other.corners {
            return Ordering::Equal;
        }
        self.compare_planes(other).unwrap_or_else(|| self.compare_t_by_integers(other))
    }

    /// The same where both triangles are perpendicular to one axis, as nearly all that lie on one another are: without whole numbers, which
    /// take thousands of instructions.
    pub(super) fn compare_planes(&self, other: &Meeting) -> Option<Ordering> {
        let flat = |corners: &Triangle, axis: usize| {
            let [a, b, c] = corners.map(|corner| corner[axis]);
            a == b && b == c
        };
        let axis = (0..3).find(|&axis| flat(&self.corners, axis) && flat(&other.corners, axis))?;
        // The distances are these numbers less the origin's, over the direction's, which is not 0: a ray along such a triangle does not meet it.
        let order = self.corners[0][axis].partial_cmp(&other.corners[0][axis])?;
        Some(if self.ray.direction[axis] < 0.0 { order.reverse() } else { order })
    }

    pub(super) fn compare_t_by_integers(&self, other: &Meeting) -> Ordering {
        let ((n, d), (m, e)) = (self.normal_products(), other.normal_products());
        let difference = n.times(&e).minus(&m.times(&d)).sign();
        if d.sign() == e.sign() { difference } else { difference.reverse() }
    }

    /// The distance, rounded to nearest; below 2^-126 it is 0, beyond `f32::MAX` that.
    #[inline]
    pub fn t(&self) -> f32 {
        let (least, most) = self.t_interval();
        let (low, high) = (least as f32, most as f32);
        // Rounding is monotone: equal ends, equal in between.
        if low == high && low.abs() >= f32::MIN_POSITIVE && low.is_finite() {
            return low;
        }
        self.t_exactly()
    }

    #[cold]
    fn t_exactly(&self) -> f32 {
        let (numerator, denominator) = self.normal_products();
        quotient(&numerator, &denominator)
    }

    /// The weights of the second and third corner, each within 2^-24 of what they are, in `[0, 1]`.
    #[inline]
    pub fn weights(&self) -> [f32; 2] {
        // (v + e) / (s + f) - v / s = (e - f v / s) / (s + f), and v / s is at most 1: this is below
        // 2^-29, and rounding to `f32` is half of 2^-24.
        let known = 8.0 * self.error < self.sum.abs() * WEIGHT_ERROR;
        [0, 1].map(|i| {
            if known {
                // Snapped, since a small one may be -0.
                snap((self.weights[i] / self.sum) as f32).clamp(0.0, 1.0)
            } else {
                self.weight_closely(i)
            }
        })
    }

    /// A weight from sums of two `f64`, or, where these do not decide it, from whole numbers.
    #[cold]
    pub(super) fn weight_closely(&self, i: usize) -> f32 {
        let edge = |[p, q]: [usize; 2]| {
            let from = |corner: usize| {
                let (corner, origin) = (&self.corners[corner], &self.ray.origin);
                core::array::from_fn(|k| Doubled::difference(corner[k], origin[k]))
            };
            doubled::triple(&self.ray.direction, &from(p), &from(q))
        };
        let [(u, a), (v, b), (w, c)] = Edges::ENDS.map(edge);
        let sum = u.plus(v).plus(w);
        let error = DOUBLED_ERROR * (a + b + c);
        // As in `weights`, and the roundings of the quotient.
        if 8.0 * error < sum.high.abs() * WEIGHT_ERROR {
            let weight = if i == 0 { v } else { w };
            return snap((weight.high / sum.high) as f32).clamp(0.0, 1.0);
        }
        self.weight_exactly(i)
    }

    #[cold]
    pub(super) fn weight_exactly(&self, i: usize) -> f32 {
        let edges = Edges::new(&self.ray, &self.corners);
        let [u, v, w] = [0, 1, 2].map(|edge| edges.exactly(edge));
        let sum = u.plus(&v).plus(&w);
        quotient(if i == 0 { &v } else { &w }, &sum)
    }

    /// The record of this hit.
    #[inline]
    pub fn hit(&self, triangle: u32) -> Hit {
        let [u, v] = self.weights();
        Hit { t: self.t(), triangle, u, v: if u + v > 1.0 { 1.0 - u } else { v } }
    }
}

/// The precision, as a part of the sum, to which `f64` must know weights; otherwise whole numbers
/// are used: 2^-27.
const WEIGHT_ERROR: f64 = 1.0 / (1u64 << 27) as f64;

#[cfg(all(test, feature = "alloc"))]
impl Edges<'_> {
    /// N.A and N.d in `f64`.
    pub(super) fn plane(&self) -> [Approximate; 2] {
        [self.numerator, self.denominator]
    }
}

#[cfg(all(test, feature = "alloc"))]
impl Meeting {
    /// Numerator and denominator of the distance in whole numbers.
    pub(super) fn parts(&self) -> (Integer, Integer) {
        self.normal_products()
    }
}

//! A ray, ready for shapes, and the part of it that is in one.

use crate::arithmetic::{Arithmetic, exponent, power_of_two, snap};
use crate::ray::Ray;

/// What is not greater than this part of another is nothing beside it: its effect is far below one rounding. 2^-60, of squares.
pub(super) const NOTHING: f32 = 8.673_617_4e-19;

/// A ray in the form that tests of shapes share.
///
/// The origin is taken by a quarter, so that no difference of two points overflows. The direction is scaled by a power of two, so that its
/// greatest component is in [1, 4).
#[derive(Clone, Copy, Debug)]
pub struct ShapeRay {
    pub(super) origin: [f32; 3],
    pub(super) direction: [f32; 3],
    /// The direction's square, in [1, 48).
    pub(super) squared: f32,
    /// The direction was divided by two to this power.
    exponent: i32,
}

/// The part of a ray's line that is in a shape, by `t`: it comes in at the lower end, from the front, and leaves at the upper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where the line enters and leaves. Not finite where that is beyond the floats.
    pub t: [f32; 2],
    /// How far along the axis of a capsule that is, from 0 at the first end to 1; 0 for a sphere.
    pub u: [f32; 2],
}

impl ShapeRay {
    /// A ray that can be traced; `None` for one that hits nothing (see [`Ray`]).
    pub fn new<A: Arithmetic>(ray: &Ray) -> Option<ShapeRay> {
        let direction = ray.direction.map(snap);
        let greatest = greatest(direction);
        let finite = ray.origin.iter().chain(&direction).all(|x| x.abs() <= f32::MAX);
        let some_t = ray.t_min <= ray.t_max;
        if !(finite && some_t) || greatest == 0.0 {
            return None;
        }
        // The reciprocal of a greater power of two is no normal float.
        let exponent = exponent(greatest).min(126);
        let factor = power_of_two(-exponent);
        let direction = direction.map(|x| A::snapped_product(x, factor));
        let origin = ray.origin.map(quarter::<A>);
        Some(ShapeRay { origin, direction, squared: dot::<A>(direction, direction), exponent })
    }

    /// The `t` of the caller's ray, from that of a scaled one whose lengths were divided by two to this power, besides the quarter. Two
    /// products, since one power of two may be beyond the floats.
    pub(super) fn outer<A: Arithmetic>(&self, t: f32, size: i32) -> f32 {
        let power = size + 2 - self.exponent;
        let half = power / 2;
        let first = A::snapped_product(t, power_of_two(half));
        A::snapped_product(first, power_of_two(power - half))
    }

    /// Where the line is in a ball about the point 0, as seen from `from`, in scaled lengths; `None` for nowhere.
    pub(super) fn in_ball<A: Arithmetic>(&self, from: [f32; 3], radius: f32) -> Option<[f32; 2]> {
        within_radius::<A>(from, self.direction, self.squared, radius)
    }
}

/// Where the line `from + t along` is within a radius of the point 0: from its nearest point by the root of what is left of the radius's
/// square. `squared` is that of `along`, and not 0.
pub(super) fn within_radius<A: Arithmetic>(
    from: [f32; 3],
    along: [f32; 3],
    squared: f32,
    radius: f32,
) -> Option<[f32; 2]> {
    let nearest = ratio::<A>(-dot::<A>(from, along), squared);
    let mut point = [0.0; 3];
    for axis in 0..3 {
        let moved = A::snapped_product(nearest, along[axis]);
        point[axis] = A::snapped_sum(from[axis], moved);
    }
    let left = A::snapped_difference(A::snapped_product(radius, radius), dot::<A>(point, point));
    if left < 0.0 {
        return None;
    }
    let half = A::root(ratio::<A>(left, squared));
    Some([A::snapped_difference(nearest, half), A::snapped_sum(nearest, half)])
}

/// `(a0 b0 + a1 b1) + a2 b2`, each operation snapped.
#[inline]
pub(super) fn dot<A: Arithmetic>(a: [f32; 3], b: [f32; 3]) -> f32 {
    let two = A::snapped_sum(A::snapped_product(a[0], b[0]), A::snapped_product(a[1], b[1]));
    A::snapped_sum(two, A::snapped_product(a[2], b[2]))
}

/// A quotient, snapped.
#[inline]
pub(super) fn ratio<A: Arithmetic>(a: f32, b: f32) -> f32 {
    snap(A::quotient(a, b))
}

/// The difference of two points, component by component.
#[inline]
pub(super) fn minus<A: Arithmetic>(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|axis| A::snapped_difference(a[axis], b[axis]))
}

/// Every component times a factor.
#[inline]
pub(super) fn times<A: Arithmetic>(a: [f32; 3], factor: f32) -> [f32; 3] {
    a.map(|x| A::snapped_product(x, factor))
}

/// A quarter of a length.
#[inline]
pub(super) fn quarter<A: Arithmetic>(x: f32) -> f32 {
    A::snapped_product(snap(x), 0.25)
}

/// The greatest magnitude of a component.
#[inline]
pub(super) fn greatest(v: [f32; 3]) -> f32 {
    let two = if v[1].abs() > v[0].abs() { v[1].abs() } else { v[0].abs() };
    if v[2].abs() > two { v[2].abs() } else { two }
}

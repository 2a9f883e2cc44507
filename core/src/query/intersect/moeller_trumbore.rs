//! The fast test, which is not watertight.

use super::{Candidate, PreparedRay};
use crate::arithmetic::Arithmetic;
use crate::ray::Culling;
use crate::triangle::Triangle;

/// The fast test: Moeller and Trumbore 1997. Not watertight.
#[inline]
pub fn moeller_trumbore<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
) -> Option<Candidate> {
    let minus = |p: &[f32; 3], q: &[f32; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let cross = |p: [f32; 3], q: [f32; 3]| {
        [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
    };
    let [a, b, c] = triangle;
    let (ab, ac) = (minus(b, a), minus(c, a));
    let p = cross(ray.direction, ac);
    let det = dot(ab, p);
    let culled = match culling {
        Culling::None => false,
        Culling::Back => det < 0.0,
        Culling::Front => det > 0.0,
    };
    if det == 0.0 || culled {
        return None;
    }
    let inverse = A::free_reciprocal(det);
    let ao = minus(&ray.origin, a);
    let u = dot(ao, p) * inverse;
    let q = cross(ao, ab);
    let v = dot(ray.direction, q) * inverse;
    let t = dot(ac, q) * inverse;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= ray.t_min && t <= ray.t_max;
    inside.then_some(Candidate { t, u, v })
}

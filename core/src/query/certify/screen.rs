//! Which triangles a ray certainly misses, by edge functions in `f32` and bounds on their errors, and of which
//! rays that can be told.

use crate::aabb::{max, min};
use crate::arithmetic::{Arithmetic, snap};
use crate::query::intersect::{EDGE_LEAST, PreparedRay};
use crate::ray::{Culling, Ray};
use crate::triangle::Triangle;

/// Error of a sheared coordinate, per unit of the corners' greatest distance on any axis: 6
/// roundings of 2^-24 (one of the difference, three of slope, difference and product, two of the
/// last difference), slopes below 2^-40 taken as zero, and slack.
const BLUR: f32 = 4.768_371_6e-7; // 2^-21
/// Error of an edge function, per unit of the blur times the greatest sheared coordinate and blur:
/// 4 for blurred coordinates, 1 for roundings of its own, 2 for the blur squared, and slack.
const EDGE_BLUR: f32 = 8.0;
/// Relative error of the depth of a corner: three roundings, and slack.
const DEPTH_NOISE: f32 = 9.536_743e-7; // 2^-20
/// Components of a direction below this, but not zero, are not known to be without error.
const DIRECTION_KNOWN: f32 = 7.888_609e-31; // 2^-100

/// Whether preparation left a ray unchanged, and the ray is in the range in which the bounds hold.
#[inline]
pub(super) fn is_as_given(ray: &Ray, prepared: &PreparedRay) -> bool {
    let mut same = !prepared.wide && prepared.offset == 0.0;
    for axis in 0..3 {
        same &= prepared.origin[axis] == snap(ray.origin[axis]);
        same &=
            snap(ray.direction[axis]) == 0.0 || prepared.direction[axis].abs() >= DIRECTION_KNOWN;
    }
    same
}

/// A triangle that a ray may meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Screened {
    /// The sheared corners.
    pub(super) flat: [[f32; 2]; 3],
    pub(super) edges: [f32; 3],
    /// What an edge function may err.
    pub(super) margin: f32,
    /// The triangle is met no nearer than at this inner `t`.
    pub(super) nearest: f32,
}

/// `None` for a triangle (snapped corners) that is certainly not met from a side that counts, nor
/// [crossed](crate::exact::cross), between the ray's limits and at `farthest`, an inner `t`, or nearer.
#[inline(always)]
pub(super) fn screen<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
    farthest: f32,
) -> Option<Screened> {
    let [kx, ky, kz] = ray.axes;
    let [sx, sy, sz] = ray.shear;
    let mut from = [[0.0; 3]; 3];
    let mut flat = [[0.0; 2]; 3];
    let (mut reach, mut width) = (0.0, 0.0);
    for corner in 0..3 {
        let p = &triangle[corner];
        let x = A::difference(p[kx], ray.origin[kx]);
        let y = A::difference(p[ky], ray.origin[ky]);
        let z = A::difference(p[kz], ray.origin[kz]);
        from[corner] = [x, y, z];
        let [x, y] = [A::difference(x, A::product(sx, z)), A::difference(y, A::product(sy, z))];
        flat[corner] = [x, y];
        for away in from[corner] {
            reach = max(reach, away.abs());
        }
        width = max(width, max(x.abs(), y.abs()));
    }
    let blur = A::product(reach, BLUR);
    let [a, b, c] = flat;
    for k in 0..2 {
        let (least, most) = (min(min(a[k], b[k]), c[k]), max(max(a[k], b[k]), c[k]));
        if least > blur || most < -blur {
            return None;
        }
    }
    let edges = [edge::<A>(&c, &b), edge::<A>(&a, &c), edge::<A>(&b, &a)];
    let blurred = A::product(A::product(blur, EDGE_BLUR), A::sum(width, blur));
    let margin = A::sum(blurred, EDGE_LEAST);
    let positive = edges[0] > margin || edges[1] > margin || edges[2] > margin;
    let negative = edges[0] < -margin || edges[1] < -margin || edges[2] < -margin;
    let culled = match culling {
        Culling::None => false,
        Culling::Back => negative,
        Culling::Front => positive,
    };
    if (positive && negative) || culled {
        return None;
    }
    let depths = from.map(|away| A::product(sz, away[2]));
    let nearest = min(min(depths[0], depths[1]), depths[2]);
    let greatest = max(max(depths[0], depths[1]), depths[2]);
    let nearest = A::difference(nearest, A::product(nearest.abs(), DEPTH_NOISE));
    let greatest = A::sum(greatest, A::product(greatest.abs(), DEPTH_NOISE));
    if nearest > min(farthest, ray.t_max) || greatest < ray.t_min {
        return None;
    }
    Some(Screened { flat, edges, margin, nearest })
}

/// An edge function: twice the signed area of the origin and two sheared corners.
#[inline(always)]
fn edge<A: Arithmetic>(p: &[f32; 2], q: &[f32; 2]) -> f32 {
    A::difference(A::product(p[0], q[1]), A::product(p[1], q[0]))
}

//! The watertight test.
//!
//! *What is met.* A corner's image is its position in the ray's sheared coordinates: the origin
//! subtracted, the direction's largest axis as z, sheared so that the ray runs along z, each step
//! rounded once (Woop, Benthin and Wald 2013). An image depends on ray and corner alone. So the
//! images of a mesh's triangles are a mesh again, as closed as the mesh is, with the ray as its z
//! axis. **The ray meets a triangle where in real arithmetic it meets the triangle's closed
//! image**; an image seen exactly edge on has no area and is met nowhere. Signs of edge functions
//! decide that, and they are exact: a rounded difference of rounded products has the right sign or
//! is zero, and zeros are decided exactly.
//!
//! *Why no ray is lost.* A ray from inside a closed mesh of images leaves it. Moved sideways by ever less,
//! so that it misses all edges and vertices, it crosses some image that is not seen edge on, and as there are
//! finitely many, one of them again and again; that image is closed, so the ray itself meets it.
//!
//! *Where.* `t` is held so close to the image that every traversal finds it; see [`finish`].

use super::closer_look::{NEEDLE, careful, is_robust, refined};
use super::prepare::{PreparedRay, scale};
use super::{Candidate, EDGE_LEAST};
use crate::aabb::{max, min};
use crate::arithmetic::{Arithmetic, exponent, snap};
use crate::ray::Culling;
use crate::triangle::Triangle;

/// The error of an interpolated `t` is at most this part of `disorder / |det|`: 92 roundings of
/// 2^-24, and a third more for those of this estimate itself.
pub const INTERPOLATION_ERROR: f32 = 7.629_394_5e-6; // 2^-17

/// Images with less area than this, per square of the greatest sheared coordinate, take the closer
/// look: weights from rounded edge functions err by less than 2^-12 then.
pub const SLIVER: f32 = 0.003_906_25; // 2^-8

/// Determinants from here on are known: edge functions that count as 0, below [`EDGE_LEAST`], are 2^-24 of it or less.
pub const DET_LEAST: f32 = 5.293_956e-23; // 2^-74

/// Sums of products of edge functions and depths from here on, times 8, are known: the loss in a
/// subnormal product is 2^-33 of the sum or less.
pub const SUM_LEAST: f32 = 8.077_936e-28; // 2^-90

/// A `t` from a closer look counts as 0 below this: its lower part may be subnormal, which a device
/// need not keep. It is less than the slack that every traversal allows for, `ORIGIN_SLACK`. Wide
/// scenes are scaled, and there it is 2^-102 of the triangle's size.
pub const T_LEAST: f32 = 5.421_011e-20; // 2^-64

/// The power of two near which the largest distance is brought in wide scenes: that of [`super::COORDINATE_MOST`].
const WIDE_POWER: i32 = 38;

/// The watertight test: where the ray meets the triangle within its limits.
#[inline]
pub fn watertight<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
) -> Option<Candidate> {
    if ray.wide {
        return watertight_wide::<A>(ray, triangle, culling);
    }
    let seen = Seen::new::<A>(ray, &ray.origin, triangle);
    let edges = seen.edges::<A>();
    let front = seen.is_front(&edges)?;
    if is_culled(front, culling) {
        return None;
    }
    finish::<A>(ray, &ray.origin, triangle, &seen, edges, front, [ray.t_min, ray.t_max])
}

/// The test where exponents leave the range of the plain one. Each corner is scaled by a power of
/// two so that its distance is near 1: its image then depends on ray and corner alone, and in an
/// edge function the scales of two corners are one factor. The remaining steps take the triangle
/// scaled as a whole, to the greatest size in scenes that are not wide; the effect of that flushing
/// on `t` is negligible.
fn watertight_wide<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
) -> Option<Candidate> {
    let mut seen = Seen { from: [[0.0; 3]; 3], flat: [[0.0; 2]; 3] };
    let mut powers = [0; 3];
    for (i, corner) in triangle.iter().enumerate() {
        let mut largest = 0.0;
        for axis in 0..3 {
            largest = max(largest, (corner[axis] * 0.5 - ray.origin[axis] * 0.5).abs());
        }
        // A corner that the ray starts at stays at 0 at any scale.
        powers[i] = if largest < f32::MIN_POSITIVE { 126 } else { -exponent(largest) };
        let origin = ray.origin.map(|x| scale(x, powers[i]));
        let corner = corner.map(|x| scale(x, powers[i]));
        (seen.from[i], seen.flat[i]) = image::<A>(ray, &origin, &corner);
    }
    let front = seen.is_front(&seen.edges::<A>())?;
    if is_culled(front, culling) {
        return None;
    }
    let power = powers[0].min(powers[1]).min(powers[2]) + WIDE_POWER;
    for (i, own) in powers.into_iter().enumerate() {
        seen.from[i] = seen.from[i].map(|x| scale(x, power - own));
        seen.flat[i] = seen.flat[i].map(|x| scale(x, power - own));
    }
    let edges = seen.edges::<A>();
    let origin = ray.origin.map(|x| scale(x, power));
    let scaled = triangle.map(|corner| corner.map(|x| scale(x, power)));
    // Scaling back may underflow or clamp: `outer_t` holds the reported `t` to the limits.
    let limits = [-f32::MAX, f32::MAX];
    let mut hit = finish::<A>(ray, &origin, &scaled, &seen, edges, front, limits)?;
    hit.t = scale(hit.t, -power);
    // Held to the inner limits as well, like that of the plain test: scaled to the caller's units,
    // a `t` before the ray's start may become 0, and whether its leaf is visited is not determined.
    (ray.t_min <= hit.t && hit.t <= ray.t_max).then_some(hit)
}

#[inline(always)]
fn is_culled(front: bool, culling: Culling) -> bool {
    match culling {
        Culling::None => false,
        Culling::Back => !front,
        Culling::Front => front,
    }
}

/// A triangle as a ray sees it.
pub(super) struct Seen {
    /// The corners less the origin, on the sheared axes.
    pub from: [[f32; 3]; 3],
    /// Sheared coordinates: those of the ray are 0.
    pub flat: [[f32; 2]; 3],
}

/// A corner less the origin, on the sheared axes, and its sheared coordinates.
#[inline(always)]
fn image<A: Arithmetic>(
    ray: &PreparedRay,
    origin: &[f32; 3],
    corner: &[f32; 3],
) -> ([f32; 3], [f32; 2]) {
    let [kx, ky, kz] = ray.axes;
    let [sx, sy, _] = ray.shear;
    let x = A::difference(corner[kx], origin[kx]);
    let y = A::difference(corner[ky], origin[ky]);
    let z = A::difference(corner[kz], origin[kz]);
    ([x, y, z], [A::difference(x, A::product(sx, z)), A::difference(y, A::product(sy, z))])
}

/// An edge function: twice the signed area of the origin and two sheared corners. Right in sign, or zero.
#[inline(always)]
fn edge<A: Arithmetic>([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let value = A::difference(A::product(ax, by), A::product(ay, bx));
    if value.abs() < EDGE_LEAST { 0.0 } else { value }
}

/// The sign of the same in real arithmetic: products of two floats are exact in `f64`.
#[inline]
fn exact_sign([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> i32 {
    let (one, other) = (f64::from(ax) * f64::from(by), f64::from(ay) * f64::from(bx));
    i32::from(one > other) - i32::from(one < other)
}

impl Seen {
    #[inline(always)]
    fn new<A: Arithmetic>(ray: &PreparedRay, origin: &[f32; 3], triangle: &Triangle) -> Seen {
        let [a, b, c] = triangle;
        let (a, b, c) =
            (image::<A>(ray, origin, a), image::<A>(ray, origin, b), image::<A>(ray, origin, c));
        Seen { from: [a.0, b.0, c.0], flat: [a.1, b.1, c.1] }
    }

    /// Edge functions opposite the first, second and third corner, rounded.
    #[inline(always)]
    fn edges<A: Arithmetic>(&self) -> [f32; 3] {
        let [a, b, c] = self.flat;
        [edge::<A>(c, b), edge::<A>(a, c), edge::<A>(b, a)]
    }

    /// Whether the image's front or its back is met, if either is.
    #[inline(always)]
    fn is_front(&self, &[u, v, w]: &[f32; 3]) -> Option<bool> {
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        if u != 0.0 && v != 0.0 && w != 0.0 { Some(u > 0.0) } else { self.is_front_exactly() }
    }

    /// The same where an edge function is zero, or rounded to it.
    #[cold]
    fn is_front_exactly(&self) -> Option<bool> {
        let [a, b, c] = self.flat;
        let signs = [exact_sign(c, b), exact_sign(a, c), exact_sign(b, a)];
        let (least, most) = (*signs.iter().min()?, *signs.iter().max()?);
        let one_side = least >= 0 || most <= 0;
        (one_side && least | most != 0).then_some(most > 0)
    }

    /// The greatest distance of a corner on any axis, and the greatest sheared coordinate.
    #[inline(always)]
    fn reach_and_width(&self) -> (f32, f32) {
        let (mut reach, mut width) = (0.0, 0.0);
        for corner in 0..3 {
            for axis in 0..3 {
                reach = max(reach, self.from[corner][axis].abs());
            }
            for axis in 0..2 {
                width = max(width, self.flat[corner][axis].abs());
            }
        }
        (reach, width)
    }
}

/// Where a triangle is met, once it is known to be.
///
/// With u = 2^-24, R the greatest distance of a corner on any axis, P the greatest sheared coordinate (at most 2.1 R)
/// and spread the difference of the corners' depths:
///
/// 1. *Interpolated* from the corners' depths by the rounded edge functions, where that is good. An
///    image's corner is 6.2 u R or less from its place without rounding, on either axis. Depth
///    changes by at most 4 P spread / |det| per unit of either axis, so the plane of the image
///    differs from that of the triangle by 50 u R P spread / |det| where the ray passes. The edge
///    functions' own roundings, 4.1 u P^2 each, add 26 of these, and those of the sum, at most 4 u
///    of the greatest depth where |det| <= 4 R P, add 16. Where R P spread <= 8 |t det|, `t` is off
///    the image by less than 2^-15 |t|, and off the triangle's plane by less than 2^-14
///    |t|.
/// 2. *Refined* ([`refined`]): grazing triangles, very near ones and slivers, where the ray passes the edges by more
///    than the images err. It then meets the triangle itself, and all three numbers are the triangle's.
/// 3. *Careful* ([`careful`]): the same beside an edge, within rounding, and needles along the ray. The numbers are
///    those of the image.
///
/// So the point at `t` is always within a few roundings of a point of the triangle, and every traversal that allows for
/// these visits the leaf which holds that point.
fn finish<A: Arithmetic>(
    ray: &PreparedRay,
    origin: &[f32; 3],
    triangle: &Triangle,
    seen: &Seen,
    [u, v, w]: [f32; 3],
    front: bool,
    [t_min, t_max]: [f32; 2],
) -> Option<Candidate> {
    let sz = ray.shear[2];
    let depths = [
        A::product(sz, seen.from[0][2]),
        A::product(sz, seen.from[1][2]),
        A::product(sz, seen.from[2][2]),
    ];
    let nearest = min(min(depths[0], depths[1]), depths[2]);
    let farthest = max(max(depths[0], depths[1]), depths[2]);
    if farthest < t_min || nearest > t_max {
        return None;
    }
    let det = A::sum(A::sum(u, v), w);
    let sum = A::sum(
        A::sum(A::product(u, depths[0]), A::product(v, depths[1])),
        A::product(w, depths[2]),
    );
    let (reach, width) = seen.reach_and_width();
    let area = A::product(reach, width);
    let spread = A::difference(farthest, nearest);
    let disorder = A::product(area, spread);
    let fat = max(A::product(A::product(width, width), SLIVER), DET_LEAST);
    let eightfold = A::product(8.0, sum.abs());
    let mut hit = if det.abs() >= fat && max(disorder, SUM_LEAST) <= eightfold {
        let t = A::quotient(sum, det);
        Candidate { t, u: A::quotient(v, det), v: A::quotient(w, det) }
    } else {
        if det.abs() >= DET_LEAST && disorder > max(eightfold, SUM_LEAST) {
            // Most such triangles are the one that the ray starts on; they need no closer look.
            let interpolated = A::quotient(sum, det);
            let error = A::product(A::quotient(disorder, det.abs()), INTERPOLATION_ERROR);
            if A::sum(interpolated, error) < t_min || A::difference(interpolated, error) > t_max {
                return None;
            }
        }
        let closer = if is_robust::<A>([u, v, w], area) && spread <= A::product(NEEDLE, width) {
            refined::<A>(origin, &ray.direction, triangle, width)
        } else {
            careful::<A>(&seen.flat, &depths, front)
        };
        Candidate { t: if closer.t.abs() < T_LEAST { 0.0 } else { closer.t }, ..closer }
    };
    hit.t = min(max(hit.t, nearest), farthest);
    // Snapped, since devices may ignore the sign of zero.
    (hit.u, hit.v) = (snap(hit.u), snap(hit.v));
    (t_min <= hit.t && hit.t <= t_max).then_some(hit)
}

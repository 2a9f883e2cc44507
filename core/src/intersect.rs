//! Rays made ready for queries, and the ray/triangle tests.
//!
//! The watertight test is Woop, Benthin and Wald 2013, in guarded arithmetic (see
//! [`crate::arithmetic`]), so that two triangles that share an edge compute its sign from the same
//! products and agree. On top of it stands a rule for `t`: interpolated from the corners where that
//! is accurate, else from the plane equation in doubled precision. Both are functions of ray and
//! triangle alone, so every traversal order, backend and preset finds the same hits.

use crate::aabb::{Aabb, max, min};
use crate::arithmetic::{Arithmetic, Double, exponent, power_of_two, snap};
use crate::ray::{Culling, Ray};
use crate::triangle::Triangle;

/// Relative widening of the distance to a plane. The accepted hit point is off the triangle by at
/// most 8 roundings (2^-24 each) of its distance to the plane on the plane's axis (differences,
/// slope, shear), which is 2^-21; this is twice that.
pub const PLANE_SLACK: f32 = 9.536_743e-7; // 2^-20
/// Absolute widening of a plane's position, per unit of the longest triangle extent: roundings of
/// corner positions and edge functions that grow with the triangle and not with the distance.
const SIZE_SLACK: f32 = 1.907_348_6e-6; // 2^-19
/// Absolute widening per unit of the scene's extent: slopes below 2^-40 count as zero, over at most
/// 101 diagonals.
const SCENE_SLACK: f32 = 2.328_306_4e-10; // 2^-32
/// A traversal may stop when the next entry lies beyond the best `t` by more than this part of it:
/// twice the bound on the error of an interpolated `t` (see `disorder`).
pub const STOP_SLACK: f32 = 1.220_703_1e-4; // 2^-13
/// What adding a moved ray's offset may round away, per unit of the offset: four roundings.
const OFFSET_SLACK: f32 = 2.384_185_8e-7; // 2^-22
/// Edge functions below this are zero, which is inside: smaller ones could depend on whether a
/// device keeps subnormal products.
pub const EDGE_LEAST: f32 = 3.155_443_6e-30; // 2^-98
/// Slopes below this are zero, so that slope times distance is never subnormal in range.
pub const SLOPE_LEAST: f32 = 9.094_947e-13; // 2^-40
/// Direction components are taken to be at least this large when dividing by them.
pub const DIRECTION_LEAST: f32 = 8.271_806e-25; // 2^-80
/// In range: no coordinate other than zero below this.
const COORDINATE_LEAST: f32 = 2.168_404_3e-19; // 2^-62
/// In range: no coordinate above this. Origins too.
pub const COORDINATE_MOST: f32 = 2.748_779e11; // 2^38
/// In range: no triangle smaller than this.
const EXTENT_LEAST: f32 = 9.094_947e-13; // 2^-40
/// Origin coordinates below this are zero, in scenes that are in range: 2^-60 is below what
/// distinguishes their coordinates.
pub const ORIGIN_LEAST: f32 = 8.673_617_4e-19; // 2^-60
/// Origins further than this many scene extents away are first moved along the ray.
const FAR: f32 = 100.0;

/// What queries must know of all triangles: the range of their coordinates and sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest magnitude of a coordinate.
    pub greatest: f32,
    /// Least magnitude of a coordinate other than zero.
    pub least: f32,
    /// Longest extent of any triangle.
    pub longest: f32,
    /// Least of the triangles' longest extents.
    pub shortest: f32,
}

impl Limits {
    /// The limits of no triangle.
    pub const NONE: Limits =
        Limits { greatest: 0.0, least: f32::MAX, longest: 0.0, shortest: f32::MAX };

    /// The limits of one triangle.
    #[inline]
    pub fn of(triangle: &Triangle) -> Limits {
        let mut limits = Limits::NONE;
        let bounds = Aabb::of_points(triangle);
        let mut longest = 0.0;
        for axis in 0..3 {
            // Halved, so that it cannot overflow, and doubled unless that would.
            longest = max(longest, bounds.half_extent(axis));
            for corner in triangle {
                let magnitude = corner[axis].abs();
                limits.greatest = max(limits.greatest, magnitude);
                if magnitude > 0.0 {
                    limits.least = min(limits.least, magnitude);
                }
            }
        }
        longest = min(longest, 0.5 * f32::MAX) * 2.0;
        (limits.longest, limits.shortest) = (longest, longest);
        limits
    }

    /// The limits of both.
    #[inline]
    #[must_use]
    pub fn union(self, other: Limits) -> Limits {
        Limits {
            greatest: max(self.greatest, other.greatest),
            least: min(self.least, other.least),
            longest: max(self.longest, other.longest),
            shortest: min(self.shortest, other.shortest),
        }
    }
}

/// What a query needs to know of the scene besides tree and triangles; made once a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneScale {
    /// Bounds of the tree.
    pub bounds: Aabb,
    /// Absolute slack of plane positions.
    pub slack: f32,
    /// Origins within are not far: no closer look is needed.
    pub near: Aabb,
    /// True when exponents leave the range in which the plain test neither overflows nor meets
    /// subnormals; then every test is scaled first.
    pub wide: bool,
}

impl SceneScale {
    /// The scale of a scene with these bounds and limits.
    pub fn new(bounds: Aabb, limits: &Limits) -> SceneScale {
        let extent = longest_extent(&bounds);
        // Half of what counts as far, and clamped: a first guess that need not be exact.
        let reach = min(extent, f32::MAX / FAR) * (0.5 * FAR);
        let mut near = bounds;
        for axis in 0..3 {
            near.lo[axis] = (bounds.lo[axis] - reach).max(-f32::MAX);
            near.hi[axis] = (bounds.hi[axis] + reach).min(f32::MAX);
        }
        SceneScale {
            bounds,
            near,
            // Each product is below its factor, and the sum of two such cannot overflow.
            // The last part matters only next to the least normal numbers, where a device may flush
            // halved positions and distances.
            slack: limits.longest * SIZE_SLACK + extent * SCENE_SLACK + 4.0 * f32::MIN_POSITIVE,
            // The bounds of a tree may be wider than its triangles, though no tree of ours has such.
            wide: limits.greatest > COORDINATE_MOST
                || bounds.lo.iter().chain(&bounds.hi).any(|x| x.abs() > COORDINATE_MOST)
                || limits.least < COORDINATE_LEAST
                || limits.shortest < EXTENT_LEAST,
        }
    }
}

/// The longest extent of a box, at most `f32::MAX`; 0 for an empty one.
fn longest_extent(bounds: &Aabb) -> f32 {
    let half = (0..3).map(|axis| bounds.half_extent(axis)).fold(0.0, max);
    min(half, 0.5 * f32::MAX) * 2.0
}

/// A ray made ready: scaled, moved near the scene, sheared.
///
/// Internally the direction is scaled by a power of two so that its largest component is in
/// `[1, 2)`; *inner* `t` counts in those units from the (possibly moved) inner origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreparedRay {
    /// Inner origin.
    pub origin: [f32; 3],
    /// Inner direction.
    pub direction: [f32; 3],
    /// Reciprocals of the direction, zero components taken as 2^-80.
    pub reciprocal: [f32; 3],
    /// Slack of the distance to a plane on each axis.
    pub slack: [f32; 3],
    /// The axes that shearing calls x, y, z: z is the direction's largest component; x and y are
    /// exchanged when it is negative, so that windings keep their sense.
    pub axes: [usize; 3],
    /// Slopes and scale: `direction[x] / direction[z]`, `direction[y] / direction[z]`,
    /// `1 / direction[z]`.
    pub shear: [f32; 3],
    /// Inner limits; for a moved ray a little wide, since moving rounds them.
    pub t_min: f32,
    /// See `t_min`.
    pub t_max: f32,
    /// The limits as given, both included: those that decide.
    pub limits: [f32; 2],
    /// Inner `t` of the given origin, negated: given = (inner + offset) * 2^-exponent.
    pub offset: f32,
    /// Exponent of the direction's scale.
    pub exponent: i32,
    /// The scaled triangle test is needed.
    pub wide: bool,
}

/// `x * 2^exponent`, clamped to finite values, subnormal results flushed.
#[inline]
pub(crate) fn scale(x: f32, exponent: i32) -> f32 {
    let scaled = if exponent.abs() <= 126 {
        x * power_of_two(exponent)
    } else {
        let half = exponent / 2;
        x * power_of_two(half) * power_of_two(exponent - half)
    };
    snap(scaled.clamp(-f32::MAX, f32::MAX))
}

impl PreparedRay {
    /// Makes a ray ready; `None` when it can hit nothing whatever the scene holds: a component that
    /// is not finite, a zero direction, a NaN limit, or no `t` between the limits.
    pub fn new<A: Arithmetic>(ray: &Ray, scene: &SceneScale) -> Option<PreparedRay> {
        // One comparison each, without branches; false for NaN and infinities.
        let mut finite = true;
        for axis in 0..3 {
            finite &= ray.origin[axis].abs() <= f32::MAX;
            finite &= ray.direction[axis].abs() <= f32::MAX;
        }
        // False for NaN limits.
        let some_t = ray.t_min <= ray.t_max;
        if !(finite & some_t) {
            return None;
        }
        let given = [snap(ray.direction[0]), snap(ray.direction[1]), snap(ray.direction[2])];
        let largest = max(max(given[0].abs(), given[1].abs()), given[2].abs());
        if largest == 0.0 || scene.bounds.is_empty() {
            return None;
        }
        let power = exponent(largest);
        let direction = [scale(given[0], -power), scale(given[1], -power), scale(given[2], -power)];
        let mut t_min = scale(ray.t_min, power);
        let mut t_max = scale(ray.t_max, power);
        let mut origin = [snap(ray.origin[0]), snap(ray.origin[1]), snap(ray.origin[2])];

        let mut offset = 0.0;
        let near = (0..3).all(|k| scene.near.lo[k] <= origin[k] && origin[k] <= scene.near.hi[k]);
        if !near && let Some(plane) = plane_before_far_origin(&origin, &direction, &scene.bounds)? {
            (offset, origin) = move_origin::<A>(&origin, &direction, plane);
            let moved = |t: f32, side: f32| {
                if t.abs() == f32::MAX {
                    return t;
                }
                let error = (t.abs() + offset.abs()) * OFFSET_SLACK;
                (t - offset + side * error).clamp(-f32::MAX, f32::MAX)
            };
            (t_min, t_max) = (moved(t_min, -1.0), moved(t_max, 1.0));
        }
        let mut wide = scene.wide;
        if !wide {
            for x in &mut origin {
                *x = if x.abs() < ORIGIN_LEAST { 0.0 } else { *x };
            }
            wide = origin.iter().any(|x| x.abs() > COORDINATE_MOST);
        }

        let mut z = 0;
        for axis in 1..3 {
            if direction[axis].abs() > direction[z].abs() {
                z = axis;
            }
        }
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            (x, y) = (y, x);
        }
        let slope = |axis: usize| {
            let slope = A::quotient(direction[axis], direction[z]);
            if slope.abs() < SLOPE_LEAST { 0.0 } else { slope }
        };
        let shear = [slope(x), slope(y), A::quotient(1.0, direction[z])];
        let reciprocal = direction.map(|d| {
            let least = if d < 0.0 { -DIRECTION_LEAST } else { DIRECTION_LEAST };
            A::free_reciprocal(if d.abs() < DIRECTION_LEAST { least } else { d })
        });
        let slack = reciprocal.map(|r| min(A::free_mul(scene.slack, r.abs()), f32::MAX));
        Some(PreparedRay {
            origin,
            direction,
            reciprocal,
            slack,
            axes: [x, y, z],
            shear,
            t_min,
            t_max,
            limits: [ray.t_min, ray.t_max],
            offset,
            exponent: power,
            wide,
        })
    }

    /// The caller's `t` for an inner one, finite; `None` when it is not within the caller's limits.
    #[inline(always)]
    pub fn outer_t<A: Arithmetic>(&self, inner: f32) -> Option<f32> {
        let t = scale(A::sum(inner, self.offset), -self.exponent);
        (self.limits[0] <= t && t <= self.limits[1]).then_some(t)
    }

    /// The inner `t` beyond which no cell can hold a hit that precedes one at inner `t`, which is
    /// `outer` to the caller.
    #[inline(always)]
    pub fn stop_after(&self, t: f32, outer: f32) -> f32 {
        // Different inner `t` may be equal outside, and then the lower index precedes: where the
        // offset's rounding makes them so, where scaling back flushes them to 0, or clamps them.
        if outer.abs() == f32::MAX {
            return f32::INFINITY;
        }
        let rounding = self.offset.abs() * OFFSET_SLACK;
        let stop = stop_after(t) + rounding;
        if outer != 0.0 {
            return stop;
        }
        let least = stop_after(scale(f32::MIN_POSITIVE, self.exponent));
        max(stop, least - self.offset + rounding)
    }

    /// The least and greatest inner `t` at which the ray may be at a plane.
    #[inline(always)]
    pub fn plane_interval<A: Arithmetic>(&self, axis: usize, position: f32) -> (f32, f32) {
        let origin = self.origin[axis];
        let t = if self.wide {
            let half = A::free_sub(position * 0.5, origin * 0.5);
            (A::free_mul(half, self.reciprocal[axis]) * 2.0).clamp(-f32::MAX, f32::MAX)
        } else {
            A::free_mul(A::free_sub(position, origin), self.reciprocal[axis])
        };
        let error = A::free_mul_add(t.abs(), PLANE_SLACK, self.slack[axis]);
        (A::free_sub(t, error), A::free_mul_add(1.0, t, error))
    }

    /// The inner interval in which the ray may be inside the bounds; `None` when it is nowhere.
    pub fn enter<A: Arithmetic>(&self, bounds: &Aabb) -> Option<(f32, f32)> {
        // Widened, since the `t` of a hit may err on either side of what its cell says.
        let (mut enter, mut exit) =
            (self.t_min - self.t_min.abs() * STOP_SLACK, stop_after(self.t_max));
        for axis in 0..3 {
            let low = self.plane_interval::<A>(axis, bounds.lo[axis]);
            let high = self.plane_interval::<A>(axis, bounds.hi[axis]);
            let (near, far) = if self.direction[axis] < 0.0 { (high, low) } else { (low, high) };
            enter = max(enter, near.0);
            exit = min(exit, far.1);
        }
        (enter <= exit).then_some((enter, exit))
    }
}

/// The axis on which an origin is furthest off and the nearer side of the bounds there, when that is
/// more than [`FAR`] extents away: such a ray is moved. `Some(None)` when it is near; `None` when it
/// is far off on an axis along which the ray does not move, so that it meets nothing.
#[allow(clippy::option_option, reason = "miss, stay and move are three answers")]
fn plane_before_far_origin(
    origin: &[f32; 3],
    direction: &[f32; 3],
    bounds: &Aabb,
) -> Option<Option<(usize, f32)>> {
    let reach = min(longest_extent(bounds), f32::MAX / FAR) * FAR;
    let (mut widest, mut axis, mut side) = (0.0, 0, 0.0);
    for k in 0..3 {
        // Halved, so that nothing overflows.
        let below = bounds.lo[k] * 0.5 - origin[k] * 0.5;
        let above = origin[k] * 0.5 - bounds.hi[k] * 0.5;
        let gap = max(below, above);
        if gap > widest {
            (widest, axis) = (gap, k);
            side = if below > above { bounds.lo[k] } else { bounds.hi[k] };
        }
    }
    if widest <= reach * 0.5 || widest == 0.0 {
        return Some(None);
    }
    (direction[axis] != 0.0).then_some(Some((axis, side)))
}

/// Moves an origin along the direction to a plane: how far, and where it comes to lie. Scaled by a
/// power of two so that the origin is near 1, and without error but for the last rounding, since
/// the way is long.
fn move_origin<A: Arithmetic>(
    origin: &[f32; 3],
    direction: &[f32; 3],
    (axis, side): (usize, f32),
) -> (f32, [f32; 3]) {
    let largest = origin.iter().fold(side.abs(), |m, x| max(m, x.abs()));
    // One below, so that the difference of two cannot overflow.
    let power = -exponent(largest) - 1;
    let from = origin.map(|x| scale(x, power));
    let way = A::difference(scale(side, power), from[axis]);
    // The way divided by a slope may be long beyond any float: then nothing is near.
    let shift = A::quotient(way, direction[axis]).clamp(-1e30, 1e30);
    let mut moved = [0.0; 3];
    for k in 0..3 {
        let (high, low) = A::two_product(shift, direction[k]);
        let (sum, rest) = A::two_sum(from[k], high);
        moved[k] = scale(A::sum(sum, A::sum(rest, low)), -power);
    }
    (scale(shift, -power), moved)
}

/// An inner `t`, and as much as interpolation may err: all of [`PreparedRay::stop_after`] for a ray that was not
/// moved and a hit whose `t` is neither 0 nor clamped.
#[inline(always)]
pub fn stop_after(t: f32) -> f32 {
    t + t.abs() * STOP_SLACK
}

/// A hit in inner units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Inner `t`.
    pub t: f32,
    /// Weight of the second corner.
    pub u: f32,
    /// Weight of the third corner.
    pub v: f32,
}

/// The watertight test: where the ray meets the triangle within its limits.
#[inline]
pub fn watertight<A: Arithmetic>(
    ray: &PreparedRay,
    triangle: &Triangle,
    culling: Culling,
) -> Option<Candidate> {
    if !ray.wide {
        return sheared::<A>(ray, &ray.origin, triangle, [ray.t_min, ray.t_max], culling);
    }
    // Scaled by a power of two, which is exact, so that the largest distance is near 1.
    let mut largest = 0.0;
    for corner in triangle {
        for axis in 0..3 {
            largest = max(largest, (corner[axis] * 0.5 - ray.origin[axis] * 0.5).abs());
        }
    }
    if largest < f32::MIN_POSITIVE {
        return None;
    }
    let power = -exponent(largest);
    // Scaling back may underflow or clamp: what is reported is held to the limits, by `outer_t`.
    let limits = [-f32::MAX, f32::MAX];
    let origin = ray.origin.map(|x| scale(x, power));
    let scaled = triangle.map(|corner| corner.map(|x| scale(x, power)));
    let mut hit = sheared::<A>(ray, &origin, &scaled, limits, culling)?;
    hit.t = scale(hit.t, -power);
    // Held to the inner limits as well, like that of the plain test: scaled to the caller's units, a
    // `t` before the ray's start may become 0, and whether its leaf is visited is a matter of luck.
    (ray.t_min <= hit.t && hit.t <= ray.t_max).then_some(hit)
}

/// An edge function: twice the signed area of the origin and two sheared corners.
#[inline(always)]
fn edge<A: Arithmetic>(ax: f32, ay: f32, bx: f32, by: f32) -> f32 {
    let value = A::difference(A::product(ax, by), A::product(ay, bx));
    if value.abs() < EDGE_LEAST { 0.0 } else { value }
}

#[inline(always)]
fn sheared<A: Arithmetic>(
    ray: &PreparedRay,
    origin: &[f32; 3],
    triangle: &Triangle,
    limits: [f32; 2],
    culling: Culling,
) -> Option<Candidate> {
    let [kx, ky, kz] = ray.axes;
    let [sx, sy, sz] = ray.shear;
    // Written out: closures over arrays of arrays are not always inlined, and this is hot.
    let mut from = [[0.0; 3]; 3];
    let mut flat = [[0.0; 2]; 3];
    for corner in 0..3 {
        let p = &triangle[corner];
        let x = A::difference(p[kx], origin[kx]);
        let y = A::difference(p[ky], origin[ky]);
        let z = A::difference(p[kz], origin[kz]);
        from[corner] = [x, y, z];
        flat[corner] = [A::difference(x, A::product(sx, z)), A::difference(y, A::product(sy, z))];
    }
    let [a, b, c] = flat;
    let u = edge::<A>(c[0], c[1], b[0], b[1]);
    let v = edge::<A>(a[0], a[1], c[0], c[1]);
    let w = edge::<A>(b[0], b[1], a[0], a[1]);
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    finish::<A>(ray, origin, triangle, &from, &flat, [u, v, w], sz, limits, culling)
}

/// The rest of the watertight test, for the few triangles whose edges enclose the ray.
#[allow(clippy::too_many_arguments, reason = "all of it is at hand in registers")]
fn finish<A: Arithmetic>(
    ray: &PreparedRay,
    origin: &[f32; 3],
    triangle: &Triangle,
    from: &[[f32; 3]; 3],
    flat: &[[f32; 2]; 3],
    [u, v, w]: [f32; 3],
    sz: f32,
    [t_min, t_max]: [f32; 2],
    culling: Culling,
) -> Option<Candidate> {
    // Signs of edge functions are never wrong, but rounding may make them zero, and zero is inside.
    // For a sliver met beside its end all three may be: the ray must also be within the bounds of
    // the sheared corners. This loses nothing, since it is exact.
    let [a, b, c] = flat;
    for k in 0..2 {
        let (least, most) = (min(min(a[k], b[k]), c[k]), max(max(a[k], b[k]), c[k]));
        if least > 0.0 || most < 0.0 {
            return None;
        }
    }
    let det = A::sum(A::sum(u, v), w);
    let culled = match culling {
        Culling::None => false,
        Culling::Back => det < 0.0,
        Culling::Front => det > 0.0,
    };
    if det == 0.0 || culled {
        return None;
    }
    // The hit lies between the nearest and the farthest corner, whatever rounding says.
    let depths =
        [A::product(sz, from[0][2]), A::product(sz, from[1][2]), A::product(sz, from[2][2])];
    let nearest = min(min(depths[0], depths[1]), depths[2]);
    let farthest = max(max(depths[0], depths[1]), depths[2]);
    if farthest < t_min || nearest > t_max {
        return None;
    }
    let sum = A::sum(
        A::sum(A::product(u, depths[0]), A::product(v, depths[1])),
        A::product(w, depths[2]),
    );
    let interpolated = A::quotient(sum, det);
    let disorder = disorder::<A>(from, flat, A::difference(farthest, nearest));
    let t = if disorder <= A::product(8.0, sum.abs()) {
        interpolated
    } else {
        // Most such triangles are the one that the ray starts on; they need no closer look.
        let error = A::product(A::quotient(disorder, det.abs()), INTERPOLATION_ERROR);
        if A::sum(interpolated, error) < t_min || A::difference(interpolated, error) > t_max {
            return None;
        }
        distance_to_plane::<A>(origin, &ray.direction, triangle)
            .unwrap_or_else(|| depth_on_longest_edge::<A>(flat, &depths))
    };
    let t = min(max(t, nearest), farthest);
    if t < t_min || t > t_max {
        return None;
    }
    // Snapped, since devices may ignore the sign of zero.
    Some(Candidate { t, u: snap(A::quotient(v, det)), v: snap(A::quotient(w, det)) })
}

/// The error of an interpolated `t` is at most this part of `disorder / |det|`: 92 roundings of
/// 2^-24, and a third more for those of this estimate itself.
pub const INTERPOLATION_ERROR: f32 = 7.629_394_5e-6; // 2^-17

/// How badly `t` interpolated from the corners may err, times the determinant and 2^24 / 92.
///
/// With u = 2^-24, R the distance of the corners, P the largest sheared coordinate (at most 2.1 R) and
/// spread the difference of the corners' depths: rounding moves each coordinate of a sheared corner by at
/// most 4.1 u R + u P <= 6.2 u R. Depth changes by at most 4 P spread / |det| per unit of either
/// coordinate, and the weights are a mean of the corners' shifts, so `t` shifts by 50 u R P spread /
/// |det|. The edge functions' own roundings, 4.1 u P^2 each, add 26 of these, and those of the sum, at
/// most 4 u of the greatest depth where `|det| <= 4 R P`, add 16. Where R P spread <= 8 |t det| all of it is
/// below 2^-14 |t|, and interpolation suffices. It does not for triangles seen at a grazing angle or
/// from very near.
#[inline]
fn disorder<A: Arithmetic>(from: &[[f32; 3]; 3], flat: &[[f32; 2]; 3], spread: f32) -> f32 {
    let (mut reach, mut width) = (0.0, 0.0);
    for corner in 0..3 {
        for axis in 0..3 {
            reach = max(reach, from[corner][axis].abs());
        }
        for axis in 0..2 {
            width = max(width, flat[corner][axis].abs());
        }
    }
    A::product(A::product(reach, width), spread)
}

/// `t` of the triangle's plane, from differences without error and products of about 46 bits; `None`
/// for a triangle without a plane or a ray within it. The watertight test uses it where interpolation
/// from the corners errs too much.
pub fn distance_to_plane<A: Arithmetic>(
    origin: &[f32; 3],
    direction: &[f32; 3],
    triangle: &Triangle,
) -> Option<f32> {
    let [a, b, c] = triangle;
    let minus = |p: &[f32; 3], q: &[f32; 3]| -> [Double; 3] {
        core::array::from_fn(|axis| Double::difference_of::<A>(p[axis], q[axis]))
    };
    let (ab, ac, oa) = (minus(b, a), minus(c, a), minus(a, origin));
    let normal: [Double; 3] = core::array::from_fn(|axis| {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        ab[i].times::<A>(ac[j]).minus::<A>(ab[j].times::<A>(ac[i]))
    });
    let dot = |other: [Double; 3]| {
        normal[0]
            .times::<A>(other[0])
            .plus::<A>(normal[1].times::<A>(other[1]))
            .plus::<A>(normal[2].times::<A>(other[2]))
            .high
    };
    let (distance, speed) = (dot(oa), dot(direction.map(Double::from_float)));
    let length =
        |edge: &[Double; 3]| max(max(edge[0].high.abs(), edge[1].high.abs()), edge[2].high.abs());
    // Below this the normal is what rounding left: the triangle is a sliver or seen edge on.
    let noise = A::product(A::product(length(&ab), length(&ac)), DOUBLE_NOISE);
    if speed.abs() <= max(noise, f32::MIN_POSITIVE) {
        return None;
    }
    let t = A::quotient(distance, speed);
    t.is_finite().then_some(t)
}

/// Products of doubles err by less than this part of their factors, with room for six of them and a
/// direction of length up to 4.
pub const DOUBLE_NOISE: f32 = 9.094_947e-13; // 2^-40

/// `t` for a triangle too thin to have a plane: where its longest edge, as the ray sees it, passes
/// the ray.
fn depth_on_longest_edge<A: Arithmetic>(flat: &[[f32; 2]; 3], depths: &[f32; 3]) -> f32 {
    let mut longest = (0.0, depths[0]);
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (p, q) = (flat[i], flat[j]);
        let edge = [A::difference(q[0], p[0]), A::difference(q[1], p[1])];
        let dot = |r: [f32; 2]| A::sum(A::product(edge[0], r[0]), A::product(edge[1], r[1]));
        // Snapped, since devices may flush it.
        let squared = snap(dot(edge));
        if squared > longest.0 {
            let along = min(max(A::quotient(-dot(p), squared), 0.0), 1.0);
            let depth = A::product(along, A::difference(depths[j], depths[i]));
            longest = (squared, A::sum(depths[i], depth));
        }
    }
    longest.1
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arithmetic::{Hostile, Strict};

    const TRIANGLE: Triangle = [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]];

    fn scene(triangles: &[Triangle]) -> SceneScale {
        let bounds = Aabb::of_points(triangles.as_flattened());
        let limits = triangles.iter().fold(Limits::NONE, |l, t| l.union(Limits::of(t)));
        SceneScale::new(bounds, &limits)
    }

    fn hit(triangle: &Triangle, ray: &Ray, culling: Culling) -> Option<f32> {
        let prepared = PreparedRay::new::<Strict>(ray, &scene(&[*triangle]))?;
        let hit = watertight::<Strict>(&prepared, triangle, culling)?;
        let hostile = PreparedRay::new::<Hostile>(ray, &scene(&[*triangle]))?;
        assert_eq!(watertight::<Hostile>(&hostile, triangle, culling), Some(hit));
        prepared.outer_t::<Strict>(hit.t)
    }

    #[test]
    fn front_is_where_corners_run_counter_clockwise() {
        let front = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -4.0]);
        let back = Ray::new([0.25, 0.25, -2.0], [0.0, 0.0, 0.5]);
        assert_eq!(hit(&TRIANGLE, &front, Culling::None), Some(0.5));
        assert_eq!(hit(&TRIANGLE, &back, Culling::None), Some(2.0));
        assert_eq!(hit(&TRIANGLE, &front, Culling::Back), Some(0.5));
        assert_eq!(hit(&TRIANGLE, &front, Culling::Front), None);
        assert_eq!(hit(&TRIANGLE, &back, Culling::Back), None);
        assert_eq!(hit(&TRIANGLE, &back, Culling::Front), Some(2.0));
        let prepared = PreparedRay::new::<Strict>(&front, &scene(&[TRIANGLE])).unwrap();
        for culling in [Culling::None, Culling::Back, Culling::Front] {
            let fast = moeller_trumbore::<Strict>(&prepared, &TRIANGLE, culling);
            assert_eq!(fast.is_some(), culling != Culling::Front);
        }
    }

    #[test]
    fn weights_belong_to_the_second_and_third_corner() {
        let ray = Ray::new([0.5, 0.125, 3.0], [0.0, 0.0, -1.0]);
        let prepared = PreparedRay::new::<Strict>(&ray, &scene(&[TRIANGLE])).unwrap();
        let hit = watertight::<Strict>(&prepared, &TRIANGLE, Culling::None).unwrap();
        assert_eq!((hit.u, hit.v), (0.5, 0.125));
    }

    #[test]
    fn limits_are_closed() {
        let ray =
            |t_min, t_max| Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -4.0]).with_limits(t_min, t_max);
        assert_eq!(hit(&TRIANGLE, &ray(0.5, 0.5), Culling::None), Some(0.5));
        assert_eq!(hit(&TRIANGLE, &ray(0.5f32.next_up(), 1.0), Culling::None), None);
        assert_eq!(hit(&TRIANGLE, &ray(-1.0, 0.5f32.next_down()), Culling::None), None);
    }

    #[test]
    fn every_scale_gives_the_same_hit() {
        for power in (-120..=120).step_by(8) {
            let triangle = TRIANGLE.map(|corner| corner.map(|x| scale(x, power)));
            let ray = Ray::new([0.25, 0.25, 1.0].map(|x| scale(x, power)), [0.0, 0.0, -4.0]);
            assert_eq!(hit(&triangle, &ray, Culling::None), Some(scale(0.5, power)), "2^{power}");
        }
    }

    #[test]
    fn directions_of_any_length_serve() {
        for power in (-126..=127).step_by(11) {
            let length = power_of_two(power);
            let ray = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -length]);
            let expected = scale(2.0, -power);
            assert_eq!(hit(&TRIANGLE, &ray, Culling::None), Some(expected), "2^{power}");
        }
    }

    #[test]
    fn far_origins_are_moved_without_losing_the_way() {
        for distance in [1e3f32, 1e5, 1e7, 1e12] {
            let ray = Ray::new([0.25, 0.25, distance], [0.0, 0.0, -1.0]);
            let t = hit(&TRIANGLE, &ray, Culling::None).unwrap();
            assert_eq!(t, distance + 1.0);
        }
    }

    #[test]
    fn a_point_just_above_a_huge_triangle_is_above_it() {
        // A tilted triangle 3,000 units wide, seen from 0.001 above: interpolation alone would err
        // by more than that.
        let triangle = [[-1500.0, -0.05, -1200.0], [1500.0, 0.3, -1100.0], [37.0, 0.1, 1300.0]];
        for k in 0..100 {
            let (u, v) = (0.1 + 0.008 * k as f64, 0.05);
            let point: [f64; 3] = core::array::from_fn(|i| {
                let [a, b, c] = triangle.map(|p: [f32; 3]| f64::from(p[i]));
                a + u * (b - a) + v * (c - a)
            });
            let origin = [point[0] as f32, (point[1] + 0.001) as f32, point[2] as f32];
            let ray = Ray::new(origin, [0.3, -1.0, 0.2]);
            let t = hit(&triangle, &ray, Culling::None).expect("above");
            assert!(t > 0.0 && t < 0.002, "{t}");
        }
    }

    #[test]
    fn rays_that_can_hit_nothing() {
        let none = |ray: Ray| PreparedRay::new::<Strict>(&ray, &scene(&[TRIANGLE])).is_none();
        let good = Ray::new([0.0; 3], [1.0, 0.0, 0.0]);
        assert!(!none(good));
        assert!(none(Ray { direction: [0.0, -0.0, 1e-40], ..good }));
        assert!(none(Ray { direction: [f32::NAN, 0.0, 1.0], ..good }));
        assert!(none(Ray { origin: [f32::INFINITY, 0.0, 1.0], ..good }));
        assert!(none(good.with_limits(1.0, 0.5)));
        assert!(none(good.with_limits(f32::NAN, 1.0)));
        assert!(none(good.with_limits(0.0, f32::NAN)));
        assert!(!none(good.with_limits(f32::NEG_INFINITY, f32::INFINITY)));
    }
}

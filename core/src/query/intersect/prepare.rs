//! Prepared rays: scaled, moved near the scene, sheared.

use super::scale::longest_extent;
use super::{
    COORDINATE_MOST, DIRECTION_LEAST, FAR, OFFSET_SLACK, ORIGIN_LEAST, PLANE_SLACK, SLOPE_LEAST,
    STOP_SLACK, SceneScale,
};
use crate::aabb::{Aabb, max, min};
use crate::arithmetic::{Arithmetic, exponent, power_of_two, snap};
use crate::ray::Ray;

/// A prepared ray: scaled, moved near the scene, sheared.
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
    /// The limits as given, both included; these decide.
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
    /// Prepares a ray; `None` when it can hit nothing whatever the scene holds: a component that
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
                *x = if x.abs() < ORIGIN_LEAST { scene.origin_least } else { *x };
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
        // Widened, since the `t` of a hit may lie outside its cell's interval on either side.
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
/// power of two so that the origin is near 1, and without error except for the last rounding, since
/// the distance is long.
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
    // The distance divided by a slope may be longer than any float: then nothing is near.
    let shift = A::quotient(way, direction[axis]).clamp(-1e30, 1e30);
    let mut moved = [0.0; 3];
    for k in 0..3 {
        let (high, low) = A::two_product(shift, direction[k]);
        let (sum, rest) = A::two_sum(from[k], high);
        moved[k] = scale(A::sum(sum, A::sum(rest, low)), -power);
    }
    (scale(shift, -power), moved)
}

/// An inner `t`, plus the error of interpolation: all of [`PreparedRay::stop_after`] for a ray that
/// was not moved and a hit whose `t` is neither 0 nor clamped.
#[inline(always)]
pub fn stop_after(t: f32) -> f32 {
    t + t.abs() * STOP_SLACK
}

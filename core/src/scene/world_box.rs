//! How wide an instance's box in the world must be, for all that roundings move: see `docs/design/scenes.md`.

use super::outline::Outline;
use super::shape::SHAPE_SLACK;
use super::transform::{Defect, ObjectSpace, SUM_ERROR, Transform, in_f64, transformed};
use crate::aabb::Aabb;

/// `u`: the relative error of one rounding of an `f32`.
const U: f64 = 1.0 / (1u64 << 24) as f64;
/// Roundings of the way into the object's space that grow with the ray's origin.
const ORIGIN_ROUNDINGS: f64 = 8.0 * U;
/// Roundings of the way into the object's space that grow with the instance's place.
const PLACE_ROUNDINGS: f64 = 5.0 * U;
/// Roundings of the geometry's traversal that grow with the distance to what it meets: 16 of a plane
/// (`PLANE_SLACK`), 8 of an origin that is moved.
const DISTANCE_ROUNDINGS: f64 = 24.0 * U;
/// `SIZE_SLACK` and twice `SCENE_SLACK`, per unit of the geometry's extent.
const SIZE_ROUNDINGS: f64 = 1.0 / (1u64 << 18) as f64 + 1.0 / (1u64 << 31) as f64;
/// Twice the geometry's slack of origins next to 0: also covers what is flushed.
const LEAST: f64 = 1.0 / (1u64 << 57) as f64;
/// Roundings of the test of a box itself.
const TEST_ROUNDINGS: f64 = 12.0 * U;
/// Room for what is of second order: each bound holds to within an eighth, and is enlarged by a quarter.
const ROOM: f64 = 1.25;
/// Products of norms from which second order is no longer an eighth.
const CONDITION_MOST: f64 = 1.0 / (256.0 * U);
/// Coordinates and components of transforms that are not beyond this, nor below its reciprocal as a whole, neither overflow nor
/// flush anything that counts.
const POWER_MOST: f64 = (1u64 << 38) as f64;

/// By how much a geometry's queries may place a hit beside its bounds, on an axis of the object's space.
#[derive(Clone, Copy)]
struct Errs {
    /// Per unit of the origin, and of the greatest coordinate.
    distance: f64,
    /// Per unit of the geometry's extent.
    extent: f64,
    /// Whether the origin's and the geometry's components on other axes count for an axis.
    across_axes: bool,
}

const TRIANGLES: Errs =
    Errs { distance: DISTANCE_ROUNDINGS, extent: SIZE_ROUNDINGS, across_axes: false };
const SHAPES: Errs = Errs { distance: SHAPE_SLACK, extent: SHAPE_SLACK, across_axes: true };

/// The box of an instance in the world, and what it must be widened by for a ray.
///
/// Let a ray have an origin of magnitude `o` at most on each axis. Wherever the geometry's query finds a hit for the ray
/// as the object sees it, the ray's own point in the world, at the `t` of that hit, is within this box widened by
/// `reach * o` on all sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldBox {
    /// The box, with all that does not depend on the ray.
    pub bounds: Aabb,
    /// Widening per unit of the ray's origin.
    pub reach: f32,
}

impl WorldBox {
    /// The box that every ray enters: for what is too large, too small or too far for the bounds.
    pub const EVERYWHERE: WorldBox =
        WorldBox { bounds: Aabb { lo: [-f32::MAX; 3], hi: [f32::MAX; 3] }, reach: 0.0 };

    /// The box of a geometry with these bounds under a transform; `None` for a geometry without triangles. Where the transform turns, it is
    /// the box of the outline's boxes, if there is one.
    pub fn new(
        transform: &Transform,
        space: &ObjectSpace,
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Option<WorldBox> {
        WorldBox::with_defect(transform, (space, &space.defect(transform)), bounds, outline)
    }

    /// The same where the space's defect is known.
    pub(crate) fn with_defect(
        transform: &Transform,
        space: (&ObjectSpace, &Defect),
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Option<WorldBox> {
        if bounds.is_empty() {
            return None;
        }
        let own = WorldBox::of(transform, space, bounds, outline, TRIANGLES);
        Some(own.unwrap_or(WorldBox::EVERYWHERE))
    }

    /// The same for a geometry of shapes.
    pub fn of_shapes(
        transform: &Transform,
        space: &ObjectSpace,
        bounds: &Aabb,
    ) -> Option<WorldBox> {
        if bounds.is_empty() {
            return None;
        }
        let space = (space, &space.defect(transform));
        let own = WorldBox::of(transform, space, bounds, None, SHAPES);
        Some(own.unwrap_or(WorldBox::EVERYWHERE))
    }

    fn of(
        transform: &Transform,
        (space, defect): (&ObjectSpace, &Defect),
        bounds: &Aabb,
        outline: Option<&Outline>,
        errs: Errs,
    ) -> Option<WorldBox> {
        let (a, m) = (magnitudes(transform), magnitudes(&space.inverse));
        let ends = transformed(transform, bounds);
        let (mut own, mut world, mut extent) = ([0.0; 3], [0.0; 3], 0.0);
        for k in 0..3 {
            let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
            own[k] = max(lo.abs(), hi.abs());
            world[k] = max(ends[0][k].abs(), ends[1][k].abs());
            extent = max(extent, hi - lo);
        }
        let linear = |rows: &[[f64; 4]; 3]| {
            let mut greatest = 0.0;
            for [x, y, z, _] in rows {
                greatest = max(greatest, max(max(*x, *y), *z));
            }
            greatest
        };
        let tame = |x: f64| (1.0 / POWER_MOST..=POWER_MOST).contains(&x);
        let near = |points: [f64; 3]| points.iter().all(|&x| x <= POWER_MOST);
        let moved = near([a[0][3], a[1][3], a[2][3]]) && near([m[0][3], m[1][3], m[2][3]]);
        let is_tame = tame(extent) && tame(linear(&a)) && tame(linear(&m));
        if !(is_tame && moved && near(own) && near(world)) {
            return None;
        }
        let turns = transform.iter().any(|row| row[..3].iter().filter(|x| **x != 0.0).count() > 1);
        let tight = match outline {
            Some(outline) if turns => outline.transformed(transform),
            _ => ends,
        };
        // Of each axis of the object's space: how much a row of |M| enlarges, what its numbers may be off by, and what it enlarges of
        // what a geometry's query is off by.
        let (mut norm, mut met, mut off) = ([0.0; 3], [[0.0; 3]; 3], [0.0; 3]);
        for k in 0..3 {
            norm[k] = m[k][0] + m[k][1] + m[k][2];
            met[k] = [norm[k], m[k][3], own[k]];
        }
        if errs.across_axes {
            let greatest = |part: usize| max(max(met[0][part], met[1][part]), met[2][part]);
            met = [[greatest(0), greatest(1), greatest(2)]; 3];
        }
        for k in 0..3 {
            let seen = m[k][0] * world[0] + m[k][1] * world[1] + m[k][2] * world[2];
            let [_, from, greatest] = met[k];
            let asked = errs.distance * (greatest + from) + errs.extent * extent;
            off[k] = PLACE_ROUNDINGS * (seen + m[k][3]) + asked + LEAST;
        }
        let (mut reach, mut out) = (0.0f64, Aabb::EMPTY);
        for row in 0..3 {
            let (mut condition, mut met_condition) = (0.0, 0.0);
            let mut slack = defect[row][3] + TEST_ROUNDINGS * world[row];
            for k in 0..3 {
                slack += defect[row][k] * world[k] + a[row][k] * off[k];
                condition += a[row][k] * norm[k];
                met_condition += a[row][k] * met[k][0];
            }
            if met_condition > CONDITION_MOST {
                return None;
            }
            let roundings = ORIGIN_ROUNDINGS * condition + errs.distance * met_condition;
            reach = max(reach, roundings + TEST_ROUNDINGS);
            let slack = slack * ROOM + SUM_ERROR * world[row];
            out.lo[row] = below(max(ends[0][row], tight[0][row]) - slack);
            out.hi[row] = above(-max(-ends[1][row], -tight[1][row]) + slack);
        }
        Some(WorldBox { bounds: out, reach: above(reach * ROOM) })
    }
}

/// The magnitudes of a transform's numbers.
fn magnitudes(rows: &Transform) -> [[f64; 4]; 3] {
    let mut wide = in_f64(rows);
    for row in &mut wide {
        for number in row {
            *number = number.abs();
        }
    }
    wide
}

/// The greater number, in one instruction.
fn max(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The greatest `f32` that is not above, finite.
pub(super) fn below(x: f64) -> f32 {
    let near = x as f32;
    // The float before it is one bit pattern less, or more where it is negative; +0 is never above. Without a branch, since
    // no processor can foresee it.
    let bits = near.to_bits();
    let step = ((bits as i32 >> 31) | 1) as u32;
    let is_above = u32::from(f64::from(near) > x);
    f32::from_bits(bits.wrapping_sub(step.wrapping_mul(is_above))).clamp(-f32::MAX, f32::MAX)
}

/// The least `f32` that is not below, finite.
pub(super) fn above(x: f64) -> f32 {
    -below(-x)
}

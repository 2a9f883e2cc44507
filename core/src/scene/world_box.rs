//! How wide an instance's box in the world must be, for all that roundings move: see `docs/design/scenes.md`.

use super::outline::Outline;
use super::transform::{ObjectSpace, SUM_ERROR, Transform, transformed};
use crate::aabb::Aabb;

/// `u`: the relative error of one rounding of an `f32`.
const U: f64 = 1.0 / (1u64 << 24) as f64;
/// Roundings that grow with the ray's origin: 8 of the way into the object's space, 24 of the geometry's traversal.
const ORIGIN_ROUNDINGS: f64 = 32.0 * U;
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
        if bounds.is_empty() {
            return None;
        }
        Some(WorldBox::of(transform, space, bounds, outline).unwrap_or(WorldBox::EVERYWHERE))
    }

    fn of(
        transform: &Transform,
        space: &ObjectSpace,
        bounds: &Aabb,
        outline: Option<&Outline>,
    ) -> Option<WorldBox> {
        let a = transform.map(|row| row.map(|x| f64::from(x).abs()));
        let m = space.inverse.map(|row| row.map(|x| f64::from(x).abs()));
        let ends = transformed(transform, bounds);
        let greatest = |lo: f64, hi: f64| lo.abs().max(hi.abs());
        let own = [0, 1, 2].map(|k| greatest(bounds.lo[k].into(), bounds.hi[k].into()));
        let world = [0, 1, 2].map(|k| greatest(ends[0][k], ends[1][k]));
        let extent = [0, 1, 2]
            .map(|k| f64::from(bounds.hi[k]) - f64::from(bounds.lo[k]))
            .into_iter()
            .fold(0.0, f64::max);
        let linear = |rows: &[[f64; 4]; 3]| {
            rows.iter().flat_map(|row| &row[..3]).fold(0.0, |m: f64, &x| m.max(x))
        };
        let tame = |x: f64| (1.0 / POWER_MOST..=POWER_MOST).contains(&x);
        let near = |points: [f64; 3]| points.iter().all(|&x| x <= POWER_MOST);
        let moved = near([a[0][3], a[1][3], a[2][3]]) && near([m[0][3], m[1][3], m[2][3]]);
        let is_tame = tame(extent) && tame(linear(&a)) && tame(linear(&m));
        if !(is_tame && moved && near(own) && near(world)) {
            return None;
        }
        let defect = space.defect(transform);
        let turns = transform.iter().any(|row| row[..3].iter().filter(|x| **x != 0.0).count() > 1);
        let tight = match outline {
            Some(outline) if turns => outline.transformed(transform),
            _ => ends,
        };
        let (mut reach, mut out) = (0.0f64, Aabb::EMPTY);
        for row in 0..3 {
            let mut condition = 0.0;
            let mut slack = defect[row][3] + TEST_ROUNDINGS * world[row];
            for k in 0..3 {
                slack += defect[row][k] * world[k];
                let norm = m[k][0] + m[k][1] + m[k][2];
                let seen = m[k][0] * world[0] + m[k][1] * world[1] + m[k][2] * world[2];
                condition += a[row][k] * norm;
                let seen = PLACE_ROUNDINGS * (seen + m[k][3]);
                let met = DISTANCE_ROUNDINGS * (own[k] + m[k][3]);
                slack += a[row][k] * (seen + met + SIZE_ROUNDINGS * extent + LEAST);
            }
            if condition > CONDITION_MOST {
                return None;
            }
            reach = reach.max(ORIGIN_ROUNDINGS * condition + TEST_ROUNDINGS);
            let slack = slack * ROOM + SUM_ERROR * world[row];
            out.lo[row] = below(ends[0][row].max(tight[0][row]) - slack);
            out.hi[row] = above(ends[1][row].min(tight[1][row]) + slack);
        }
        Some(WorldBox { bounds: out, reach: above(reach * ROOM) })
    }
}

/// The greatest `f32` that is not above, finite.
fn below(x: f64) -> f32 {
    let near = x as f32;
    (if f64::from(near) > x { near.next_down() } else { near }).clamp(-f32::MAX, f32::MAX)
}

/// The least `f32` that is not below, finite.
fn above(x: f64) -> f32 {
    -below(-x)
}

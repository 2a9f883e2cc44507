//! Closest points of spheres and capsules in the world.
//!
//! A transform counts as one that turns, moves and scales evenly where its columns have, to within 2^-18, equal lengths and right angles: rotations
//! whose numbers were rounded do. `s` is the root of the mean of the columns' squares. The shape in the world has the ends that the transform
//! makes of the shape's, in `f64`, and `s` times its radius. Its surface, not its inside, is what a point is near to: the closest point lies on the
//! line from the nearest point of the axis through the point, a radius away; where the point is on the axis, along x.
//!
//! *Why no tree changes the answer.* All columns are within 2^-18 of even, so the linear part stretches vectors by `s (1 - 2^-16)` at least, and the
//! image of the object's surface is within `2^-16 s e` of the surface in the world, `e` the extent of the geometry. So what is
//! farther from the point, as the object sees it, than (the best distance + `off` + the slack + `2^-16 s e`) / `s (1 - 2^-16)` is no better.

use core::sync::atomic::Ordering::Relaxed;

use super::built::BuiltScene;
use super::closest_point::{Near, SceneClosestPoint, in_other_space};
use super::nearness::{DEFINED, Nearness, PARTLY, UNKNOWN};
use super::shapes::{axis_of, dot, minus, nearest_of_segment};
use crate::arithmetic::sqrt;
use crate::error::QueryError;
use crate::scene::ShapeTree;
use crate::scene::Transform;
use crate::scene::shape::Shapes;

/// By how much columns may differ from even ones, as a part of their square: 2^-18.
const UNEVEN_MOST: f64 = 1.0 / (1u64 << 18) as f64;
/// What follows for distances: 2^-16.
const STRETCH_ERROR: f64 = 1.0 / (1u64 << 16) as f64;

/// The factor of a transform that turns, moves and scales evenly.
pub(super) fn even_scale(transform: &Transform) -> Option<f64> {
    let column = |k: usize| [0, 1, 2].map(|row| f64::from(transform[row][k]));
    let columns = [column(0), column(1), column(2)];
    let squares = columns.map(|column| dot(column, column));
    let mean = ((squares[0] + squares[1]) + squares[2]) / 3.0;
    let most = mean * UNEVEN_MOST;
    let even = (0..3).all(|k| {
        (squares[k] - mean).abs() <= most && dot(columns[k], columns[(k + 1) % 3]).abs() <= most
    });
    (even && mean > 0.0).then(|| sqrt(mean))
}

impl BuiltScene {
    /// What is known about closest points of shapes is so no longer.
    pub(super) fn forget_nearness(&mut self) {
        self.nearness = Nearness::default();
    }

    /// Refuses closest points where an instance of shapes that answers has none.
    pub(super) fn check_nearness(&self, mask: u32, is_exact: bool) -> Result<(), QueryError> {
        if is_exact && self.shapes_answer(mask) {
            return Err(QueryError::Unsupported {
                query: "closest points of shapes by accuracy `exact`",
            });
        }
        match self.nearness.0.load(Relaxed) {
            DEFINED => return Ok(()),
            UNKNOWN => {
                let known = match self.refuses_nearness(u32::MAX) {
                    None => DEFINED,
                    Some(_) => PARTLY,
                };
                // Whoever finds it out first writes the same.
                self.nearness.0.store(known, Relaxed);
            }
            _ => {}
        }
        self.refuses_nearness(mask).map_or(Ok(()), Err)
    }

    /// Whether shapes are among what answers.
    fn shapes_answer(&self, mask: u32) -> bool {
        let is_shapes = |name| self.geometry(name).is_some_and(|own| own.shapes().is_some());
        self.geometries().any(|(_, geometry)| geometry.shapes().is_some())
            && self
                .placements()
                .any(|(_, own)| own.answers(mask) && is_shapes(own.instance.geometry))
    }

    /// The first instance that refuses.
    fn refuses_nearness(&self, mask: u32) -> Option<QueryError> {
        if self.geometries().all(|(_, geometry)| geometry.shapes().is_none()) {
            return None;
        }
        self.placements().filter(|(_, placement)| placement.answers(mask)).find_map(
            |(name, placement)| {
                let shapes = self.geometry(placement.instance.geometry)?.shapes()?;
                if matches!(shapes.shapes(), Shapes::Own(_)) {
                    return Some(QueryError::Unsupported { query: "closest points of own shapes" });
                }
                let uneven = even_scale(&placement.instance.transform).is_none();
                uneven.then_some(QueryError::UnevenShapes { instance: name.0 })
            },
        )
    }
}

impl Near<'_> {
    /// Looks for a closer point of shapes than the best one so far.
    pub(super) fn search_shapes(
        &self,
        shapes: &ShapeTree,
        ignored: Option<u32>,
        best: &mut SceneClosestPoint,
    ) {
        let Some(scale) = even_scale(&self.placement.instance.transform) else { return };
        let bounds = shapes.bounds();
        let extent = (0..3).map(|k| f64::from(bounds.hi[k]) - f64::from(bounds.lo[k]));
        let extent = extent.fold(0.0, f64::max);
        let beside = self.off + self.slack + STRETCH_ERROR * scale * extent;
        let least = scale * (1.0 - STRETCH_ERROR);
        let limit = self.limit;
        let stop = |best: &SceneClosestPoint| {
            let reach = (sqrt(best.distance_squared.min(limit)) + beside) / least;
            reach * reach
        };
        shapes.near(self.seen, stop(best), |primitive| {
            if ignored != Some(primitive) {
                let own = self.of_shape(shapes.shapes(), primitive, scale);
                if own.distance_squared <= limit && own.precedes(best) {
                    *best = own;
                }
            }
            stop(best)
        });
    }

    /// The closest point of a sphere or capsule.
    fn of_shape(&self, shapes: &Shapes, primitive: u32, scale: f64) -> SceneClosestPoint {
        let instance = &self.placement.instance;
        let (axis, radius) = axis_of(shapes, primitive);
        let axis = axis.map(|end| in_other_space(&instance.transform, end));
        let radius = scale * radius;
        let (part, nearest) = nearest_of_segment(self.point, axis);
        let away = minus(self.point, nearest);
        let distance = sqrt(dot(away, away));
        let outwards =
            if distance > 0.0 { away.map(|x| x * (radius / distance)) } else { [radius, 0.0, 0.0] };
        let most = f64::from(f32::MAX);
        let point = [0, 1, 2].map(|k| (nearest[k] + outwards[k]).clamp(-most, most) as f32);
        let beyond = distance - radius;
        SceneClosestPoint {
            distance_squared: beyond * beyond,
            point,
            triangle: primitive,
            u: part as f32,
            v: 0.0,
            geometry: instance.geometry.0,
            instance: self.instance.0,
        }
    }
}

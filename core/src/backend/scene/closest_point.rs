//! The point of a scene that is closest to a given point.
//!
//! *What is computed.* For each triangle of each instance, its corners in the world, in `f64`: `((a0 x + a1 y) + a2 z) + a3` on each axis, with the
//! transform's numbers as given, and then what [`query::closest_point`](crate::query::closest_point) computes of a triangle. The least (squared
//! distance, instance, triangle) of all is the answer. So any affine transform will do, and an instance in place has the answers of its
//! mesh, bit for bit.
//!
//! A sphere or capsule under a transform that turns, moves and scales evenly is one in the world ([`near_shapes`](super::near_shapes)); other
//! transforms of shapes are refused.
//!
//! Accuracy `exact` compares the triangles of all instances in real arithmetic, with the transforms' numbers as given: corners in the world are then polynomials of
//! degree 2, which whole numbers hold ([`exact`](crate::exact)). Which triangles count is decided as above.
//!
//! *Why no tree changes the answer.* u is 2^-53. Products of two `f32` are exact in `f64`, so a corner errs by 3 u S on each axis, where S is
//! the greatest magnitude that its sum has on the way. No candidate is computed to be nearer than its triangle is, less 20 u R, R
//! the greatest distance along an axis between the point and the geometry's box in the world. Together they are less than the slack, 64 u (R + S).
//! A cell of a geometry's tree is passed over where it is farther than the best candidate and this slack, by either of two bounds: the distance to a box in
//! the world around the transformed cell, rounded outwards; and, as the object sees it, the distance of the point M p + m from the cell times the least that
//! the transform stretches any vector by, less how far that point is from p when it comes back to the world. The latter is computed with the
//! transform's defect ([`ObjectSpace`]), which also has room for the roundings of M p + m. The least stretch is
//! the root of Gershgorin's bound on the least eigenvalue of the transposed linear part times itself: exact, but for roundings, for rotations and
//! for scales along the object's axes; where it is 0, the first bound alone decides.

use core::ops::ControlFlow;

use super::built::{BuiltGeometry, BuiltScene};
use crate::aabb::Aabb;
use crate::arithmetic::{snap, sqrt};
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, refused};
use crate::query::closest_point::{
    ClosestPoint, Contender, Contest, EXACT, check_accuracy, check_lengths, of_corners, widened,
};
use crate::query::traverse::Triangles;
use crate::ray::Accuracy;
use crate::report::QueryReport;
use crate::scene::{GeometryId, IgnoredTriangle, InstanceId, Placement, Transform, transformed};
use crate::watch::Watch;

/// The closest point of a scene, or [`SceneClosestPoint::NONE`]. 40 bytes without padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneClosestPoint {
    /// The square of the distance in the world; infinity where there is none.
    pub distance_squared: f64,
    /// Where it is, in the world.
    pub point: [f32; 3],
    /// Index of the triangle in the geometry's mesh, or of the primitive among its shapes; `u32::MAX` where there is none.
    pub triangle: u32,
    /// Barycentric weight of the second corner, in `[0, 1]`; of shapes as for [hits](crate::scene::SceneHit).
    pub u: f32,
    /// Barycentric weight of the third corner, in `[0, 1]`.
    pub v: f32,
    /// The geometry ([`GeometryId`]); `u32::MAX` where there is none.
    pub geometry: u32,
    /// The instance ([`InstanceId`]); `u32::MAX` where there is none.
    pub instance: u32,
}

impl SceneClosestPoint {
    /// The record where no triangle is near enough.
    pub const NONE: SceneClosestPoint = SceneClosestPoint {
        distance_squared: f64::INFINITY,
        point: [0.0; 3],
        triangle: u32::MAX,
        u: 0.0,
        v: 0.0,
        geometry: u32::MAX,
        instance: u32::MAX,
    };

    /// A triangle's closest point as one of an instance.
    pub fn of(own: &ClosestPoint, geometry: GeometryId, instance: InstanceId) -> SceneClosestPoint {
        let ClosestPoint { distance_squared, point, triangle, u, v } = *own;
        let (geometry, instance) = (geometry.0, instance.0);
        SceneClosestPoint { distance_squared, point, triangle, u, v, geometry, instance }
    }

    /// True where there is one.
    pub fn is_some(&self) -> bool {
        self.instance != u32::MAX
    }

    /// `None` where there is none.
    pub fn some(self) -> Option<SceneClosestPoint> {
        self.is_some().then_some(self)
    }

    /// The distance, rounded to `f32`; infinity where there is none.
    pub fn distance(&self) -> f32 {
        sqrt(self.distance_squared) as f32
    }

    /// True when this comes before `other`: least (distance, instance, triangle).
    pub fn precedes(&self, other: &SceneClosestPoint) -> bool {
        self.distance_squared < other.distance_squared
            || (self.distance_squared == other.distance_squared
                && (self.instance, self.triangle) < (other.instance, other.triangle))
    }
}

/// Settings of a query for closest points of a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneClosestPointOptions<'a> {
    /// Points farther away than this are not looked for, in units of the world; one at just this distance counts. Infinity
    /// for no limit; nothing is within a NaN or a negative distance. A small limit makes the search faster.
    pub max_distance: f32,
    /// Which triangle is the closest: by [`Accuracy::Exact`] that of real arithmetic, of all instances, with the transforms' numbers as given, and the greatest distance is
    /// compared with the exact one; by any other that of the least distance as it is computed in `f64`. Distance, place and weights are those that are computed
    /// in `f64`, by each. Shapes have no exact closest points.
    pub accuracy: Accuracy,
    /// Instances answer when a bit of theirs is in this mask.
    pub mask: u32,
    /// A triangle of one instance to ignore.
    pub ignore: Option<IgnoredTriangle>,
    /// Receives the number of points that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

impl Default for SceneClosestPointOptions<'_> {
    fn default() -> Self {
        let max_distance = f32::INFINITY;
        let accuracy = Accuracy::default();
        SceneClosestPointOptions {
            max_distance,
            accuracy,
            mask: u32::MAX,
            ignore: None,
            watch: None,
        }
    }
}

/// Points between two calls of the watch.
const SLICE: usize = 64;
/// About what a search holds, for errors.
const BYTES: u64 = 4096;
/// 64 u: what roundings can make nearer, see the module's text.
const SLACK: f64 = 64.0 * f64::EPSILON / 2.0;
/// Relative roundings of a few operations in `f64`, with room to spare.
const FEW: f64 = 1e-14;

impl BuiltScene {
    /// The point of the scene that is closest to each point: see [`SceneClosestPoint`]. What culls or flips the sides of
    /// triangles does not matter here. Triangles with a coordinate in the world beyond the greatest `f32` do not count.
    ///
    /// # Errors
    /// `points` and `closest` of different length, shapes for which the question has no answer, no memory for a search, or a watch that cancels the batch.
    pub fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        let total = points.len();
        check_lengths(total, closest.len())?;
        let mut done = 0;
        for (points, closest) in points.chunks(SLICE).zip(closest.chunks_mut(SLICE)) {
            go_on_tracing(options.watch, done as u64, total as u64)?;
            for (&point, closest) in points.iter().zip(closest) {
                *closest = self.closest_point(point, options)?;
            }
            done += points.len();
        }
        go_on_tracing(options.watch, done as u64, total as u64)?;
        Ok(QueryReport::default())
    }

    /// The closest point to one point. Ignores the options' watch.
    ///
    /// # Errors
    /// No memory for the search, or instances that answer and whose shapes have no closest points: those of the user's own, and those that
    /// a transform stretches unevenly.
    pub fn closest_point(
        &self,
        point: [f32; 3],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<SceneClosestPoint, QueryError> {
        let is_exact = EXACT && options.accuracy == Accuracy::Exact;
        check_accuracy(options.accuracy)?;
        self.check_nearness(options.mask, is_exact)?;
        let limit = f64::from(options.max_distance);
        let mut best = SceneClosestPoint::NONE;
        if limit.is_nan() || limit < 0.0 || !point.iter().all(|x| x.is_finite()) {
            return Ok(best);
        }
        let limit = limit * limit;
        let point = point.map(snap);
        let mut contest = is_exact.then(|| Contest::new(point, options.max_distance));
        let point = point.map(f64::from);
        self.top.near(point, limit, |name| {
            let instance = InstanceId(name);
            let placement = self.placement(instance);
            if let Some(placement) = placement.filter(|own| own.answers(options.mask))
                && let Some(geometry) = self.geometry(placement.instance.geometry)
            {
                let ignored = options.ignore.filter(|ignored| ignored.instance == instance);
                let ignored = ignored.map(|ignored| ignored.triangle);
                Near::new(point, limit, placement, instance).search(
                    geometry,
                    ignored,
                    &mut best,
                    &mut contest,
                )?;
            }
            Ok::<f64, QueryError>(farthest_squared(&best, &contest).min(limit))
        })?;
        Ok(best)
    }
}

/// A point near an instance.
pub(super) struct Near<'a> {
    pub(super) point: [f64; 3],
    /// No candidate beyond its root counts.
    pub(super) limit: f64,
    pub(super) placement: &'a Placement,
    pub(super) instance: InstanceId,
    /// How far a triangle may seem nearer than it is.
    pub(super) slack: f64,
    /// The point as the object sees it.
    pub(super) seen: [f64; 3],
    /// How far that is from the point when it comes back to the world.
    pub(super) off: f64,
    /// No vector of the object's is shorter in the world than this times its length.
    least_stretch: f64,
}

impl<'a> Near<'a> {
    fn new(
        point: [f64; 3],
        limit: f64,
        placement: &'a Placement,
        instance: InstanceId,
    ) -> Near<'a> {
        let (transform, bounds) = (&placement.instance.transform, &placement.bounds);
        let ends = transformed(transform, bounds);
        let (mut reach, mut magnitude) = (0.0f64, 0.0f64);
        for row in 0..3 {
            reach = reach.max(ends[1][row] - point[row]).max(point[row] - ends[0][row]);
            let mut own = f64::from(transform[row][3]).abs();
            for axis in 0..3 {
                let greatest = f64::from(bounds.lo[axis].abs().max(bounds.hi[axis].abs()));
                own += f64::from(transform[row][axis]).abs() * greatest;
            }
            magnitude = magnitude.max(own);
        }
        let defect = placement.space.defect(transform);
        let mut off = 0.0;
        for row in defect {
            off += ((row[0] * point[0].abs() + row[1] * point[1].abs()) + row[2] * point[2].abs())
                + row[3];
        }
        let slack = (reach + magnitude) * SLACK;
        let seen = in_other_space(&placement.space.inverse, point);
        let least_stretch = least_stretch(transform);
        Near { point, limit, placement, instance, slack, seen, off, least_stretch }
    }

    /// The square of a bound on the distance to what is in a cell of the tree.
    fn bound(&self, cell: &Aabb) -> f64 {
        let seen = distance(self.seen, cell.lo.map(f64::from), cell.hi.map(f64::from));
        let seen = (seen * self.least_stretch - self.off).max(0.0);
        let [lo, hi] = transformed(&self.placement.instance.transform, cell);
        let bound = distance(self.point, lo, hi).max(seen);
        bound * bound
    }

    /// Looks for a closer point than the best one so far.
    fn search(
        &self,
        geometry: &BuiltGeometry,
        ignored: Option<u32>,
        best: &mut SceneClosestPoint,
        contest: &mut Option<SceneContest>,
    ) -> Result<(), QueryError> {
        if let Some(shapes) = geometry.shapes() {
            self.search_shapes(shapes, ignored, best);
            return Ok(());
        }
        let mesh = geometry.mesh().mesh();
        let name = self.placement.instance.geometry;
        let stop = |best: &SceneClosestPoint, contest: &Option<SceneContest>| {
            widened(farthest_squared(best, contest).min(self.limit), self.slack)
        };
        let first = stop(best, contest);
        let tree = geometry.accelerator().tree();
        let found = tree.find_best(
            first,
            |cell| self.bound(cell),
            |leaf| {
                for &triangle in leaf.triangles {
                    if ignored == Some(triangle) {
                        continue;
                    }
                    let corners = mesh.corners(triangle);
                    let Some(about) = self.in_world(&corners) else { continue };
                    if let Some(contest) = contest
                        && EXACT
                    {
                        let given = (&corners, Some(&self.placement.instance.transform));
                        let key = (self.instance.0, triangle);
                        let (own, found) =
                            Contender::new(self.point, about, self.slack, given, key);
                        if contest.enter(own) {
                            let found = ClosestPoint { triangle, ..found };
                            *best = SceneClosestPoint::of(&found, name, self.instance);
                        }
                        continue;
                    }
                    let own = ClosestPoint { triangle, ..of_corners(self.point, about) };
                    let own = SceneClosestPoint::of(&own, name, self.instance);
                    if own.distance_squared <= self.limit && own.precedes(best) {
                        *best = own;
                    }
                }
                ControlFlow::Continue(stop(best, contest))
            },
        );
        found.map(|_| ()).map_err(|_| refused(BYTES))
    }

    /// The corners of a triangle in the world; `None` for one that does not fit the floats there.
    fn in_world(&self, corners: &[[f32; 3]; 3]) -> Option<[[f64; 3]; 3]> {
        corners_in_world(&self.placement.instance.transform, corners)
    }
}

/// Between triangles of all instances.
type SceneContest = Contest<(u32, u32)>;

/// The square of a distance that the closest triangle so far is certainly within, as distances are compared.
fn farthest_squared(best: &SceneClosestPoint, contest: &Option<SceneContest>) -> f64 {
    match contest {
        Some(contest) if EXACT => contest.farthest_squared(),
        _ => best.distance_squared,
    }
}

fn corners_in_world(transform: &Transform, corners: &[[f32; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let corners = corners.map(|corner| in_other_space(transform, corner.map(f64::from)));
    let fits = corners.iter().flatten().all(|x| x.abs() <= f64::from(f32::MAX));
    fits.then_some(corners)
}

/// The closest point of a triangle with snapped corners under a transform; `None` for one with a coordinate beyond the greatest
/// `f32` in the world. [`ClosestPoint::triangle`] is left open (0).
pub fn closest_in_world(
    point: [f64; 3],
    transform: &Transform,
    corners: &[[f32; 3]; 3],
) -> Option<ClosestPoint> {
    corners_in_world(transform, corners).map(|corners| of_corners(point, corners))
}

/// A point through a transform, in a stated order.
pub(super) fn in_other_space(transform: &Transform, point: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = point;
    transform.map(|row| {
        let [a, b, c, d] = row.map(f64::from);
        ((a * x + b * y) + c * z) + d
    })
}

/// The distance of a point to a box, in `f64`.
fn distance(point: [f64; 3], lo: [f64; 3], hi: [f64; 3]) -> f64 {
    let mut squared = 0.0;
    for axis in 0..3 {
        let outside = (lo[axis] - point[axis]).max(point[axis] - hi[axis]).max(0.0);
        squared += outside * outside;
    }
    sqrt(squared) * (1.0 - FEW)
}

/// A number by which the transform stretches every vector at least: the root of Gershgorin's bound.
fn least_stretch(transform: &Transform) -> f64 {
    let a = transform.map(|row| [row[0], row[1], row[2]].map(f64::from));
    let product = |i: usize, j: usize| (a[0][i] * a[0][j] + a[1][i] * a[1][j]) + a[2][i] * a[2][j];
    let mut least = f64::INFINITY;
    for i in 0..3 {
        let (own, others) = (product(i, i), [(i + 1) % 3, (i + 2) % 3]);
        // Roundings of the products are parts of the squares' sums.
        let rounded = FEW * (own + product(others[0], others[0]) + product(others[1], others[1]));
        let beside = product(i, others[0]).abs() + product(i, others[1]).abs();
        least = least.min(own - beside - rounded);
    }
    sqrt(least.max(0.0)) * (1.0 - FEW)
}

//! The point of a mesh that is closest to a given point.
//!
//! *What is computed.* For each triangle up to four of its points are candidates: the foot of the perpendicular, where
//! it lies within the triangle, and the closest point of each edge (Ericson 2005, sections 5.1.2 and 5.1.5, by cases
//! instead of regions). All is `f64`, in the order that [`of_triangle`] states, without fused operations, so every machine
//! computes the same. The least (squared distance, triangle) of all triangles is the answer, as those numbers are computed;
//! it depends neither on the tree nor on the order of the triangles' tests.
//!
//! *Why no tree changes the answer.* u is 2^-53, and R the greatest distance along an axis between the point and a corner of
//! the scene's box. A candidate is evaluated as `(a + v (b - a)) + w (c - a)`, moved so that the given point is the origin, with weights that are
//! not negative and at most 1 + u together. On each axis the corner errs by u R; an edge, at most 2 R long, by 2 u R and its product by
//! as much, of which the weights take 4 u R; weights that are together too great by u move the point by 2 u R; each of the two sums rounds a
//! coordinate of a point of the triangle, by u R. So a computed point is within 9 u R of a point of the triangle on each axis, and
//! within 16 u R of it in space. The sum of squares errs by 4 u, its root by 2 u of a distance that is at most 1.8 R. So no
//! candidate is computed to be nearer than its triangle is, less 20 u R. [`slack`] is 64 u R. A box is passed over only where its
//! distance is greater than the best one so far, and this slack: until the answer's triangle has been tested, no box with that triangle's closest point in it is.
//!
//! *How good it is.* The computed distance is also never less than the true one by more than that. How much greater it may be is measured
//! against rational arithmetic (`backend-cpu/tests/closest_point.rs`).
//!
//! *Accuracy `exact`.* The least (squared distance, triangle) of real arithmetic: ranges of distances are compared, and where they overlap, whole numbers decide
//! (`contest.rs`). What is said of its closest point is computed as above. A box is passed over only where it is farther than the best one's computed distance and the
//! slack, which is more than that distance errs by, so no triangle that is as near is passed over either.
//!
//! Triangles that the build drops (equal corners, or a coordinate that is not finite) do not count. Triangles without area do:
//! they are their edges. Coordinates count as snapped (below 2^-126 as 0), those of points too.

mod contest;

use core::ops::ControlFlow;

pub(crate) use contest::{Contender, Contest};

use crate::aabb::Aabb;
use crate::arithmetic::{snap, sqrt};
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, refused};
use crate::query::traverse::Triangles;
use crate::ray::Accuracy;
use crate::report::QueryReport;
use crate::tree::KdTreeView;
use crate::triangle::Triangle;
use crate::watch::Watch;

/// The closest point of a mesh, or [`ClosestPoint::NONE`]. 32 bytes without padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// The square of the distance; infinity where there is none.
    pub distance_squared: f64,
    /// Where it is: [`ClosestPoint::u`] and [`ClosestPoint::v`] say it too, by the triangle's corners.
    pub point: [f32; 3],
    /// Index of the triangle in the caller's mesh; `u32::MAX` where there is none.
    pub triangle: u32,
    /// Barycentric weight of the second corner, in `[0, 1]`, as in [`Hit`](crate::ray::Hit).
    pub u: f32,
    /// Barycentric weight of the third corner, in `[0, 1]`.
    pub v: f32,
}

impl ClosestPoint {
    /// The record where no triangle is near enough.
    pub const NONE: ClosestPoint = ClosestPoint {
        distance_squared: f64::INFINITY,
        point: [0.0; 3],
        triangle: u32::MAX,
        u: 0.0,
        v: 0.0,
    };

    /// True where there is one.
    pub fn is_some(&self) -> bool {
        self.triangle != u32::MAX
    }

    /// `None` where there is none.
    pub fn some(self) -> Option<ClosestPoint> {
        self.is_some().then_some(self)
    }

    /// The distance, rounded to `f32`; infinity where there is none.
    pub fn distance(&self) -> f32 {
        sqrt(self.distance_squared) as f32
    }

    /// True when this comes before `other`: lesser distance, at equal distance the lower triangle index.
    pub fn precedes(&self, other: &ClosestPoint) -> bool {
        self.distance_squared < other.distance_squared
            || (self.distance_squared == other.distance_squared && self.triangle < other.triangle)
    }
}

/// Settings of a query for closest points.
#[derive(Clone, Copy, Debug)]
pub struct ClosestPointOptions<'a> {
    /// Points farther away than this are not looked for, in units of the mesh; one at just this distance counts. Infinity
    /// for no limit; nothing is within a NaN or a negative distance. A small limit makes the search faster.
    pub max_distance: f32,
    /// Which triangle is the closest: by [`Accuracy::Exact`] that of real arithmetic, for the coordinates as they are after snapping, and the greatest distance is
    /// compared with the exact one; by any other that of the least distance as it is computed in `f64`. Distance, place and weights are
    /// those that are computed of the triangle in `f64`, by each.
    pub accuracy: Accuracy,
    /// One triangle to ignore, by its index in the caller's mesh.
    pub ignore: Option<u32>,
    /// Receives the number of points that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

impl Default for ClosestPointOptions<'_> {
    fn default() -> Self {
        ClosestPointOptions {
            max_distance: f32::INFINITY,
            accuracy: Accuracy::default(),
            ignore: None,
            watch: None,
        }
    }
}

/// A search under way: a point, and the closest one found so far. Any traversal that passes over a box only where
/// [`Search::stop`] allows it gives the same answer.
#[derive(Clone, Copy, Debug)]
pub struct Search {
    point: [f64; 3],
    ignore: Option<u32>,
    /// See [`slack`].
    slack: f64,
    /// No candidate beyond it counts.
    limit: f64,
    best: ClosestPoint,
    /// See [`Search::stop`].
    stop: f64,
    /// Of accuracy `exact`.
    contest: Option<Contest<u32>>,
}

/// Whether closest points of accuracy `exact` are offered: not in browsers, whose parts they would make larger.
pub(crate) const EXACT: bool = !cfg!(target_family = "wasm");

/// Refuses an accuracy of closest points that is not offered.
///
/// # Errors
/// [`QueryError::Unsupported`] for [`Accuracy::Exact`] in WebAssembly.
pub fn check_accuracy(accuracy: Accuracy) -> Result<(), QueryError> {
    match accuracy {
        Accuracy::Exact if !EXACT => {
            Err(QueryError::Unsupported { query: "closest points of accuracy `exact`" })
        }
        _ => Ok(()),
    }
}

impl Search {
    /// A search that has found nothing yet; `None` where there is nothing to be found: a point that is not finite, a
    /// limit that nothing is within, an empty scene. `bounds` hold all triangles.
    pub fn new(
        point: [f32; 3],
        bounds: &Aabb,
        options: &ClosestPointOptions<'_>,
    ) -> Option<Search> {
        let point = point.map(snap);
        let limit = f64::from(options.max_distance);
        if bounds.is_empty()
            || !point.iter().all(|x| x.is_finite())
            || limit.is_nan()
            || limit < 0.0
        {
            return None;
        }
        let slack = slack(point, bounds);
        let contest = (EXACT && options.accuracy == Accuracy::Exact)
            .then(|| Contest::new(point, options.max_distance));
        let point = point.map(f64::from);
        let limit = limit * limit;
        let (ignore, best) = (options.ignore, ClosestPoint::NONE);
        Some(Search { point, ignore, slack, limit, best, stop: widened(limit, slack), contest })
    }

    /// A box is of no interest where its squared distance is greater than this, which allows for an error of that distance of
    /// a part in 2^42.
    #[inline]
    pub fn stop(&self) -> f64 {
        self.stop
    }

    /// Looks at a triangle with snapped corners. True where it is the closest one so far.
    pub fn test(&mut self, corners: &Triangle, triangle: u32) -> bool {
        if self.ignore == Some(triangle) {
            return false;
        }
        if EXACT && self.contest.is_some() {
            return self.test_exactly(corners, triangle);
        }
        let mut found = of_triangle(self.point, corners);
        found.triangle = triangle;
        let better = found.distance_squared <= self.limit && found.precedes(&self.best);
        if better {
            self.best = found;
            self.stop = widened(found.distance_squared, self.slack);
        }
        better
    }

    /// [`Search::test`] by accuracy `exact`.
    #[cold]
    #[inline(never)]
    fn test_exactly(&mut self, corners: &Triangle, triangle: u32) -> bool {
        let Some(contest) = &mut self.contest else { return false };
        let about = corners.map(|corner| corner.map(f64::from));
        let (own, found) = Contender::new(self.point, about, self.slack, (corners, None), triangle);
        let better = contest.enter(own);
        if better {
            self.best = ClosestPoint { triangle, ..found };
            self.stop = widened(found.distance_squared, self.slack);
        }
        better
    }

    /// The square of a distance that the closest triangle so far is certainly within, as distances are compared; infinity where there is none.
    pub fn farthest_squared(&self) -> f64 {
        match &self.contest {
            Some(contest) if EXACT => contest.farthest_squared(),
            _ => self.best.distance_squared,
        }
    }

    /// The given point, snapped.
    pub fn point(&self) -> [f32; 3] {
        // They were floats of 32 bits.
        self.point.map(|x| x as f32)
    }

    /// The triangle of the closest point so far; `u32::MAX` where there is none.
    #[inline]
    pub fn best_triangle(&self) -> u32 {
        self.best.triangle
    }

    /// The closest point so far.
    pub fn best(&self) -> ClosestPoint {
        self.best
    }
}

/// The square of a distance that is greater by `slack`, and by more than squares and roots err.
///
/// (d + s)² is d² + s (2 d + s). The slack s is so small that d may be a part in a hundred too great; a root of its own would be most of a search's divisions.
pub(crate) fn widened(squared: f64, slack: f64) -> f64 {
    if squared.is_infinite() {
        return squared;
    }
    (squared + slack * (2.0 * root_or_more(squared) + slack)) * (1.0 + 1e-12)
}

/// At least the square root of a number that is neither negative nor infinite, less a few roundings: the mean of y and x / y never is less than the root of x. At most a
/// part in a hundred too great for x above 2^-1000.
fn root_or_more(x: f64) -> f64 {
    // Halving the exponent gives a start within a tenth.
    let y = f64::from_bits((x.to_bits() >> 1) + (1023 << 51));
    0.5 * (y + x / y)
}

/// How far a triangle may seem nearer than it is: 64 u R, see the module's text.
pub fn slack(point: [f32; 3], bounds: &Aabb) -> f64 {
    let mut reach = 0.0f64;
    for axis in 0..3 {
        let at = f64::from(point[axis]);
        reach = reach.max(f64::from(bounds.hi[axis]) - at).max(at - f64::from(bounds.lo[axis]));
    }
    reach * (64.0 * f64::EPSILON / 2.0)
}

type Vector = [f64; 3];

fn difference(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// The point of a triangle (snapped corners) that is closest to a point; [`ClosestPoint::triangle`] is left open (0).
///
/// With q the point, p = q - a, e = b - a, f = c - a and n = e x f, the foot has the weights v = n (p x f) / nn and
/// w = n (e x p) / nn; it counts where nn > 0, v >= 0, w >= 0 and v + w <= 1. By these the foot of a triangle of angle x is off by
/// u R / x along the triangle. So where x is small, nn < ee ff / 256, the foot goes along the longer one of e and f, e if they are equal, and along
/// the height above it, which is at a right angle to it whatever x is: with h = f - (f e / ee) e and q = p - (p e / ee) e, w = q h / hh and
/// v = p e / ee - w (f e / ee), and as much with e and f exchanged. Of an edge from r with direction s it is the point at (q - r) s / ss, clamped to
/// [0, 1], or r where ss is 0. Foot, a to b, a to c, b to c are compared in this order; a later one replaces an earlier one only where it is
/// nearer.
pub fn of_triangle(point: [f64; 3], corners: &Triangle) -> ClosestPoint {
    of_corners(point, corners.map(|corner| corner.map(f64::from)))
}

/// [`of_triangle`] of a triangle whose corners are not rounded to `f32`. Coordinates must not be beyond the greatest `f32`.
pub fn of_corners(point: [f64; 3], corners: [[f64; 3]; 3]) -> ClosestPoint {
    nearest(point, corners).0
}

/// [`of_corners`], and where that is as seen from the point.
#[inline(always)]
fn nearest(point: Vector, corners: [Vector; 3]) -> (ClosestPoint, Vector) {
    let [a, b, c] = corners;
    let (to_a, e, f) = (difference(a, point), difference(b, a), difference(c, a));
    let mut best = (f64::INFINITY, [0.0; 2], [0.0; 3]);
    let mut consider = |v: f64, w: f64| {
        let to = [0, 1, 2].map(|axis| (to_a[axis] + v * e[axis]) + w * f[axis]);
        let squared = dot(to, to);
        if squared < best.0 {
            best = (squared, [v, w], to);
        }
    };
    let (p, n) = (difference(point, a), cross(e, f));
    let (ee, ff, nn) = (dot(e, e), dot(f, f), dot(n, n));
    if nn > 0.0 {
        let [v, w] = match nn < SLIVER * (ee * ff) {
            false => [dot(n, cross(p, f)) / nn, dot(n, cross(e, p)) / nn],
            true if ff > ee => {
                let [w, v] = by_height(p, f, e, ff);
                [v, w]
            }
            true => by_height(p, e, f, ee),
        };
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            consider(v, w);
        }
    }
    consider(part(dot(p, e), ee), 0.0);
    consider(0.0, part(dot(p, f), ff));
    let (to_b, g) = (difference(b, point), difference(c, b));
    let along = part(-dot(to_b, g), dot(g, g));
    consider(1.0 - along, along);
    let (distance_squared, [v, w], to) = best;
    let found = ClosestPoint {
        distance_squared,
        point: [0, 1, 2].map(|axis| (point[axis] + to[axis]) as f32),
        triangle: 0,
        u: v as f32,
        v: w as f32,
    };
    (found, to)
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A quotient, clamped to [0, 1]; 0 for 0 / 0.
fn part(a: f64, b: f64) -> f64 {
    let part = a / b;
    if part > 0.0 { if part < 1.0 { part } else { 1.0 } } else { 0.0 }
}

/// The weights of the foot of p, of the `long` edge and of the other one, by the height above the long edge, whose square is given.
fn by_height(p: Vector, long: Vector, other: Vector, square: f64) -> [f64; 2] {
    let (along_p, along_other) = (dot(p, long) / square, dot(other, long) / square);
    let above = |x: Vector, part: f64| [0, 1, 2].map(|axis| x[axis] - part * long[axis]);
    let (q, height) = (above(p, along_p), above(other, along_other));
    let weight = dot(q, height) / dot(height, height);
    [along_p - weight * along_other, weight]
}

/// The square of the sine of an angle, 1/16, below which a triangle's foot is computed by its height.
const SLIVER: f64 = 1.0 / 256.0;

/// About what a search holds, for errors.
const BYTES: u64 = 4096;

/// The closest point of a mesh, by the tree: the reference.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
///
/// # Errors
/// [`QueryError::OutOfMemory`] where the system has no memory for the search, and those of [`check_accuracy`].
pub fn closest_point(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    point: [f32; 3],
    options: &ClosestPointOptions<'_>,
) -> Result<ClosestPoint, QueryError> {
    check_accuracy(options.accuracy)?;
    let Some(search) = Search::new(point, &tree.bounds, options) else {
        return Ok(ClosestPoint::NONE);
    };
    let search = core::cell::Cell::new(search);
    let point = point.map(snap);
    let bound = |cell: &Aabb| {
        let squared = cell.distance_squared(point);
        if squared > search.get().stop() { f64::INFINITY } else { squared }
    };
    let stop = search.get().stop();
    let found = tree.find_best(stop, bound, |leaf| {
        let mut here = search.get();
        for &triangle in leaf.triangles {
            here.test(&triangles.corners(triangle), triangle);
        }
        search.set(here);
        ControlFlow::Continue(here.stop())
    });
    found.map_err(|_| refused(BYTES))?;
    Ok(search.get().best())
}

/// The closest points of a batch, one at a time: the reference, which backends on devices use too. `watch` is called
/// every 1,024 points.
///
/// # Errors
/// `points` and `closest` of different length, a watch that cancels the batch, and those of [`closest_point`].
pub fn one_by_one(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    points: &[[f32; 3]],
    closest: &mut [ClosestPoint],
    options: &ClosestPointOptions<'_>,
) -> Result<QueryReport, QueryError> {
    let total = points.len();
    check_lengths(total, closest.len())?;
    let mut done = 0;
    for (points, closest) in points.chunks(1024).zip(closest.chunks_mut(1024)) {
        go_on_tracing(options.watch, done as u64, total as u64)?;
        for (&point, closest) in points.iter().zip(closest) {
            *closest = closest_point(tree, triangles, point, options)?;
        }
        done += points.len();
    }
    go_on_tracing(options.watch, done as u64, total as u64)?;
    Ok(QueryReport::default())
}

/// Refuses batches with room for another number of answers than there are points.
///
/// # Errors
/// [`QueryError::LengthMismatch`].
pub fn check_lengths(points: usize, results: usize) -> Result<(), QueryError> {
    if points == results {
        Ok(())
    } else {
        Err(QueryError::LengthMismatch { rays: points, results })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widened_squares_are_of_at_least_the_distance_and_its_slack() {
        let mut x = 1e-300;
        while x < 1e80 {
            for slack in [0.0, 1e-12, 1.0, 1e3].map(|part| part * sqrt(x)) {
                let (sum, found) = (sqrt(x) + slack, widened(x, slack));
                assert!(found >= sum * sum, "{x:e} {slack:e}");
                assert!(found <= sum * sum * 1.03, "{x:e} {slack:e}");
            }
            x *= 1.37;
        }
        assert_eq!(widened(f64::INFINITY, 0.0), f64::INFINITY);
        assert!(widened(0.0, 1e-3) >= 1e-6 && widened(0.0, 1e-3) < 1.01e-6);
        assert_eq!(widened(0.0, 0.0), 0.0);
    }
}

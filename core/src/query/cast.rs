//! When a ball or a capsule that moves along a ray first touches a mesh.
//!
//! *What is computed.* A ball meets a triangle when its middle is within the radius of it. Of each triangle the candidates are the start, where they meet at
//! once, and the first time at which the middle is at the radius from the plane, from the line of an edge, or from a corner, where the point of
//! contact lies on the triangle, the edge. A capsule is a ball against all that its segment, moved backwards, sweeps from the triangle: a prism with the
//! triangle at both ends and a parallelogram, two triangles, along each edge. All is `f64`, in a stated order, so every machine computes the same; the
//! least (t, triangle) is the answer.
//!
//! *Why no tree changes the answer.* Let R be the greatest distance along an axis between the middle and a corner of the scene's box at the start, or the radius or a side of
//! the box if that is greater. Squares err by parts in 2^50 of R^2, so at a candidate the middle is within radius + 2^-24 R of the triangle. A cell is passed over only
//! where the middle enters the box around the cell, wider by radius and `SLACK` R, 2^-20 R, later than the best candidate.
//!
//! *How good it is.* Against exact overlaps, radii wrong by 2^-20 R make the difference between before, at and after the impact
//! (`backend-cpu/tests/casts.rs`).

use core::ops::ControlFlow;

use crate::aabb::Aabb;
use crate::arithmetic::{snap, sqrt};
use crate::cancel::go_on_tracing;
use crate::error::{QueryError, refused};
use crate::query::closest_point::{check_lengths, of_corners};
use crate::query::traverse::Triangles;
use crate::ray::Ray;
use crate::report::QueryReport;
use crate::tree::KdTreeView;
use crate::triangle::Triangle;
use crate::watch::Watch;

/// A ball or a capsule that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cast {
    /// The way of the ball's middle, or of one end of the capsule's segment, between the ray's limits.
    pub ray: Ray,
    /// From that end to the other one; 0 for a ball.
    pub axis: [f32; 3],
    /// The radius, at least 0.
    pub radius: f32,
}

impl Cast {
    /// A ball.
    pub fn ball(ray: Ray, radius: f32) -> Cast {
        Cast { ray, axis: [0.0; 3], radius }
    }
}

/// What is touched first, or [`Impact::NONE`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// When, in lengths of the ray's direction; the ray's `t_min` where they meet from the start. Infinity where there is none.
    pub t: f32,
    /// Index of the triangle in the caller's mesh; `u32::MAX` where there is none.
    pub triangle: u32,
}

impl Impact {
    /// The record where nothing is touched.
    pub const NONE: Impact = Impact { t: f32::INFINITY, triangle: u32::MAX };

    /// True where something is touched.
    pub fn is_some(&self) -> bool {
        self.triangle != u32::MAX
    }
}

/// Settings of a query for impacts.
#[derive(Clone, Copy, Debug, Default)]
pub struct CastOptions<'a> {
    /// One triangle to ignore, by its index in the caller's mesh.
    pub ignore: Option<u32>,
    /// Receives the number of casts that are done, and may cancel the batch; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

type Vector = [f64; 3];

/// How much wider than the radius boxes are, in parts of R.
const SLACK: f64 = 1.0 / (1u32 << 20) as f64;

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vector, b: Vector) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + s d`.
fn along(a: Vector, s: f64, d: Vector) -> Vector {
    [0, 1, 2].map(|axis| a[axis] + s * d[axis])
}

/// The same direction at length 1; `None` for 0.
fn unit(a: Vector) -> Option<(Vector, f64)> {
    let length = sqrt(dot(a, a));
    (length > 0.0).then(|| (a.map(|x| x / length), length))
}

/// A search under way: a cast, and the first impact found so far. Any traversal that passes over a box only where
/// [`CastSearch::bound`] and [`CastSearch::is_open`] allow it gives the same answer.
#[derive(Clone, Copy, Debug)]
pub struct CastSearch {
    origin: Vector,
    /// Of length 1, or 0 for what stands still.
    direction: Vector,
    /// Its length as given.
    length: f64,
    axis: Vector,
    radius: f64,
    /// Where the way begins, in units.
    start: f64,
    /// No impact beyond it counts, in units.
    stop: f64,
    /// How far boxes are widened: radius and slack.
    wider: f64,
    ignore: Option<u32>,
    triangle: u32,
    t_min: f32,
}

impl CastSearch {
    /// A search that has found nothing yet; `None` where there is nothing to be found: a number that is not finite (`t_max` may be infinite), a negative
    /// radius, no `t` between the limits, an empty scene. `bounds` hold all triangles.
    pub fn new(cast: &Cast, bounds: &Aabb, options: &CastOptions<'_>) -> Option<CastSearch> {
        let Cast { ray, axis, radius } = cast;
        let finite =
            [ray.origin, ray.direction, *axis].as_flattened().iter().all(|x| x.is_finite());
        let good = finite && ray.t_min.is_finite() && radius.is_finite() && *radius >= 0.0;
        let is_ordered = ray.t_min <= ray.t_max;
        if !good || !is_ordered || bounds.is_empty() {
            return None;
        }
        let to_f64 = |v: [f32; 3]| v.map(|x| f64::from(snap(x)));
        let (origin, axis, radius) = (to_f64(ray.origin), to_f64(*axis), f64::from(snap(*radius)));
        let (direction, length) = unit(to_f64(ray.direction)).unwrap_or(([0.0; 3], 0.0));
        let start = f64::from(ray.t_min) * length;
        // What stands still meets at its start or not at all.
        let stop = if length > 0.0 { f64::from(ray.t_max) * length } else { 0.0 };
        let first = along(origin, start, direction);
        let mut reach = radius;
        for k in 0..3 {
            let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
            reach = reach.max((hi - first[k]).abs()).max((first[k] - lo).abs()).max(hi - lo);
            reach = reach.max(axis[k].abs()).max(origin[k].abs());
        }
        let (ignore, triangle) = (options.ignore, u32::MAX);
        let wider = radius + SLACK * reach;
        let t_min = ray.t_min;
        Some(CastSearch {
            origin,
            direction,
            length,
            axis,
            radius,
            start,
            stop,
            wider,
            ignore,
            triangle,
            t_min,
        })
    }

    /// When the middle may be near enough to a box, at the earliest; `None` for never.
    pub fn bound(&self, cell: &Aabb) -> Option<f64> {
        let (mut enter, mut leave) = (self.start, self.stop);
        for axis in 0..3 {
            // The box and what the segment, moved backwards, sweeps of it.
            let back = self.axis[axis];
            let lo = f64::from(cell.lo[axis]) - self.wider - back.max(0.0);
            let hi = f64::from(cell.hi[axis]) + self.wider - back.min(0.0);
            let (at, d) = (self.origin[axis], self.direction[axis]);
            if d == 0.0 {
                if at < lo || at > hi {
                    return None;
                }
                continue;
            }
            let (near, far) = ((lo - at) / d, (hi - at) / d);
            let (near, far) = if near <= far { (near, far) } else { (far, near) };
            enter = enter.max(near);
            leave = leave.min(far);
        }
        // Quotients err by far less than the slack makes of the way.
        (enter <= leave + leave.abs() * 1e-14).then_some(enter)
    }

    /// Whether a box with this bound is still of interest.
    pub fn is_open(&self, bound: f64) -> bool {
        bound <= self.stop + self.stop.abs() * 1e-14
    }

    /// Looks at a triangle with snapped corners.
    pub fn test(&mut self, corners: &Triangle, triangle: u32) {
        if self.ignore == Some(triangle) {
            return;
        }
        let corners = corners.map(|corner| corner.map(f64::from));
        let Some(s) = self.of_corners(corners) else { return };
        if s < self.stop || (s == self.stop && triangle < self.triangle) {
            (self.stop, self.triangle) = (s, triangle);
        }
    }

    /// When a triangle is touched first.
    fn of_corners(&self, corners: [Vector; 3]) -> Option<f64> {
        let first = self.ball(corners);
        if self.axis == [0.0; 3] || first == Some(self.start) {
            return first;
        }
        let [a, b, c] = corners;
        let [p, q, r] = corners.map(|corner| minus(corner, self.axis));
        if self.starts_within(corners) {
            return Some(self.start);
        }
        let sides = [[p, q, r], [a, b, q], [a, q, p], [b, c, r], [b, r, q], [c, a, p], [c, p, r]];
        sides.into_iter().map(|side| self.ball(side)).fold(first, sooner)
    }

    /// Whether the start is in the prism that the segment, moved backwards, sweeps from a triangle.
    fn starts_within(&self, [a, b, c]: [Vector; 3]) -> bool {
        let from = minus(along(self.origin, self.start, self.direction), a);
        let (e, f, g) = (minus(b, a), minus(c, a), self.axis.map(|x| -x));
        let whole = dot(e, cross(f, g));
        if whole == 0.0 {
            return false;
        }
        let v = dot(from, cross(f, g)) / whole;
        let w = dot(e, cross(from, g)) / whole;
        let x = dot(e, cross(f, from)) / whole;
        v >= 0.0 && w >= 0.0 && v + w <= 1.0 && (0.0..=1.0).contains(&x)
    }

    /// When a ball touches a triangle first.
    fn ball(&self, corners: [Vector; 3]) -> Option<f64> {
        let (radius, start) = (self.radius, self.start);
        let first = along(self.origin, start, self.direction);
        if of_corners(first, corners).distance_squared <= radius * radius {
            return Some(start);
        }
        let mut best = self.face(corners);
        let [a, b, c] = corners;
        for [from, to] in [[a, b], [a, c], [b, c]] {
            best = sooner(best, self.edge(from, to));
        }
        for corner in corners {
            best = sooner(best, self.corner(corner));
        }
        best
    }

    /// What is neither before the start nor beyond what still counts.
    fn counted(&self, s: f64) -> Option<f64> {
        (s >= self.start && s <= self.stop).then_some(s)
    }

    fn face(&self, [a, b, c]: [Vector; 3]) -> Option<f64> {
        let (normal, _) = unit(cross(minus(b, a), minus(c, a)))?;
        let (height, speed) = (dot(normal, minus(self.origin, a)), dot(normal, self.direction));
        let side = if speed < 0.0 { 1.0 } else { -1.0 };
        let s = self.counted((height * side - self.radius) / speed.abs())?;
        let foot = along(along(self.origin, s, self.direction), -side * self.radius, normal);
        let within = [[a, b], [b, c], [c, a]]
            .into_iter()
            .all(|[from, to]| dot(normal, cross(minus(to, from), minus(foot, from))) >= 0.0);
        within.then_some(s)
    }

    fn edge(&self, from: Vector, to: Vector) -> Option<f64> {
        let (edge, length) = unit(minus(to, from))?;
        let across = cross(self.direction, edge);
        let turn = dot(across, across);
        let out = minus(self.origin, from);
        let apart = dot(out, across);
        let room = self.radius * self.radius - apart * apart / turn;
        // A way along the edge meets its ends first.
        if turn < 1e-24 || room < 0.0 {
            return None;
        }
        let middle = dot(cross(edge, out), across) / turn;
        let s = self.counted(middle - sqrt(room / turn))?;
        let place = dot(along(out, s, self.direction), edge);
        (0.0..=length).contains(&place).then_some(s)
    }

    fn corner(&self, corner: Vector) -> Option<f64> {
        let out = minus(self.origin, corner);
        let ahead = dot(out, self.direction);
        let beside = along(out, -ahead, self.direction);
        let room = self.radius * self.radius - dot(beside, beside);
        if room < 0.0 {
            return None;
        }
        self.counted(-ahead - sqrt(room))
    }

    /// The first impact so far.
    pub fn best(&self) -> Impact {
        if self.triangle == u32::MAX {
            return Impact::NONE;
        }
        if self.stop == self.start {
            return Impact { t: self.t_min, triangle: self.triangle };
        }
        Impact { t: (self.stop / self.length) as f32, triangle: self.triangle }
    }
}

fn sooner(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b < a { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// About what a search holds, for errors.
const BYTES: u64 = 4096;

/// The first impact of a cast, by the tree: the reference.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
///
/// # Errors
/// No memory for the search.
pub fn impact(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    cast: &Cast,
    options: &CastOptions<'_>,
) -> Result<Impact, QueryError> {
    let Some(search) = CastSearch::new(cast, &tree.bounds, options) else {
        return Ok(Impact::NONE);
    };
    let search = core::cell::Cell::new(search);
    let bound = |cell: &Aabb| match search.get().bound(cell) {
        Some(bound) if search.get().is_open(bound) => bound,
        _ => f64::INFINITY,
    };
    let found = tree.find_best(f64::MAX, bound, |leaf| {
        let mut here = search.get();
        for &triangle in leaf.triangles {
            here.test(&triangles.corners(triangle), triangle);
        }
        search.set(here);
        ControlFlow::Continue((here.stop + here.stop.abs() * 1e-14).min(f64::MAX))
    });
    found.map_err(|_| refused(BYTES))?;
    Ok(search.get().best())
}

/// The first impacts of a batch, one at a time: the reference. `watch` is called every 64 casts.
///
/// # Errors
/// `casts` and `impacts` of different length, a watch that cancels the batch, and no memory for a search.
pub fn one_by_one(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    casts: &[Cast],
    impacts: &mut [Impact],
    options: &CastOptions<'_>,
) -> Result<QueryReport, QueryError> {
    check_lengths(casts.len(), impacts.len())?;
    let total = casts.len() as u64;
    for (done, (cast, own)) in casts.iter().zip(impacts).enumerate() {
        if done % 64 == 0 {
            go_on_tracing(options.watch, done as u64, total)?;
        }
        *own = impact(tree, triangles, cast, options)?;
    }
    go_on_tracing(options.watch, total, total)?;
    Ok(QueryReport::default())
}

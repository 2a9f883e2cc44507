//! The reference traversal of accuracy `exact`: intervals in `f64`, whose range and precision make
//! scaling, moving and slack unnecessary.

use core::ops::ControlFlow;

use super::{Observer, Query, Triangles};
use crate::aabb::Aabb;
use crate::exact::{ExactRay, Meeting, meet};
use crate::query::walk::{Leaf, Visitor, WalkRay, walk};
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::tree::KdTreeView;
use crate::triangle::Triangle;

/// Relative widening of the distance to a plane: the difference of two floats and a quotient are one
/// rounding of `f64` each, 2^-53, and so is the widening; this is twice that.
const PLANE_SLACK: f64 = 8.0 * f64::EPSILON / 2.0;

/// A ray among the planes of a tree, for traversals of any layout.
#[derive(Clone, Copy, Debug)]
pub struct Walker {
    origin: [f64; 3],
    direction: [f64; 3],
}

impl Walker {
    /// The walker of a ray.
    pub fn new(ray: &ExactRay) -> Walker {
        Walker { origin: ray.origin.map(f64::from), direction: ray.direction.map(f64::from) }
    }

    /// The interval in which the ray may be inside the bounds, which must not be empty; `None` when it
    /// is nowhere between its limits.
    pub fn enter(&self, bounds: &Aabb, ray: &ExactRay) -> Option<(f64, f64)> {
        let (mut enter, mut exit) = (f64::from(ray.t_min), f64::from(ray.t_max));
        for axis in 0..3 {
            let low = self.plane_interval(axis, bounds.lo[axis]);
            let high = self.plane_interval(axis, bounds.hi[axis]);
            let (near, far) = if self.is_backwards(axis) { (high, low) } else { (low, high) };
            enter = enter.max(near.0);
            exit = exit.min(far.1);
        }
        (enter <= exit).then_some((enter, exit))
    }
}

impl WalkRay for Walker {
    type T = f64;

    #[inline]
    fn is_backwards(&self, axis: usize) -> bool {
        self.direction[axis] < 0.0
    }

    #[inline]
    fn plane_interval(&self, axis: usize, position: f32) -> (f64, f64) {
        let distance = f64::from(position) - self.origin[axis];
        if self.direction[axis] == 0.0 {
            // Near is below, since the direction is not negative.
            return if distance > 0.0 {
                (f64::INFINITY, f64::INFINITY)
            } else if distance < 0.0 {
                (f64::NEG_INFINITY, f64::NEG_INFINITY)
            } else {
                (f64::NEG_INFINITY, f64::INFINITY)
            };
        }
        let t = distance / self.direction[axis];
        let error = t.abs() * PLANE_SLACK;
        (t - error, t + error)
    }
}

/// The closest hit of a ray, exactly.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn closest_hit(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> Option<Hit> {
    trace(tree, triangles, ray, options, Query::Closest, &mut ()).some()
}

/// Traces one ray exactly, whatever accuracy the options name.
pub fn trace<O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    observer: &mut O,
) -> Hit {
    let mut best = Best::default();
    visit(tree, triangles, ray, options, observer, |ray, corners, triangle| {
        best.test(ray, corners, triangle, options.culling, query)
    });
    best.hit()
}

/// Traces one ray exactly, for hits that `keep` keeps.
pub(super) fn trace_kept(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
    mut keep: impl FnMut(&Hit) -> bool,
) -> Hit {
    let mut best = Best::default();
    visit(tree, triangles, ray, options, &mut (), |ray, corners, triangle| {
        best.test_kept(ray, corners, triangle, options.culling, query, |met| {
            keep(&met.hit(triangle))
        })
    });
    best.hit()
}

/// The best of the triangles tested so far: least (exact distance, index).
#[derive(Clone, Copy, Debug, Default)]
pub struct Best {
    met: Option<Meeting>,
    triangle: u32,
}

impl Best {
    /// Tests a triangle (snapped corners). Returns the `t` beyond which no leaf is of interest any
    /// more.
    #[inline]
    pub fn test(
        &mut self,
        ray: &ExactRay,
        corners: &Triangle,
        triangle: u32,
        culling: Culling,
        query: Query,
    ) -> f64 {
        self.test_kept(ray, corners, triangle, culling, query, |_| true)
    }

    /// The same for what `keep` keeps. It is asked only for what would be the best.
    #[inline]
    fn test_kept(
        &mut self,
        ray: &ExactRay,
        corners: &Triangle,
        triangle: u32,
        culling: Culling,
        query: Query,
        keep: impl FnOnce(&Meeting) -> bool,
    ) -> f64 {
        if let Some(met) = meet(ray, corners, culling)
            && met.is_within_limits()
        {
            let nearer = self
                .met
                .as_ref()
                .is_none_or(|best| met.compare_t(best).then(triangle.cmp(&self.triangle)).is_lt());
            if nearer && keep(&met) {
                (self.met, self.triangle) = (Some(met), triangle);
            }
        }
        if query == Query::Any && self.met.is_some() { f64::NEG_INFINITY } else { self.stop() }
    }

    /// The `t` beyond which nothing is of interest when the closest hit is asked for.
    #[inline]
    pub fn stop(&self) -> f64 {
        self.t_interval().1
    }

    /// An interval of `f64` that holds the distance of the best hit so far; infinity where there is none.
    #[inline]
    pub fn t_interval(&self) -> (f64, f64) {
        self.met.as_ref().map_or((f64::INFINITY, f64::INFINITY), Meeting::t_interval)
    }

    /// The triangle of the best hit so far.
    #[inline]
    pub fn triangle(&self) -> Option<u32> {
        self.met.as_ref().map(|_| self.triangle)
    }

    /// The hit, or the record of a miss.
    pub fn hit(&self) -> Hit {
        self.met.as_ref().map_or(Hit::MISS, |met| met.hit(self.triangle))
    }

    /// Whether anything was hit.
    pub fn is_hit(&self) -> bool {
        self.met.is_some()
    }
}

/// Calls `test` for the triangles of all leaves that the ray may pass, near ones first, a triangle
/// as often as it has references there. `test` returns the `t` beyond which no more leaves are of
/// interest.
///
/// `tree` must be valid (see [`tree::validate`](crate::tree::validate)).
pub fn visit<O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
    observer: &mut O,
    test: impl FnMut(&ExactRay, &Triangle, u32) -> f64,
) {
    let Some(ray) = ExactRay::new(ray) else { return };
    if tree.bounds.is_empty() {
        return;
    }
    let walker = Walker::new(&ray);
    let Some(interval) = walker.enter(&tree.bounds, &ray) else { return };
    let stop = f64::INFINITY;
    let mut visitor = Tested { tree, triangles, ray: &ray, options, observer, test, stop };
    walk(tree.nodes, &walker, interval, &mut visitor);
}

/// Hands the triangles of leaves to a test.
struct Tested<'a, S: ?Sized, O, F> {
    tree: &'a KdTreeView<'a>,
    triangles: &'a S,
    ray: &'a ExactRay,
    options: &'a QueryOptions<'a>,
    observer: &'a mut O,
    test: F,
    /// The last result of the test.
    stop: f64,
}

impl<S, O, F> Visitor<f64> for Tested<'_, S, O, F>
where
    S: Triangles + ?Sized,
    O: Observer,
    F: FnMut(&ExactRay, &Triangle, u32) -> f64,
{
    #[inline(always)]
    fn node(&mut self) {
        self.observer.node();
    }

    #[inline(always)]
    fn leaf(&mut self, Leaf { first, count, .. }: Leaf<f64>) -> ControlFlow<(), f64> {
        let tested = if self.observer.leaf(count) { self.tree.leaf(first, count) } else { &[] };
        for &triangle in tested {
            if self.options.ignore == Some(triangle) {
                continue;
            }
            self.observer.triangle();
            self.stop = (self.test)(self.ray, &self.triangles.corners(triangle), triangle);
        }
        ControlFlow::Continue(self.stop)
    }
}

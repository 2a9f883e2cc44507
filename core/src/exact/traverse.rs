//! The reference traversal of accuracy `exact`: intervals in `f64`, whose range and precision leave
//! nothing to scale, to move or to make slack for.

use super::ExactRay;
use super::meeting::{Meeting, meet};
use crate::aabb::Aabb;
use crate::config::MAX_DEPTH;
use crate::node::NodeKind;
use crate::ray::{Culling, Hit, QueryOptions, Ray};
use crate::traverse::{Observer, Query, Triangles};
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

    /// Whether the ray comes to the upper side of a plane first.
    #[inline]
    pub fn is_backwards(&self, axis: usize) -> bool {
        self.direction[axis] < 0.0
    }

    /// The least and greatest `t` at which the ray may be at a plane: from minus to plus infinity for
    /// one it lies in; both of the same infinity for one that it never reaches, on the side where it
    /// makes the ray be on the near side for ever or on the far one.
    #[inline]
    pub fn plane_interval(&self, axis: usize, position: f32) -> (f64, f64) {
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

/// The closest hit of a ray, exactly.
///
/// `tree` must be valid (see [`crate::validate`]).
pub fn closest_hit(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
) -> Option<Hit> {
    trace(tree, triangles, ray, options, Query::Closest, &mut ()).some()
}

/// One ray, exactly; whatever accuracy the options name.
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

/// The best of the triangles tested so far: least (exact distance, index).
#[derive(Clone, Copy, Debug, Default)]
pub struct Best {
    met: Option<Meeting>,
    triangle: u32,
}

impl Best {
    /// Tests a triangle (snapped corners). Gives the `t` beyond which no leaf is of interest any more.
    #[inline]
    pub fn test(
        &mut self,
        ray: &ExactRay,
        corners: &Triangle,
        triangle: u32,
        culling: Culling,
        query: Query,
    ) -> f64 {
        if let Some(met) = meet(ray, corners, culling)
            && met.is_within_limits()
        {
            let nearer = self
                .met
                .as_ref()
                .is_none_or(|best| met.compare_t(best).then(triangle.cmp(&self.triangle)).is_lt());
            if nearer {
                (self.met, self.triangle) = (Some(met), triangle);
            }
        }
        if query == Query::Any && self.met.is_some() { f64::NEG_INFINITY } else { self.stop() }
    }

    /// The `t` beyond which nothing is of interest when the closest hit is asked for.
    #[inline]
    pub fn stop(&self) -> f64 {
        self.met.as_ref().map_or(f64::INFINITY, |best| best.t_interval().1)
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

/// Calls `test` for the triangles of all leaves that the ray may pass, near ones first, a triangle as
/// often as it has references there. `test` gives the `t` beyond which no more leaves are of interest.
pub(crate) fn visit<O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions<'_>,
    observer: &mut O,
    mut test: impl FnMut(&ExactRay, &Triangle, u32) -> f64,
) {
    let Some(ray) = ExactRay::new(ray) else { return };
    if tree.bounds.is_empty() {
        return;
    }
    let walker = Walker::new(&ray);
    let Some((mut enter, mut exit)) = walker.enter(&tree.bounds, &ray) else { return };
    let mut stop = f64::INFINITY;
    let mut stack = [(0u32, 0.0f64, 0.0f64); MAX_DEPTH as usize + 1];
    let mut top = 0;
    let mut node = 0u32;
    loop {
        observer.node();
        match tree.nodes[node as usize].kind() {
            NodeKind::Interior { axis, split, right } => {
                let (least, greatest) = walker.plane_interval(axis.index(), split);
                let backwards = walker.is_backwards(axis.index());
                let (near, far) = if backwards { (right, node + 1) } else { (node + 1, right) };
                if greatest < enter {
                    node = far;
                } else if least > exit {
                    node = near;
                } else {
                    stack[top] = (far, enter.max(least), exit);
                    top += 1;
                    node = near;
                    exit = exit.min(greatest);
                }
                continue;
            }
            NodeKind::Leaf { first, count } => {
                let tested = if observer.leaf(count) { tree.leaf(first, count) } else { &[] };
                for &triangle in tested {
                    if options.ignore == Some(triangle) {
                        continue;
                    }
                    observer.triangle();
                    stop = test(&ray, &triangles.corners(triangle), triangle);
                }
            }
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            (node, enter, exit) = stack[top];
            if enter <= stop {
                break;
            }
        }
    }
}

//! The reference traversal of accuracy `exact`: intervals in `f64`, whose range and precision leave
//! nothing to scale, to move or to make slack for.

use super::ExactRay;
use super::meeting::{Meeting, meet};
use crate::aabb::Aabb;
use crate::config::MAX_DEPTH;
use crate::node::NodeKind;
use crate::ray::{Hit, QueryOptions, Ray};
use crate::traverse::{Observer, Query, Triangles};
use crate::tree::KdTreeView;
use crate::triangle::Triangle;

/// Relative widening of the distance to a plane: the difference of two floats and a quotient are one
/// rounding of `f64` each, 2^-53, and so is the widening; this is twice that.
const PLANE_SLACK: f64 = 8.0 * f64::EPSILON / 2.0;

/// A ray among the planes of a tree.
#[derive(Clone, Copy, Debug)]
struct Walker {
    origin: [f64; 3],
    direction: [f64; 3],
}

impl Walker {
    fn new(ray: &ExactRay) -> Walker {
        Walker { origin: ray.origin.map(f64::from), direction: ray.direction.map(f64::from) }
    }

    /// The least and greatest `t` at which the ray may be at a plane: from minus to plus infinity for
    /// one it lies in; both of the same infinity for one that it never reaches, on the side where it
    /// makes the ray be on the near side for ever or on the far one.
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

    fn enter(&self, bounds: &Aabb, ray: &ExactRay) -> Option<(f64, f64)> {
        let (mut enter, mut exit) = (f64::from(ray.t_min), f64::from(ray.t_max));
        for axis in 0..3 {
            let low = self.plane_interval(axis, bounds.lo[axis]);
            let high = self.plane_interval(axis, bounds.hi[axis]);
            let (near, far) = if self.direction[axis] < 0.0 { (high, low) } else { (low, high) };
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
    options: &QueryOptions,
) -> Option<Hit> {
    trace(tree, triangles, ray, options, Query::Closest, &mut ()).some()
}

/// One ray, exactly; whatever accuracy the options name.
pub fn trace<O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
    query: Query,
    observer: &mut O,
) -> Hit {
    let mut best: Option<(Meeting, u32)> = None;
    visit(tree, triangles, ray, options, observer, |ray, corners, triangle| {
        if let Some(met) = meet(ray, corners, options.culling)
            && met.is_within_limits()
        {
            let nearer = best.is_none_or(|(other, index)| {
                met.compare_t(&other).then(triangle.cmp(&index)).is_lt()
            });
            if nearer {
                best = Some((met, triangle));
            }
        }
        match best {
            None => f64::INFINITY,
            Some(_) if query == Query::Any => f64::NEG_INFINITY,
            Some((best, _)) => best.t_interval().1,
        }
    });
    best.map_or(Hit::MISS, |(met, triangle)| met.hit(triangle))
}

/// Calls `test` for the triangles of all leaves that the ray may pass, near ones first, a triangle as
/// often as it has references there. `test` gives the `t` beyond which no more leaves are of interest.
pub(crate) fn visit<O: Observer>(
    tree: &KdTreeView<'_>,
    triangles: &(impl Triangles + ?Sized),
    ray: &Ray,
    options: &QueryOptions,
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
                let backwards = walker.direction[axis.index()] < 0.0;
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

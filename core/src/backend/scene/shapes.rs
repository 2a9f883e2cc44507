//! Shapes as a geometry that answers rays.

use alloc::sync::Arc;
use alloc::vec::Vec;

use crate::aabb::Aabb;
use crate::backend::Accelerator;
use crate::cancel::go_on_tracing;
use crate::config::BuildConfig;
use crate::error::{BuildError, QueryError, check_bytes, refused};
use crate::query::all_hits::{AllHits, AllHitsOptions, Crossing};
use crate::query::inside::{LocateOptions, Located, check_points, no_windings};
use crate::query::traverse::Query;
use crate::ray::{Hit, QueryOptions, Ray};
use crate::report::{BuildSummary, QueryReport};
use crate::scene::ShapeTree;
use crate::scene::shape::{Capsule, Shapes, Sphere};
use crate::tree::KdTree;
use crate::tree::node::KdNode;

/// A set of shapes, as what answers rays of a geometry. It has no triangles: its kd-tree is empty.
pub(super) struct ShapeAccelerator {
    shapes: Arc<ShapeTree>,
    empty: KdTree,
    summary: BuildSummary,
}

/// Rays between two calls of the watch.
const SLICE: usize = 256;

impl ShapeAccelerator {
    pub(super) fn new(shapes: Arc<ShapeTree>) -> Result<ShapeAccelerator, BuildError> {
        let mut nodes = Vec::new();
        let bytes = size_of::<KdNode>() as u64;
        let refused = |_| BuildError::OutOfMemory { needed: bytes, limit: bytes };
        nodes.try_reserve_exact(1).map_err(refused)?;
        nodes.push(KdNode::leaf(0, 0));
        let (bounds, config) = (Aabb::EMPTY, BuildConfig::default());
        let empty = KdTree { nodes, references: Vec::new(), bounds, triangles: 0, config };
        Ok(ShapeAccelerator { shapes, empty, summary: BuildSummary::default() })
    }
}

impl Accelerator for ShapeAccelerator {
    fn tree(&self) -> &KdTree {
        &self.empty
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        self.shapes.bytes()
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.shapes.trace(ray, options, Query::Closest, |_| true).some()
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.shapes.trace(ray, options, Query::Any, |_| true).is_hit()
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        let AllHitsOptions { max_memory, watch, .. } = *options;
        let (total, query) = (rays.len() as u64, options.query());
        check_bytes((rays.len() * size_of::<usize>()) as u64, max_memory)?;
        let mut all = AllHits::with_room(rays.len())?;
        for (number, ray) in rays.iter().enumerate() {
            if number % SLICE == 0 {
                go_on_tracing(watch, number as u64, total)?;
            }
            let (first, mut failed) = (all.crossings.len(), None);
            let starts = (all.starts.capacity() * size_of::<usize>()) as u64;
            let crossings = &mut all.crossings;
            self.shapes.trace_all(ray, &query, |hit, front| {
                if failed.is_some() {
                    return;
                }
                // Grown by halves of what is there, within the limit.
                let more = if crossings.len() < crossings.capacity() {
                    0
                } else {
                    (crossings.len() / 2).max(8)
                };
                let needed = starts + ((crossings.len() + more) * size_of::<Crossing>()) as u64;
                let grown = check_bytes(needed, max_memory)
                    .and_then(|()| crossings.try_reserve_exact(more).map_err(|_| refused(needed)));
                match grown {
                    Ok(()) => crossings.push(Crossing { hit, front }),
                    Err(error) => failed = Some(error),
                }
            });
            if let Some(error) = failed {
                return Err(error);
            }
            // A tangent enters and leaves at one place, in this order.
            let key = |one: &Crossing| (one.hit.triangle, !one.front);
            all.crossings[first..]
                .sort_unstable_by(|a, b| a.hit.t.total_cmp(&b.hit.t).then(key(a).cmp(&key(b))));
            all.starts.push(all.crossings.len());
        }
        go_on_tracing(watch, total, total)?;
        Ok(all)
    }

    /// In how many of the spheres or capsules each point is, by `f64`; `None` where it is on one.
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        let LocateOptions { max_memory, watch } = *options;
        check_points(points.len(), max_memory)?;
        let windings = no_windings(points.len())?;
        let mut located = Located { windings, report: QueryReport::default() };
        let total = points.len() as u64;
        for (done, (&point, winding)) in points.iter().zip(&mut located.windings).enumerate() {
            if done % SLICE == 0 {
                go_on_tracing(watch, done as u64, total)?;
            }
            *winding = winding_of(&self.shapes, point)?;
        }
        go_on_tracing(watch, total, total)?;
        Ok(located)
    }
}

/// The number of shapes around a point.
fn winding_of(shapes: &ShapeTree, point: [f32; 3]) -> Result<Option<i32>, QueryError> {
    if matches!(shapes.shapes(), Shapes::Own(_)) {
        return Err(QueryError::Unsupported { query: "points inside own shapes" });
    }
    let mut around = Some(0i32);
    let point = point.map(f64::from);
    shapes.near(point, 0.0, |primitive| {
        let (axis, radius) = axis_of(shapes.shapes(), primitive);
        let from = minus(point, nearest_of_segment(point, axis).1);
        let beyond = dot(from, from) - radius * radius;
        around = match around {
            Some(count) if beyond < 0.0 => Some(count.saturating_add(1)),
            Some(count) if beyond > 0.0 => Some(count),
            _ => None,
        };
        0.0
    });
    Ok(around)
}

/// The ends of a sphere's or capsule's axis, and the radius.
pub(super) fn axis_of(shapes: &Shapes, primitive: u32) -> ([[f64; 3]; 2], f64) {
    let at = primitive as usize;
    let none = ([[f64::INFINITY; 3]; 2], 0.0);
    match shapes {
        Shapes::Spheres(all) => all
            .get(at)
            .map_or(none, |own: &Sphere| ([own.centre.map(f64::from); 2], f64::from(own.radius))),
        Shapes::Capsules(all) => all.get(at).map_or(none, |own: &Capsule| {
            (own.ends.map(|end| end.map(f64::from)), f64::from(own.radius))
        }),
        Shapes::Own(_) => none,
    }
}

/// The point of a segment that is nearest to a point, and how far along it is, from 0 to 1.
pub(super) fn nearest_of_segment(point: [f64; 3], [a, b]: [[f64; 3]; 2]) -> (f64, [f64; 3]) {
    let (along, from) = (minus(b, a), minus(point, a));
    let (squared, part) = (dot(along, along), dot(along, from));
    let part = if squared > 0.0 { (part / squared).clamp(0.0, 1.0) } else { 0.0 };
    (part, [0, 1, 2].map(|k| a[k] + part * along[k]))
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

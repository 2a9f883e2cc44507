//! One ray at a time, exactly: the reference traversal of accuracy `exact` over the tree's own nodes, in
//! `f64`.

use splitplane_core::aabb::Aabb;
use splitplane_core::exact::ExactRay;
use splitplane_core::query::all_hits::Collector;
use splitplane_core::query::traverse::Query;
use splitplane_core::query::traverse::exact::{Best, Walker};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;

use super::walk::walk;
use crate::layout::tree_layout::TreeLayout;

/// The exact closest hit of a ray, or any hit, in `f64` from the root on: for rays of all kinds.
pub(crate) fn trace_in_f64(
    blocks: &TreeLayout,
    bounds: &Aabb,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
) -> Hit {
    let mut best = Best::default();
    visit(blocks, bounds, ray, options, |ray, corners, triangle| {
        best.test(ray, corners, triangle, options.culling, query)
    });
    best.hit()
}

/// Hands what a ray may cross to a collector, which asks `go_on`.
pub(crate) fn all_hits(
    blocks: &TreeLayout,
    bounds: &Aabb,
    ray: &Ray,
    options: &QueryOptions<'_>,
    collector: &mut Collector,
    mut go_on: impl FnMut(u64) -> bool,
) {
    visit(blocks, bounds, ray, options, |ray, corners, triangle| {
        collector.test_while(ray, corners, triangle, options.culling, &mut go_on)
    });
}

/// Calls `test` for the triangles of all leaves that a ray may pass, near ones first. `test`
/// returns the `t` beyond which no more leaves are of interest.
pub(crate) fn visit(
    blocks: &TreeLayout,
    bounds: &Aabb,
    ray: &Ray,
    options: &QueryOptions<'_>,
    mut test: impl FnMut(&ExactRay, &Triangle, u32) -> f64,
) {
    let Some(ray) = ExactRay::new(ray) else { return };
    if bounds.is_empty() {
        return;
    }
    let walker = Walker::new(&ray);
    let Some(interval) = walker.enter(bounds, &ray) else { return };
    let mut stop = f64::INFINITY;
    walk(blocks.walk_nodes(), &walker, interval, |leaf| {
        blocks.any_triangle(leaf, |triangle, corners| {
            if options.ignore != Some(triangle) {
                stop = test(&ray, corners, triangle);
            }
            false
        });
        Some(stop)
    });
}

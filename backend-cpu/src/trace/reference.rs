//! One ray with care: by the core's tests, triangle by triangle. For the few rays that the vector
//! code does not handle: moved ones, and extreme exponents.

use splitplane_core::arithmetic::Strict;
use splitplane_core::query::intersect::{PreparedRay, SceneScale};
use splitplane_core::query::traverse::{InnerRay, Query};
use splitplane_core::ray::{Hit, QueryOptions, Ray};

use super::block_test::{BestHit, test_one};
use super::walk::walk;
use crate::layout::tree_layout::TreeLayout;

/// Traces one ray from the root.
#[cold]
pub(crate) fn trace(
    blocks: &TreeLayout,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions<'_>,
    query: Query,
) -> Hit {
    let mut best = BestHit::NONE;
    let Some(ray) = PreparedRay::new::<Strict>(ray, scene) else { return best.hit };
    let Some(interval) = ray.enter::<Strict>(&scene.bounds) else { return best.hit };
    walk(blocks.walk_nodes(), &InnerRay::<Strict>::new(&ray), interval, |leaf| {
        let answered = blocks.any_triangle(leaf, |triangle, corners| {
            test_one(&ray, corners, triangle, options, &mut best) && query == Query::Any
        });
        (!answered).then_some(best.stop)
    });
    best.hit
}

//! One ray with care: by the core's tests, triangle by triangle. For the few rays that vectors are not
//! made for: moved ones, and extreme exponents.

use splitplane_core::arithmetic::Strict;
use splitplane_core::intersect::{PreparedRay, SceneScale};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::traverse::{InnerRay, Query};

use super::blocks::Blocks;
use super::leaf::{BestHit, test_one};
use super::walk::walk;

/// Traces one ray from the root.
#[cold]
pub(crate) fn trace(
    blocks: &Blocks,
    scene: &SceneScale,
    ray: &Ray,
    options: &QueryOptions,
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

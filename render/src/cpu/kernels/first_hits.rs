//! Records the hit of the first ray of every pixel.

use crate::layout::{FirstHit, Path};
use crate::vector::{dot, negated, normalized};
use crate::world::{Spot, World};
use splitplane_core::ray::{Hit, Ray};

pub(crate) fn run(
    world: impl World,
    rays: &[Ray],
    paths: &[Path],
    (hits, instances): (&[Hit], &[u32]),
    first_hits: &mut [FirstHit],
) {
    for (i, ((ray, path), hit)) in rays.iter().zip(paths).zip(hits).enumerate() {
        if path.sequence == 0 {
            first_hits[path.pixel as usize] =
                first_hit(world, ray, hit, instances.get(i).copied().unwrap_or(0));
        }
    }
}

fn first_hit(world: impl World, ray: &Ray, hit: &Hit, instance: u32) -> FirstHit {
    if !hit.is_hit() {
        return FirstHit::MISS;
    }
    let mut normal = match world.round(ray, (hit, instance)) {
        Some(place) => place.normal,
        None => normalized(world.plane(Spot { triangle: hit.triangle, instance }).1.scaled_normal),
    };
    if dot(normal, ray.direction) > 0.0 {
        normal = negated(normal);
    }
    FirstHit { normal, depth: hit.t, triangle: hit.triangle, u: hit.u, v: hit.v, instance }
}

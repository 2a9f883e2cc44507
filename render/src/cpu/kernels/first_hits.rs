//! Records the hit of the first ray of every pixel.

use crate::layout::{FirstHit, Path};
use crate::plane::Plane;
use crate::vector::{dot, negated, normalized};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::traverse::Triangles;
use splitplane_core::ray::{Hit, Ray};

pub(crate) fn run(
    mesh: Mesh<'_>,
    rays: &[Ray],
    paths: &[Path],
    hits: &[Hit],
    first_hits: &mut [FirstHit],
) {
    for ((ray, path), hit) in rays.iter().zip(paths).zip(hits) {
        if path.sequence == 0 {
            first_hits[path.pixel as usize] = first_hit(mesh, ray, hit);
        }
    }
}

fn first_hit(mesh: Mesh<'_>, ray: &Ray, hit: &Hit) -> FirstHit {
    if !hit.is_hit() {
        return FirstHit::MISS;
    }
    let mut normal = normalized(Plane::of(&mesh.corners(hit.triangle)).scaled_normal);
    if dot(normal, ray.direction) > 0.0 {
        normal = negated(normal);
    }
    FirstHit { normal, depth: hit.t, triangle: hit.triangle, u: hit.u, v: hit.v, padding: 0 }
}

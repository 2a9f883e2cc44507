//! Another structure, to compare with: a bounding volume hierarchy that is built once and refitted for every frame, in
//! the manner of Wald, Boulos and Shirley 2007.
//!
//! It is that of the crate `obvhs`. A refit copies the moved corners into the order of the leaves, bounds every leaf, and
//! the nodes above it. Rays go one by one, on all threads of the pool.

use glam::Vec3A;
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::ray::{Ray as BvhRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, aabb::Aabb};
use rayon::prelude::*;
use splitplane_core::ray::Ray;
use std::time::Duration;

/// A triangle's corners, finite.
pub type Corners = [[f32; 3]; 3];

/// How tables name it.
pub const NAME: &str = "BVH, obvhs 0.4";

/// Rays that a task traces.
const BATCH: usize = 1024;

/// A bounding volume hierarchy with its triangles in the order of its leaves.
pub struct Hierarchy {
    bvh: Bvh2,
    leaves: Vec<RtTriangle>,
    bounds: Vec<Aabb>,
}

impl Hierarchy {
    /// Builds it with the crate's settings of medium quality (PLOC and reinsertion). The order of nodes
    /// is one in which a single sweep refits.
    pub fn build(triangles: &[Corners]) -> Hierarchy {
        let all: Vec<Triangle> = triangles.iter().map(triangle).collect();
        // Splits would tie bounds to parts of triangles, which no refit knows of.
        let settings = BvhBuildParams { pre_split: false, ..BvhBuildParams::medium_build() };
        let mut bvh = build_bvh2_from_tris(&all, settings, &mut Duration::default());
        bvh.reorder_in_stack_traversal_order();
        let mut hierarchy = Hierarchy { bvh, leaves: Vec::new(), bounds: Vec::new() };
        hierarchy.refit(triangles);
        hierarchy
    }

    /// Takes over where the triangles now are.
    pub fn refit(&mut self, triangles: &[Corners]) {
        let Hierarchy { bvh, leaves, bounds } = self;
        let moved = |&index: &u32| {
            let moved = triangle(&triangles[index as usize]);
            (RtTriangle::from(&moved), moved.aabb())
        };
        bvh.primitive_indices
            .par_iter()
            .with_min_len(BATCH)
            .map(moved)
            .unzip_into_vecs(leaves, bounds);
        for node in bvh.nodes.iter_mut().filter(|node| node.is_leaf()) {
            let first = node.first_index as usize;
            let own = &bounds[first..first + node.prim_count as usize];
            let whole = own.iter().fold(Aabb::empty(), |whole, part| whole.union(part));
            node.set_aabb(whole);
        }
        bvh.refit_all();
    }

    /// The distance of every ray's closest hit; infinity for a miss.
    pub fn closest(&self, rays: &[Ray]) -> Vec<f32> {
        let closest = |ray: &Ray| {
            let mut hit = RayHit::none();
            let test = |ray: &BvhRay, index: usize| self.leaves[index].intersect(ray);
            self.bvh.ray_traverse(of(ray), &mut hit, test);
            hit.t
        };
        rays.par_iter().with_min_len(BATCH).map(closest).collect()
    }

    /// Whether every ray meets anything.
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        let occluded = |ray: &Ray| {
            let test = |ray: &BvhRay, index: usize| self.leaves[index].intersect(ray);
            !self.bvh.ray_traverse_miss(of(ray), test)
        };
        rays.par_iter().with_min_len(BATCH).map(occluded).collect()
    }
}

fn triangle([a, b, c]: &Corners) -> Triangle {
    let [v0, v1, v2] = [a, b, c].map(|corner| Vec3A::from_array(*corner));
    Triangle { v0, v1, v2 }
}

fn of(ray: &Ray) -> BvhRay {
    let vector = Vec3A::from_array;
    BvhRay::new(vector(ray.origin), vector(ray.direction), ray.t_min, ray.t_max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use splitplane::scene::Scene;
    use splitplane::{Backend, BuildOptions, CpuBackend, Hit, QueryOptions};

    /// Refitted to triangles that have moved, it answers as a kd-tree built over them.
    #[test]
    fn a_refitted_hierarchy_sees_what_has_moved() {
        let mut scene = Scene::open("builtin:carousel:4000").unwrap();
        let camera = scene.camera.unwrap();
        let before: Vec<Corners> = scene.triangles().collect();
        let mut hierarchy = Hierarchy::build(&before);
        let rays = camera.rays(64, 48);
        let old = hierarchy.closest(&rays);
        for position in &mut scene.positions {
            *position = [1.1 * position[0] + 0.3, 0.8 * position[1], position[2] - 0.2];
        }
        let after: Vec<Corners> = scene.triangles().collect();
        hierarchy.refit(&after);
        let new = hierarchy.closest(&rays);
        assert_ne!(old, new);
        let tree =
            CpuBackend::new().build(&scene.mesh().unwrap(), &BuildOptions::default()).unwrap();
        let mut hits = vec![Hit::MISS; rays.len()];
        tree.closest_hits(&rays, &mut hits, &QueryOptions::default()).unwrap();
        let mut stopped = vec![false; rays.len()];
        tree.any_hits(&rays, &mut stopped, &QueryOptions::default()).unwrap();
        let off = |(t, hit): &(&f32, &Hit)| {
            t.is_infinite() == hit.is_hit() || (hit.is_hit() && (*t - hit.t).abs() > 1e-3 * hit.t)
        };
        // Its triangle test may leak at edges.
        let off = new.iter().zip(&hits).filter(off).count();
        assert!(off <= 2, "{off}");
        assert!(hits.iter().filter(|hit| hit.is_hit()).count() > 500);
        let occluded = hierarchy.occluded(&rays);
        assert!(occluded.iter().zip(&stopped).filter(|(a, b)| a != b).count() <= 2);
    }
}

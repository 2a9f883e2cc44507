//! A backend that is right and slow: a tree of one leaf, rays answered by the exact oracle. Tests
//! are run on it to see that they pass where nothing is wrong.

use crate::oracle::{Oracle, snap};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::{BackendInfo, BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::node::KdNode;

/// The exact backend.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExactBackend;

struct ExactAccelerator {
    tree: KdTree,
    summary: BuildSummary,
    oracle: Oracle,
    triangles: Vec<[[f32; 3]; 3]>,
}

impl Backend for ExactBackend {
    fn describe(&self) -> BackendInfo {
        let mut info = BackendInfo::new("exact");
        (info.threads, info.detail) = (Some(1), "oracle of the tests".into());
        info
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        options.config.validate()?;
        let (tree, summary, triangles) = one_leaf(mesh, options);
        Ok(Box::new(ExactAccelerator { tree, summary, oracle: Oracle::new(mesh), triangles }))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let config = tree.config;
        let LoadOptions { max_memory, layout, watch } = *options;
        let built = self.build(mesh, &BuildOptions { config, max_memory, layout, watch })?;
        if *built.tree() != tree {
            return Err(BuildError::WrongMesh { reason: "another tree comes out".into() });
        }
        Ok(built)
    }
}

type Triangles = Vec<[[f32; 3]; 3]>;

/// A tree of one leaf, its summary, and the snapped triangles.
pub(crate) fn one_leaf(
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
) -> (KdTree, BuildSummary, Triangles) {
    let triangles: Triangles =
        (0..mesh.len()).map(|index| mesh.triangle(index).map(|corner| corner.map(snap))).collect();
    let mut summary = BuildSummary::default();
    summary.triangles = triangles.len() as u32;
    let (mut references, mut bounds) = (Vec::new(), Aabb::EMPTY);
    for (index, corners) in triangles.iter().enumerate() {
        let given = mesh.triangle(index).map(|corner| corner.map(f32::to_bits));
        let changed = given != corners.map(|corner| corner.map(f32::to_bits));
        let finite = corners.as_flattened().iter().all(|x| x.is_finite());
        summary.snapped += u32::from(finite && changed);
        if is_dropped(corners) {
            summary.dropped += 1;
            continue;
        }
        references.push(index as u32);
        bounds = bounds.union(&Aabb::of_points(corners));
    }
    let tree = KdTree {
        nodes: vec![KdNode::leaf(0, references.len() as u32)],
        references,
        bounds,
        triangles: triangles.len() as u32,
        config: options.config,
    };
    (tree, summary, triangles)
}

/// The documented rule: a non-finite coordinate, or two equal corners.
pub fn is_dropped(snapped: &[[f32; 3]; 3]) -> bool {
    let [a, b, c] = snapped;
    snapped.as_flattened().iter().any(|x| !x.is_finite()) || a == b || b == c || c == a
}

impl Accelerator for ExactAccelerator {
    fn tree(&self) -> &KdTree {
        &self.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        size_of_val(self.triangles.as_slice()) as u64
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        same_length(rays.len(), hits.len())?;
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_hit(ray, options).unwrap_or(Hit::MISS);
        }
        Ok(QueryReport::default())
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        same_length(rays.len(), occluded.len())?;
        for (ray, answer) in rays.iter().zip(occluded) {
            *answer = self.any_hit(ray, options);
        }
        Ok(QueryReport::default())
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        let (tree, triangles) = (self.tree.view(), &self.triangles[..]);
        AllHits::one_by_one(&tree, triangles, rays, options)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for crossing in self.oracle.crossings(ray, options) {
            // The order and the limits are those of the rounded distance, which the hit reports.
            let t = crossing.t as f32;
            let hit = Hit { t, triangle: crossing.triangle, u: 0.0, v: 0.0 };
            if t.is_finite()
                && t >= ray.t_min
                && t <= ray.t_max
                && best.is_none_or(|best| hit.precedes(&best))
            {
                best = Some(hit);
            }
        }
        let mut hit = best?;
        let [u, v] = self.oracle.weights_of(ray, hit.triangle)?.map(|x| x as f32);
        (hit.u, hit.v) = (u, v.min(1.0 - u));
        Some(hit)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.closest_hit(ray, options).is_some()
    }
}

pub(crate) fn same_length(rays: usize, results: usize) -> Result<(), QueryError> {
    if rays == results { Ok(()) } else { Err(QueryError::LengthMismatch { rays, results }) }
}

//! Backends that are wrong on purpose. Every check of the test suite is run on a fault it must
//! catch: a check that cannot fail proves nothing.

use crate::exact::{one_leaf, same_length};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::ray::{Culling, Hit, QueryOptions, Ray};
use splitplane_core::report::{BackendInfo, BuildSummary, QueryReport};
use splitplane_core::tree::KdTree;
use std::sync::atomic::{AtomicU32, Ordering};

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// One ray in about 64 is lost, chosen by its bits.
    Leak,
    /// Of triangles at the same distance the higher index wins.
    HigherIndexWins,
    /// `t_min` and `t_max` themselves do not count.
    OpenInterval,
    /// Culling is not looked at.
    NoCulling,
    /// The triangle to ignore is not ignored.
    NoIgnore,
    /// Distances are 1e-4 too great.
    WrongDistance,
    /// The closest hit is passed over for the one behind it, for one ray in about 64.
    SecondHit,
    /// The last answer of a batch is a miss.
    ForgetsLast,
    /// Any hit says yes to a ray that leaves the scene, for one ray in about 64.
    AnyHitDisagrees,
    /// Weights are exchanged.
    WrongWeights,
    /// Rays with NaN limits are answered as if they had none.
    AcceptsNan,
    /// Every other build gives another tree.
    Unstable,
    /// The tree lacks its last reference.
    LosesReference,
    /// Nothing is counted as dropped.
    CountsNothing,
    /// A missed ray hits triangle 0 instead, for one ray in about 64.
    Phantom,
    /// `t_min` and `t_max` are not looked at.
    NoLimits,
}

/// A backend with a fault.
pub struct FaultyBackend<B> {
    inner: B,
    fault: Fault,
    builds: AtomicU32,
}

impl<B> FaultyBackend<B> {
    /// Plants a fault in a backend.
    pub fn new(inner: B, fault: Fault) -> FaultyBackend<B> {
        FaultyBackend { inner, fault, builds: AtomicU32::new(0) }
    }
}

struct FaultyAccelerator {
    inner: Box<dyn Accelerator>,
    fault: Fault,
    tree: KdTree,
    summary: BuildSummary,
}

impl<B: Backend> Backend for FaultyBackend<B> {
    fn describe(&self) -> BackendInfo {
        self.inner.describe()
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let inner = self.inner.build(mesh, options)?;
        let build = self.builds.fetch_add(1, Ordering::Relaxed);
        let mut tree = inner.tree().clone();
        let mut summary = *inner.summary();
        match self.fault {
            Fault::Unstable if build % 2 == 1 => {
                let end = tree.references.len();
                tree.references[end.saturating_sub(2)..].reverse();
            }
            Fault::LosesReference => {
                use splitplane_core::tree::node::{KdNode, NodeKind};
                let last = tree.nodes.iter().rposition(
                    |node| matches!(node.kind(), NodeKind::Leaf { count, .. } if count > 0),
                );
                if let Some(index) = last
                    && let NodeKind::Leaf { first, count } = tree.nodes[index].kind()
                {
                    tree.nodes[index] = KdNode::leaf(first, count - 1);
                    tree.references.pop();
                }
            }
            Fault::CountsNothing => summary.dropped = 0,
            _ => {}
        }
        Ok(Box::new(FaultyAccelerator { inner, fault: self.fault, tree, summary }))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.inner.load(mesh, tree, options)
    }
}

/// True for about one ray in 64.
fn chosen(ray: &Ray) -> bool {
    let bits = hash_of(ray);
    bits.wrapping_mul(0x9e37_79b9) >> 26 == 0
}

fn hash_of(ray: &Ray) -> u32 {
    ray.origin
        .iter()
        .chain(&ray.direction)
        .fold(7u32, |hash, x| hash.rotate_left(5) ^ x.to_bits().wrapping_mul(0x85eb_ca6b))
}

impl FaultyAccelerator {
    fn alter(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        let mut options = *options;
        let mut asked = *ray;
        match self.fault {
            Fault::NoCulling => options.culling = Culling::None,
            Fault::NoIgnore => options.ignore = None,
            Fault::AcceptsNan if ray.t_min.is_nan() || ray.t_max.is_nan() => {
                asked = asked.with_limits(0.0, f32::INFINITY);
            }
            Fault::NoLimits => asked = asked.with_limits(f32::NEG_INFINITY, f32::INFINITY),
            _ => {}
        }
        let mut hit = self.inner.closest_hit(&asked, &options);
        match (self.fault, &mut hit) {
            (Fault::Leak, hit) if chosen(ray) => *hit = None,
            (Fault::OpenInterval, hit)
                if hit.is_some_and(|h| h.t <= ray.t_min || h.t >= ray.t_max) =>
            {
                *hit = None;
            }
            (Fault::WrongDistance, Some(hit)) => hit.t *= 1.0001,
            (Fault::WrongWeights, Some(hit)) => (hit.u, hit.v) = (hit.v, hit.u),
            (Fault::SecondHit, Some(hit)) if chosen(ray) => {
                let behind = asked.with_limits(hit.t.next_up(), ray.t_max);
                if let Some(second) = self.inner.closest_hit(&behind, &options) {
                    *hit = second;
                }
            }
            (Fault::HigherIndexWins, Some(hit)) => {
                // Ask again without the winner until the distance changes.
                let without = QueryOptions { ignore: Some(hit.triangle), ..options };
                if let Some(other) = self.inner.closest_hit(&asked, &without)
                    && other.t == hit.t
                {
                    *hit = other;
                }
            }
            (Fault::Phantom, hit @ None) if chosen(ray) && self.tree.triangles > 0 => {
                *hit = Some(Hit { t: 0.5, triangle: 0, u: 0.25, v: 0.25 });
            }
            _ => {}
        }
        hit
    }
}

impl Accelerator for FaultyAccelerator {
    fn tree(&self) -> &KdTree {
        &self.tree
    }

    fn summary(&self) -> &BuildSummary {
        &self.summary
    }

    fn query_bytes(&self) -> u64 {
        self.inner.query_bytes()
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.inner.closest_hits(rays, hits, options)?;
        for (ray, hit) in rays.iter().zip(hits.iter_mut()) {
            *hit = self.alter(ray, options).unwrap_or(Hit::MISS);
        }
        if self.fault == Fault::ForgetsLast
            && let Some(last) = hits.last_mut()
        {
            *last = Hit::MISS;
        }
        Ok(QueryReport::default())
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.inner.any_hits(rays, occluded, options)?;
        for (ray, answer) in rays.iter().zip(occluded) {
            *answer = self.any_hit(ray, options);
        }
        Ok(QueryReport::default())
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.inner.all_hits(rays, options)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.alter(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        let disagrees = self.fault == Fault::AnyHitDisagrees && chosen(ray);
        self.alter(ray, options).is_some() || disagrees
    }
}

/// Brute force with the test of Moeller and Trumbore 1997 in plain `f32`: right in the middle of
/// triangles, leaky at edges. What a careless backend looks like.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeakyBackend;

struct LeakyAccelerator {
    tree: KdTree,
    summary: BuildSummary,
    triangles: Vec<[[f32; 3]; 3]>,
}

impl Backend for LeakyBackend {
    fn describe(&self) -> BackendInfo {
        let mut info = BackendInfo::new("leaky");
        (info.threads, info.detail) = (Some(1), "wrong on purpose".into());
        info
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        options.config.validate()?;
        let (tree, summary, triangles) = one_leaf(mesh, options);
        Ok(Box::new(LeakyAccelerator { tree, summary, triangles }))
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        _: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.build(mesh, &tree.config.into())
    }
}

impl Accelerator for LeakyAccelerator {
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
        let sub = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|i| a[i] - b[i]);
        let cross = |a: [f32; 3], b: [f32; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let mut best = Hit::MISS;
        for (index, [a, b, c]) in self.triangles.iter().enumerate() {
            let (e, f) = (sub(*b, *a), sub(*c, *a));
            let p = cross(ray.direction, f);
            let determinant = dot(e, p);
            if determinant == 0.0 || options.ignore == Some(index as u32) {
                continue;
            }
            let s = sub(ray.origin, *a);
            let q = cross(s, e);
            let (u, v) = (dot(s, p) / determinant, dot(ray.direction, q) / determinant);
            let hit = Hit { t: dot(f, q) / determinant, triangle: index as u32, u, v };
            let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
            if inside && hit.t >= ray.t_min && hit.t <= ray.t_max && hit.precedes(&best) {
                best = hit;
            }
        }
        best.some()
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.closest_hit(ray, options).is_some()
    }
}

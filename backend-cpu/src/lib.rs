//! The rayon backend. (Scaffold: one leaf, brute force. Replaced by the real executor.)
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::*;
use splitplane_core::mesh::Mesh;
use splitplane_core::node::KdNode;
use splitplane_core::ray::*;
use splitplane_core::tree::KdTree;

/// The CPU backend. Work runs in the rayon pool of the calling thread.
#[derive(Debug, Default)]
pub struct CpuBackend {}

impl CpuBackend {
    /// A backend; cheap.
    pub fn new() -> CpuBackend {
        CpuBackend {}
    }
}

struct Scaffold {
    tree: KdTree,
    summary: BuildSummary,
    triangles: Vec<[[f32; 3]; 3]>,
}

impl Backend for CpuBackend {
    fn describe(&self) -> BackendInfo {
        BackendInfo {
            name: "cpu".into(),
            adapter: None,
            threads: Some(rayon::current_num_threads()),
            detail: "scaffold".into(),
        }
    }
    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        options.config.validate()?;
        let triangles: Vec<_> = (0..mesh.len()).map(|i| mesh.triangle(i)).collect();
        let n = triangles.len() as u32;
        let tree = KdTree {
            nodes: vec![KdNode::leaf(0, n)],
            references: (0..n).collect(),
            bounds: Aabb::of_points(triangles.as_flattened()),
            triangles: n,
            config: options.config,
        };
        Ok(Box::new(Scaffold {
            tree,
            summary: BuildSummary { triangles: n, ..Default::default() },
            triangles,
        }))
    }
    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &BuildOptions,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let _ = tree;
        self.build(mesh, options)
    }
}

impl Accelerator for Scaffold {
    fn tree(&self) -> &KdTree {
        &self.tree
    }
    fn summary(&self) -> &BuildSummary {
        &self.summary
    }
    fn query_bytes(&self) -> u64 {
        (self.triangles.len() * 36) as u64
    }
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        options: &QueryOptions,
    ) -> Result<(), QueryError> {
        use rayon::prelude::*;
        rays.par_iter()
            .zip(hits)
            .for_each(|(r, h)| *h = self.closest_hit(r, options).unwrap_or(Hit::MISS));
        Ok(())
    }
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &QueryOptions,
    ) -> Result<(), QueryError> {
        for (r, o) in rays.iter().zip(occluded) {
            *o = self.any_hit(r, options);
        }
        Ok(())
    }
    fn closest_hit(&self, ray: &Ray, _: &QueryOptions) -> Option<Hit> {
        let sub = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|i| a[i] - b[i]);
        let cross = |a: [f32; 3], b: [f32; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let mut best = Hit::MISS;
        for (i, [a, b, c]) in self.triangles.iter().enumerate() {
            let (e1, e2) = (sub(*b, *a), sub(*c, *a));
            let p = cross(ray.direction, e2);
            let det = dot(e1, p);
            if det == 0.0 {
                continue;
            }
            let s = sub(ray.origin, *a);
            let u = dot(s, p) / det;
            let q = cross(s, e1);
            let v = dot(ray.direction, q) / det;
            let t = dot(e2, q) / det;
            let hit = Hit { t, triangle: i as u32, u, v };
            if u >= 0.0
                && v >= 0.0
                && u + v <= 1.0
                && t >= ray.t_min
                && t <= ray.t_max
                && hit.precedes(&best)
            {
                best = hit;
            }
        }
        best.some()
    }
    fn any_hit(&self, ray: &Ray, options: &QueryOptions) -> bool {
        self.closest_hit(ray, options).is_some()
    }
}

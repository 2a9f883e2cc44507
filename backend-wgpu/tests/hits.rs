//! Hits of the device against the core's reference traversal, bit for bit.

mod common;

use std::sync::{Arc, OnceLock};

use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::intersect::{Limits, SceneScale};
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::traverse::{Query, trace};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Queries, WgpuAccelerator};

fn queries() -> Arc<Queries> {
    static QUERIES: OnceLock<Arc<Queries>> = OnceLock::new();
    QUERIES.get_or_init(|| Arc::new(Queries::new(common::gpu()))).clone()
}

/// A tree in host and in device memory.
struct Case {
    name: String,
    tree: KdTree,
    triangles: Vec<Triangle>,
    scale: SceneScale,
    device: WgpuAccelerator,
}

impl Case {
    fn new(scene: &Scene) -> Case {
        let mesh = scene.mesh();
        let built =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        let triangles: Vec<Triangle> =
            (0..mesh.len()).map(|i| prepare(&mesh.triangle(i)).corners).collect();
        let tree = built.tree().clone();
        let summary = *built.summary();
        let device = WgpuAccelerator::upload(queries(), tree.clone(), triangles.clone(), summary)
            .expect("an upload");
        assert_eq!(device.device_tree().scene_scale(), built.scene_scale(), "{}", scene.name);
        Case { name: scene.name.clone(), tree, triangles, scale: *built.scene_scale(), device }
    }

    fn reference(&self, ray: &Ray, options: &QueryOptions, query: Query) -> Hit {
        let view = self.tree.view();
        trace::<Strict>(&view, &self.triangles[..], &self.scale, ray, options, query)
    }

    /// Holds closest and any hit of all rays against the reference; gives how many hit.
    fn check(&self, rays: &[Ray], options: &QueryOptions, what: &str) -> usize {
        let stale = Hit { t: -7.0, triangle: 0xdead, u: 7.0, v: 7.0 };
        let mut hits = vec![stale; rays.len()];
        let mut occluded = [vec![false; rays.len()], vec![true; rays.len()]];
        self.device.closest_hits(rays, &mut hits, options).expect("hits");
        for occluded in &mut occluded {
            self.device.any_hits(rays, occluded, options).expect("answers");
        }
        let mut count = 0;
        for (i, ray) in rays.iter().enumerate() {
            let expected = self.reference(ray, options, Query::Closest);
            let name = &self.name;
            assert_eq!(
                bits(&hits[i]),
                bits(&expected),
                "{name}, {what}: {ray:?} {options:?}, found {:?}, expected {expected:?}",
                hits[i]
            );
            for occluded in &occluded {
                assert_eq!(
                    occluded[i],
                    expected.is_hit(),
                    "{name}, {what}, any: {ray:?} {options:?}"
                );
            }
            count += usize::from(expected.is_hit());
        }
        count
    }

    /// How many closest hits of another shader differ from the reference.
    fn hits(&self, rays: &[Ray], options: &QueryOptions) -> Vec<Hit> {
        let mut hits = vec![Hit::MISS; rays.len()];
        self.device.closest_hits(rays, &mut hits, options).expect("hits");
        hits
    }
}

/// Bits, so that -0 differs from 0.
fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.triangle, hit.u.to_bits(), hit.v.to_bits()]
}

#[test]
fn awkward_scenes() {
    let mut hits = 0;
    for scene in scenes::awkward() {
        let case = Case::new(&scene);
        let mesh = scene.mesh();
        let each = if mesh.len() >= 20_000 { 5 } else { 100 };
        for kind in Kind::ALL {
            let rays = aim::rays(&mesh, kind, each, 5);
            hits += case.check(&rays, &QueryOptions::default(), &format!("{kind:?}"));
        }
    }
    assert!(hits > 2000, "{hits}");
}

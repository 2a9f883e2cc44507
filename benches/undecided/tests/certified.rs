//! What a device would be certain of, through whole trees, against the exact oracle.

use splitplane_core::arithmetic::{Arithmetic, Hostile, Strict};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::certify;
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::oracle::{Oracle, OracleHit};
use splitplane_test_support::scenes::{self, Scene};

fn trace<A: Arithmetic>(built: &CpuAccelerator, mesh: &Mesh<'_>, ray: &Ray, query: Query) -> Hit {
    let (tree, scale) = (built.tree().view(), built.scene_scale());
    certify::trace::<A>(&tree, mesh, scale, ray, &QueryOptions::default(), query)
}

/// Holds decided rays against the oracle; gives how many there were, and how many were undecided.
fn check(scene: &Scene, each: usize, seed: u64) -> [usize; 2] {
    let mesh = scene.mesh();
    let built = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
    let oracle = Oracle::new(&mesh);
    let mut counts = [0; 2];
    for kind in Kind::ALL {
        let good = aim::rays(&mesh, kind, each, seed);
        let odd = aim::odd(&good, seed + 1);
        for ray in good.into_iter().chain(odd) {
            let expected = match oracle.closest(&ray) {
                OracleHit::Miss => u32::MAX,
                OracleHit::Hit { triangles, .. } => triangles[0],
            };
            for [closest, any] in [
                [Query::Closest, Query::Any].map(|q| trace::<Strict>(&built, &mesh, &ray, q)),
                [Query::Closest, Query::Any].map(|q| trace::<Hostile>(&built, &mesh, &ray, q)),
            ] {
                let undecided = closest.triangle == Hit::UNDECIDED;
                counts[usize::from(undecided)] += 1;
                let right = undecided || closest.triangle == expected;
                assert!(right, "{}, {kind:?}: {ray:?}: {closest:?}, not {expected}", scene.name);
                let told = any.triangle != Hit::UNDECIDED;
                let right = !told || any.is_hit() == (expected != u32::MAX);
                assert!(right, "{}, {kind:?}: {ray:?}: any {any:?}, {expected}", scene.name);
            }
        }
    }
    counts
}

#[test]
fn decided_rays_have_the_oracles_hit() {
    let mut sum = [0; 2];
    for (i, scene) in scenes::awkward().iter().enumerate() {
        let each = if scene.mesh().len() >= 20_000 { 3 } else { 40 };
        let counts = check(scene, each, 50 + i as u64);
        sum = [sum[0] + counts[0], sum[1] + counts[1]];
    }
    assert!(sum[0] > 10_000 && sum[1] > 1_000, "{sum:?}");
}

/// Rays that nobody aimed are decided, on scenes of all kinds: coincident triangles too.
#[test]
fn rays_at_random_are_decided() {
    let twice = scenes::soup(1_000, 0.2, 3);
    let twice = twice.joined(&twice.clone(), "soup, twice");
    for scene in [twice, scenes::grid_boxes(6), scenes::stairs(20), scenes::nested_spheres()] {
        let mesh = scene.mesh();
        let built = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
        let mut hits = 0;
        for kind in [Kind::Random, Kind::Faces] {
            let rays = aim::rays(&mesh, kind, 5_000, 8);
            let found = rays.iter().map(|ray| trace::<Strict>(&built, &mesh, ray, Query::Closest));
            let found: Vec<Hit> = found.collect();
            let undecided = found.iter().filter(|hit| hit.triangle == Hit::UNDECIDED).count();
            // One in a thousand.
            assert!(undecided <= 5, "{}, {kind:?}: {undecided}", scene.name);
            hits += found.iter().filter(|hit| hit.is_hit()).count();
        }
        assert!(hits > 3_000, "{}: {hits}", scene.name);
    }
}

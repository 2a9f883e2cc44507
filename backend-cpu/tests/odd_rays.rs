//! Odd rays take no more steps than normal ones: counted, since times prove nothing in a test.
//! `benches/odd_rays.rs` measures.

use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::BuildConfig;
use splitplane_core::query::traverse::{Cost, Query, trace_observed};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};

/// Steps of one ray, and its answer.
fn cost(scene: &Scene, accelerator: &CpuAccelerator, ray: &Ray, query: Query) -> (Cost, Hit) {
    let mut cost = Cost::default();
    let (tree, mesh) = (accelerator.tree().view(), scene.mesh());
    let scale = accelerator.scene_scale();
    let options = QueryOptions::default();
    let hit = trace_observed::<Strict, _>(&tree, &mesh, scale, ray, &options, query, &mut cost);
    (cost, hit)
}

fn samples() -> Vec<(Scene, CpuAccelerator, Vec<Ray>)> {
    let scenes = [
        scenes::soup(2000, 0.1, 3),
        scenes::sphere(16, [0.0; 3], 2.0),
        scenes::grid_boxes(4),
        scenes::coplanar(1, 300),
        scenes::zeros_and_subnormals(),
    ];
    let build = |scene: Scene| {
        let config = BuildConfig::default().with_stages(|stages| stages.small_node_limit = 16);
        let accelerator = CpuBackend::new()
            .build_accelerator(&scene.mesh(), &BuildOptions::from(config))
            .expect("a tree");
        let rays =
            Kind::ALL.into_iter().flat_map(|kind| aim::rays(&scene.mesh(), kind, 100, 3)).collect();
        (scene, accelerator, rays)
    };
    scenes.into_iter().map(build).collect()
}

/// Rays that can hit nothing by definition visit no node at all.
#[test]
fn invalid_rays_visit_nothing() {
    let mut visited_by_good = 0;
    for (scene, accelerator, rays) in samples() {
        let bad = aim::invalid(&rays, 7);
        for (good, bad) in rays.iter().zip(&bad) {
            for query in [Query::Closest, Query::Any] {
                let found = cost(&scene, &accelerator, bad, query);
                assert_eq!(found, (Cost::default(), Hit::MISS), "{} {bad:?}", scene.name);
                visited_by_good += cost(&scene, &accelerator, good, query).0.nodes;
            }
        }
        // What is fast is held to what is counted.
        for accuracy in [Accuracy::Watertight, Accuracy::Fast] {
            let options = QueryOptions { accuracy, ..QueryOptions::default() };
            let mut hits = vec![Hit { t: 0.0, triangle: 0, u: 0.0, v: 0.0 }; bad.len()];
            accelerator.closest_hits(&bad, &mut hits, &options).expect("equal lengths");
            assert!(hits.iter().all(|hit| *hit == Hit::MISS));
        }
    }
    assert!(visited_by_good > 10_000, "{visited_by_good}: nothing was to be visited anyway");
}

/// One change of a ray that must not make a difference.
type Change = fn(&mut Ray, usize);

/// A part that is -0 or subnormal counts as +0: the same steps, the same answer.
#[test]
fn zeros_of_all_kinds_take_the_same_steps() {
    let zeros: [(&str, f32); 4] =
        [("-0", -0.0), ("least", 1e-45), ("subnormal", -1e-40), ("greatest", 1.175_494_2e-38)];
    let changes: [Change; 3] = [
        |ray, axis| ray.direction[axis] = 0.0,
        |ray, axis| ray.origin[axis] = 0.0,
        |ray, _| ray.t_min = 0.0,
    ];
    let odd = |ray: &mut Ray, which: usize, axis: usize, zero: f32| match which {
        0 => ray.direction[axis] = zero,
        1 => ray.origin[axis] = zero,
        _ => ray.t_min = zero,
    };
    let mut nodes = 0;
    for (scene, accelerator, rays) in samples() {
        for (i, ray) in rays.iter().enumerate() {
            for (which, change) in changes.iter().enumerate() {
                let mut plain = *ray;
                change(&mut plain, i % 3);
                for query in [Query::Closest, Query::Any] {
                    let expected = cost(&scene, &accelerator, &plain, query);
                    nodes += expected.0.nodes;
                    for (name, zero) in zeros {
                        let mut other = plain;
                        odd(&mut other, which, i % 3, zero);
                        let found = cost(&scene, &accelerator, &other, query);
                        // A hit at t = 0 may lie before a limit that is a little more.
                        if which < 2 || expected.1.t != 0.0 {
                            assert_eq!(found, expected, "{} {name} {other:?}", scene.name);
                        }
                    }
                }
            }
        }
    }
    assert!(nodes > 50_000, "{nodes}");
}

/// Directions of any length take the same steps, down to the least normal number: the power of two
/// is taken out first.
#[test]
fn short_and_long_directions_take_the_same_steps() {
    let mut compared = 0;
    for (scene, accelerator, rays) in samples() {
        for ray in &rays {
            let largest = ray.direction.iter().fold(0.0f32, |m, d| m.max(d.abs()));
            let smallest =
                ray.direction.iter().filter(|d| **d != 0.0).fold(f32::MAX, |m, d| m.min(d.abs()));
            let expected = cost(&scene, &accelerator, ray, Query::Closest);
            for power in [-120, -60, 60, 120] {
                let factor = (power as f32).exp2();
                // Where every part stays normal.
                if !(largest * factor).is_finite() || smallest * factor < f32::MIN_POSITIVE {
                    continue;
                }
                let mut other = *ray;
                other.direction = ray.direction.map(|d| d * factor);
                let found = cost(&scene, &accelerator, &other, Query::Closest);
                // Distances below the least normal number are 0: then it may be another hit, and others
                // at 0 are looked for.
                if found.1.triangle == expected.1.triangle && found.1.t != 0.0 {
                    assert_eq!(found.0, expected.0, "{} {other:?}", scene.name);
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 2000, "{compared}");
}

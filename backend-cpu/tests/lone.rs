//! Scenes of one instance, whose rays the mesh's own batch answers: they have the hits that the instance gives ray by ray, and those of the mesh.

use core::ops::ControlFlow;

use crate::common::{built_by, scene_bits};
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Culling, Hit, QueryOptions, Ray};
use splitplane_core::scene::{
    GeometryId, IDENTITY, IgnoredTriangle, Instance, InstanceId, Scene, SceneHit, SceneOptions,
    TopRay,
};
use splitplane_core::watch::{Progress, Watch};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::objects::{self, Kind};

/// Rays at the instance, bundles of neighbours among them, and some that hit nothing whatever there is.
fn rays(scene: &Scene, seed: u64) -> Vec<Ray> {
    let mut rays = objects::rays(scene, 320, seed);
    for chunk in rays.chunks_exact_mut(32).step_by(2) {
        let first = chunk[0];
        for (number, ray) in chunk.iter_mut().enumerate() {
            *ray = first;
            ray.direction[number % 3] *= 1.0 + number as f32 / 4096.0;
        }
    }
    let some = rays[40];
    rays[70] = Ray::new([f32::NAN; 3], [1.0; 3]);
    rays[71] = Ray::new(some.origin, [0.0; 3]);
    rays[72] = some.with_limits(2.0, 1.0);
    rays[73] = Ray::new(some.origin, [1.0, f32::INFINITY, 0.0]);
    rays[74] = Ray::new(some.origin, [1e-42, 1e30, -1e30]);
    // Zeros of both signs, towards the middle and elsewhere.
    for (number, ray) in rays[80..128].iter_mut().enumerate() {
        let axis = number % 3;
        let zero = if number % 2 == 0 { 0.0 } else { -0.0 };
        let mut direction = [zero; 3];
        direction[axis] = if ray.origin[axis] < 0.0 { 1.0 } else { -1.0 };
        if number % 4 < 2 {
            ray.origin[(axis + 1) % 3] = -zero;
            ray.origin[(axis + 2) % 3] = zero;
        }
        ray.direction = direction;
    }
    rays[75] = some.with_limits(f32::NAN, 1.0);
    rays
}

/// Batches against the instance's answers to one ray after the other, on every instruction set.
#[test]
fn batches_find_what_the_instance_gives_ray_by_ray() {
    let (mut found, mut lone, mut gaps, mut ignored) = (0, 0, 0, 0);
    for kind in Kind::ALL {
        for seed in 0..12 {
            let (mut scene, _) = objects::scene(kind, 1, 100 + seed);
            if seed % 3 == 0 {
                // Rays of an instance in place go to the mesh as they are.
                scene.move_instance(InstanceId(0), IDENTITY).expect("a place");
            }
            if seed % 2 == 1 {
                // Free names before and behind.
                let own = *scene.instance(InstanceId(0)).expect("an instance");
                let [_, last] = [(); 2].map(|()| scene.add_instance(own).expect("an instance"));
                for name in [InstanceId(0), last] {
                    scene.remove_instance(name).expect("an instance");
                }
            }
            let only = scene.instances().next().expect("an instance").0;
            let rays = rays(&scene, seed);
            let some = rays.iter().filter(|ray| TopRay::new(ray).is_some()).count() as u64;
            assert!(some + 5 <= rays.len() as u64);
            let of_any_set = built_by(InstructionSet::detect(), &scene);
            let first = rays.iter().find_map(|ray| {
                of_any_set.closest_hit(ray, &SceneOptions::default()).map(|hit| hit.triangle)
            });
            for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
                for culling in [Culling::None, Culling::Back, Culling::Front] {
                    let own =
                        IgnoredTriangle { instance: only, triangle: first.unwrap_or_default() };
                    let ignore = (culling == Culling::None && seed % 2 == 0).then_some(own);
                    let asked = SceneOptions { accuracy, culling, ignore, ..Default::default() };
                    let expected: Vec<SceneHit> = rays
                        .iter()
                        .map(|ray| of_any_set.scene().answer_by_all(ray, &asked))
                        .collect();
                    for set in InstructionSet::available() {
                        let accelerator = built_by(set, &scene);
                        let mut hits = vec![SceneHit::MISS; rays.len()];
                        let report = accelerator.closest_hits(&rays, &mut hits, &asked);
                        let report = report.expect("hits");
                        assert_eq!(
                            scene_bits(&hits),
                            scene_bits(&expected),
                            "{kind:?} {seed} {asked:?}"
                        );
                        let mut any = vec![true; rays.len()];
                        accelerator.any_hits(&rays, &mut any, &asked).expect("hits");
                        for (any, hit) in any.iter().zip(&expected) {
                            assert_eq!(*any, hit.is_hit(), "{kind:?} {seed} {asked:?}");
                        }
                        assert!(report.entered == 0 || report.entered == some, "{report:?}");
                        lone += report.batches;
                        gaps += u64::from(only != InstanceId(0)) * report.batches;
                    }
                    found += expected.iter().filter(|hit| hit.is_hit()).count();
                    ignored += usize::from(ignore.is_some());
                }
            }
        }
    }
    assert!(found > 10_000 && ignored > 20, "{found} {ignored}");
    assert!(gaps > 100 && lone > gaps + 100, "{lone} {gaps}");
}

/// An instance in place has its mesh's hits, bit for bit; moved, it has others, so the comparison would show a transform that is left out.
#[test]
fn an_instance_in_place_has_its_meshs_hits() {
    let ball = splitplane_test_support::scenes::sphere(16, [0.0; 3], 1.0);
    let backend = CpuBackend::new();
    let mesh = backend.build(&ball.mesh(), &BuildOptions::default()).expect("a tree");
    let mut differ = [0; 2];
    for (moved, differ) in [0.0, 0.25].into_iter().zip(&mut differ) {
        let mut scene = Scene::new();
        scene.add_mesh(&ball.mesh()).expect("a geometry");
        let mut instance = Instance::in_place(GeometryId(0));
        instance.transform[0][3] = moved;
        scene.add_instance(instance).expect("an instance");
        let rays = rays(&scene, 7);
        let accelerator = built_by(InstructionSet::detect(), &scene);
        let mut hits = vec![SceneHit::MISS; rays.len()];
        accelerator.closest_hits(&rays, &mut hits, &SceneOptions::default()).expect("hits");
        let mut expected = vec![Hit::MISS; rays.len()];
        mesh.closest_hits(&rays, &mut expected, &QueryOptions::default()).expect("hits");
        assert!(expected.iter().filter(|hit| hit.is_hit()).count() > 100);
        *differ = hits
            .iter()
            .zip(&expected)
            .filter(|(hit, expected)| {
                let own = [hit.t, hit.u, hit.v].map(f32::to_bits);
                let mesh = [expected.t, expected.u, expected.v].map(f32::to_bits);
                hit.is_hit() != expected.is_hit()
                    || hit.is_hit() && (own, hit.triangle) != (mesh, expected.triangle)
            })
            .count();
    }
    assert!(differ[0] == 0 && differ[1] > 100, "{differ:?}");
}

/// Ends at once.
struct Ends;

impl Watch for Ends {
    fn progress(&self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Break(())
    }
}

/// A watch ends a batch; an instance that does not answer costs nothing; where a filter is asked, or there are two instances, the way is another.
#[test]
fn what_else_a_batch_may_be_asked() {
    let (mut scene, _) = objects::scene(Kind::Ordinary, 1, 5);
    let rays = rays(&scene, 6).repeat(20);
    let accelerator = built_by(InstructionSet::detect(), &scene);
    let mut hits = vec![SceneHit::MISS; rays.len()];
    let ends = SceneOptions { watch: Some(&Ends), ..SceneOptions::default() };
    let ended = accelerator.closest_hits(&rays, &mut hits, &ends);
    assert!(matches!(ended, Err(QueryError::Cancelled { .. })), "{ended:?}");
    let none = SceneOptions { mask: 0, ..SceneOptions::default() };
    let report = accelerator.closest_hits(&rays, &mut hits, &none).expect("hits");
    assert_eq!((report.entered, report.batches), (0, 0));
    assert!(hits.iter().all(|hit| !hit.is_hit()));
    let short = accelerator.closest_hits(&rays, &mut hits[1..], &SceneOptions::default());
    assert!(matches!(short, Err(QueryError::LengthMismatch { .. })), "{short:?}");

    let batches = |scene: &Scene, options: &SceneOptions<'_>| {
        let mut hits = vec![SceneHit::MISS; rays.len()];
        let accelerator = built_by(InstructionSet::detect(), scene);
        accelerator.closest_hits(&rays, &mut hits, options).expect("hits").batches
    };
    let usual = SceneOptions::default();
    assert!(batches(&scene, &usual) > 0);
    assert_eq!(batches(&scene, &SceneOptions { accuracy: Accuracy::Fast, ..usual }), 0);
    let own = *scene.instance(InstanceId(0)).expect("an instance");
    scene.add_instance(own).expect("an instance");
    assert_eq!(batches(&scene, &usual), 0);
    // One that nothing can hit is none.
    scene.remove_instance(InstanceId(0)).expect("an instance");
    let empty = scene.add_mesh(&Mesh::soup(&[]).expect("a mesh")).expect("a geometry");
    scene.add_instance(Instance::in_place(empty)).expect("an instance");
    assert!(batches(&scene, &usual) > 0);
}

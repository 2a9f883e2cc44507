//! Closest points of scenes, against all triangles of all instances.

use core::ops::ControlFlow;

use crate::common::long;
use splitplane_core::backend::scene::{
    BuiltScene, HostScene, SceneAccelerator, SceneClosestPoint, SceneClosestPointOptions,
};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::ray::Culling;
use splitplane_core::scene::{IgnoredTriangle, Instance, InstanceId, Scene, translation};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::near::scene_closest_point;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

fn found(
    scene: &dyn SceneAccelerator,
    points: &[[f32; 3]],
    options: &SceneClosestPointOptions<'_>,
) -> Vec<SceneClosestPoint> {
    let mut closest = vec![SceneClosestPoint::NONE; points.len()];
    scene.closest_points(points, &mut closest, options).expect("closest points");
    closest
}

/// Points on and near triangles, between objects, far away, and odd ones.
fn points(scene: &Scene, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Random::new(seed);
    let baked = objects::baked(scene);
    let mut all = vec![[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [0.0; 3], [f32::MAX, -1.0, 1e30]];
    while all.len() < count {
        let corners = random.pick(&baked);
        let weights = random.barycentric();
        let on = [0, 1, 2].map(|axis| {
            (0..3).map(|corner| weights[corner] * f64::from(corners[corner][axis])).sum::<f64>()
        });
        let size = corners.iter().flatten().fold(0.0f64, |m, &x| m.max(f64::from(x).abs()));
        let away = 10f64.powf(random.between(-9.0, 2.0)) * size;
        let by = random.direction();
        all.push(match random.below(5) {
            0 => random.pick(&corners),
            1 => on.map(|x| x as f32),
            2 => random.point(8.0),
            _ => [0, 1, 2].map(|axis| (on[axis] + away * by[axis]) as f32),
        });
    }
    all
}

/// Every kind of scene and preset, limits, masks, an ignored triangle: the same as all triangles, bit for bit; and so for
/// moved instances and refitted trees.
#[test]
fn closest_points_are_those_of_all_triangles() {
    let backend = CpuBackend::new();
    let count = if long() { 20_000 } else { 150 };
    for (seed, kind) in (0..).zip(Kind::ALL) {
        let (mut scene, names) = objects::scene(kind, 40, 60 + seed);
        let options = BuildOptions::from(Preset::ALL[seed as usize % Preset::ALL.len()]);
        let mut built = backend.build_scene(&scene, &options).unwrap();
        for round in 0..3 {
            let points = points(&scene, count, 9 * seed + round);
            let reach = found(&*built, &points, &SceneClosestPointOptions::default());
            let some = reach.iter().find(|closest| closest.is_some()).expect("one is near");
            let ignore =
                IgnoredTriangle { instance: InstanceId(some.instance), triangle: some.triangle };
            for asked in [
                SceneClosestPointOptions::default(),
                SceneClosestPointOptions { max_distance: 0.5, ..Default::default() },
                SceneClosestPointOptions { max_distance: some.distance(), ..Default::default() },
                SceneClosestPointOptions { max_distance: 0.0, ..Default::default() },
                SceneClosestPointOptions { max_distance: f32::NAN, ..Default::default() },
                SceneClosestPointOptions { mask: 0x0f0f, ..Default::default() },
                SceneClosestPointOptions { ignore: Some(ignore), ..Default::default() },
            ] {
                let closest = found(&*built, &points, &asked);
                for (&point, closest) in points.iter().zip(closest) {
                    let expected = scene_closest_point(&scene, point, &asked);
                    assert!(closest == expected, "{kind:?} {point:?}: {closest:?}, {expected:?}");
                }
            }
            let mut random = Random::new(round);
            for &name in names.iter().step_by(3) {
                let moved = objects::transform(kind, &mut random);
                let _ = scene.move_instance(name, moved);
            }
            backend.update_scene(&mut *built, &scene, &options).unwrap();
        }
    }
}

/// An instance in place answers as its mesh does, bit for bit, whatever its culling; and so does one moved by whole numbers.
#[test]
fn an_instance_in_place_answers_as_its_mesh() {
    let backend = CpuBackend::new();
    for mesh in objects::meshes(4) {
        let mut scene = Scene::new();
        let geometry = scene.add_mesh(&mesh.mesh()).unwrap();
        let culling = Culling::Back;
        scene.add_instance(Instance { culling, ..Instance::in_place(geometry) }).unwrap();
        let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
        let tree = backend.build(&mesh.mesh(), &BuildOptions::default()).unwrap();
        let mut random = Random::new(6);
        let points: Vec<[f32; 3]> = (0..500).map(|_| random.point(3.0)).collect();
        let mut of_mesh = vec![ClosestPoint::NONE; points.len()];
        tree.closest_points(&points, &mut of_mesh, &ClosestPointOptions::default()).unwrap();
        let of_scene = found(&*built, &points, &SceneClosestPointOptions::default());
        for (one, other) in of_mesh.iter().zip(&of_scene) {
            let same = (one.distance_squared, one.point, one.triangle, one.u, one.v)
                == (other.distance_squared, other.point, other.triangle, other.u, other.v);
            assert!(same, "{one:?} {other:?}");
        }
    }
}

/// Equal distances: the least (instance, triangle), whatever the order in which boxes are visited.
#[test]
fn ties_go_to_the_least_instance() {
    let backend = CpuBackend::new();
    let mut scene = Scene::new();
    let one = scene.add_mesh(&scenes::one().mesh()).unwrap();
    let same = scene.add_mesh(&scenes::one().mesh()).unwrap();
    for place in [3.0, -3.0, 3.0, -3.0] {
        let geometry = if place > 0.0 { one } else { same };
        let mut transform = translation([place, 0.0, 0.0]);
        transform[0][0] = if place > 0.0 { 1.0 } else { -1.0 };
        scene.add_instance(Instance::new(geometry, transform)).unwrap();
    }
    let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let point = [0.0, 0.25, 0.0];
    let [closest] = found(&*built, &[point], &SceneClosestPointOptions::default())[..] else {
        panic!("one answer")
    };
    assert_eq!(closest, scene_closest_point(&scene, point, &SceneClosestPointOptions::default()));
    assert_eq!((closest.instance, closest.geometry), (0, one.0));
    assert_eq!(SceneClosestPoint::NONE.some(), None);
    assert_eq!(SceneClosestPoint::NONE.distance(), f32::INFINITY);
}

/// The reference on one thread, a batch of the wrong size, an empty scene, and a watch that ends it.
#[test]
fn batches_are_checked_and_can_be_cancelled() {
    let backend = CpuBackend::new();
    let (scene, _) = objects::scene(Kind::Ordinary, 30, 8);
    let built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| backend.build(mesh, options);
    let host = HostScene::build(&scene, &BuildOptions::default(), &mut build).unwrap();
    let points = points(&scene, 1000, 5);
    let options = SceneClosestPointOptions::default();
    assert!(found(&*built, &points, &options) == found(&host, &points, &options));
    let scenes: [&dyn SceneAccelerator; 2] = [&*built, &host];
    for scene in scenes {
        let mut closest = vec![SceneClosestPoint::NONE; 1000];
        let wrong = scene.closest_points(&points, &mut closest[1..], &options);
        assert_eq!(wrong, Err(QueryError::LengthMismatch { rays: 1000, results: 999 }));
        let watch = |_: &Progress| ControlFlow::Break(());
        let watched = SceneClosestPointOptions { watch: Some(&watch), ..options };
        let ended = scene.closest_points(&points, &mut closest, &watched);
        let Err(QueryError::Cancelled { total: 1000, .. }) = ended else { panic!("{ended:?}") };
    }
    let empty = backend.build_scene(&Scene::new(), &BuildOptions::default()).unwrap();
    assert!(found(&*empty, &points, &options).iter().all(|closest| !closest.is_some()));
    let empty: &BuiltScene = empty.scene();
    assert_eq!(empty.closest_point([0.0; 3], &options), Ok(SceneClosestPoint::NONE));
}

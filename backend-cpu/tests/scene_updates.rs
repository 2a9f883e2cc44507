//! Scenes brought up to date: only what changed is made anew, and a failure leaves what was there.

use core::ops::ControlFlow;
use core::sync::atomic::AtomicUsize;
use core::sync::atomic::Ordering::Relaxed;

use splitplane_core::backend::scene::{HostScene, SceneAccelerator, TopUpdate};
use splitplane_core::backend::{Backend, BuildOptions, QueryLayout};
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    Instance, Scene, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::built::{CountingBackend, traced};
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

#[test]
fn moving_one_of_many_looks_at_that_one_only() {
    let backend = CpuBackend::new();
    let mut scene = Scene::new();
    let ball = scenes::sphere(6, [0.0; 3], 0.4);
    let geometry = scene.add_mesh(&ball.mesh()).unwrap();
    let place = |i: usize| translation([(i % 100) as f32, (i / 100) as f32, 0.0]);
    let names: Vec<_> = (0..10_000)
        .map(|i| scene.add_instance(Instance::new(geometry, place(i))).unwrap())
        .collect();
    let mut built = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let nothing = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!((nothing.geometries_built, nothing.instances_compared), (0, 0));
    // A zero of another sign is another description, which the digest names.
    scene.move_instance(names[0], translation([-0.0, 0.0, 0.0])).unwrap();
    backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    let fresh = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    assert_eq!(nothing.top, TopUpdate::Kept);

    scene.move_instance(names[5050], translation([50.25, 50.0, 3.0])).unwrap();
    let report = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!((report.geometries_built, report.instances_compared), (0, 1));
    assert_eq!((report.instances_changed, report.top), (1, TopUpdate::Refitted));
    assert!(report.top_nodes_changed <= 8, "{}", report.top_nodes_changed);
    let fresh = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    let down = Ray::new([50.25, 50.0, 9.0], [0.0, 0.0, -1.0]);
    let hit = built.closest_hit(&down, &SceneOptions::default()).expect("it is there");
    assert_eq!(hit.instance, names[5050].0);

    // A mask: no box changes.
    scene.set_mask(names[7], 0).unwrap();
    let report = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!((report.instances_changed, report.top), (1, TopUpdate::Kept));
    assert!(
        built
            .closest_hit(&Ray::new([7.0, 0.0, 9.0], [0.0, 0.0, -1.0]), &SceneOptions::default())
            .is_none()
    );

    // One goes: the tree over the instances is built anew.
    scene.remove_instance(names[9]).unwrap();
    let report = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!((report.instances_compared, report.top), (1, TopUpdate::Rebuilt));

    // New vertices within the same bounds: the geometry, and nothing else.
    let mut turned = ball.triangles();
    turned.rotate_left(7);
    scene.replace_mesh(geometry, &Mesh::soup(&turned).unwrap()).unwrap();
    let report = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!((report.geometries_built, report.instances_changed), (1, 0));

    // Everything moves far apart: the refitted tree is worn, and built anew.
    for (i, &name) in names.iter().enumerate().filter(|&(i, _)| i != 9) {
        scene.move_instance(name, translation([((i * 7919) % 10_000) as f32, 0.0, 0.0])).unwrap();
    }
    let report = backend.update_scene(&mut built, &scene, &BuildOptions::default()).unwrap();
    assert_eq!(report.top, TopUpdate::Rebuilt);
    let fresh = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
    let rays = objects::rays(&scene, 2000, 3);
    assert_eq!(traced(&*built, &rays), traced(&*fresh, &rays));
}

/// Boxes of all levels follow, up to the root: instances leave the box of everything, one at a time, and rays that meet nothing else find them.
#[test]
fn what_moves_out_of_all_boxes_is_found() {
    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&scenes::sphere(6, [0.0; 3], 0.4).mesh()).unwrap();
    let place = |i: usize| translation([(i % 100) as f32, (i / 100) as f32, 0.0]);
    let names: Vec<_> = (0..10_000)
        .map(|i| scene.add_instance(Instance::new(geometry, place(i))).unwrap())
        .collect();
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let mut most = 0;
    for (number, own) in [5050, 0, 99, 9_900, 9_999, 2_525, 7_031].into_iter().enumerate() {
        for to in [[-5.0, 50.0, 0.0], [105.0, 50.0, 0.0], [50.0, 50.0, 5.0], [50.0, 50.0, -5.0]] {
            scene.move_instance(names[own], translation(to)).unwrap();
            let report = backend.update_scene(&mut built, &scene, &options).unwrap();
            assert_eq!((report.instances_changed, report.top), (1, TopUpdate::Refitted));
            most = most.max(report.top_nodes_changed);
            let (start, towards) = match to[2] == 0.0 {
                true => ([to[0], 50.0, 9.0], [0.0, 0.0, -1.0]),
                false => ([-9.0, 50.0, to[2]], [1.0, 0.0, 0.0]),
            };
            let ray = Ray::new(start, towards);
            let hit = built.closest_hit(&ray, &SceneOptions::default()).expect("it is there");
            assert_eq!(hit.instance, names[own].0, "{to:?}");
        }
        scene.move_instance(names[own], place(own)).unwrap();
        backend.update_scene(&mut built, &scene, &options).unwrap();
        let rays = objects::rays(&scene, 300, number as u64);
        let fresh = backend.build_scene(&scene, &options).unwrap();
        assert_eq!(traced(&*built, &rays), traced(&*fresh, &rays));
    }
    // Of a tree that has some levels.
    assert!(most >= 4, "{most}");
}

/// A scene after some edits: two new meshes, an instance that came, one that went, one that moved.
fn edited(scene: &mut Scene, names: &[splitplane_core::scene::InstanceId]) {
    let geometries: Vec<_> = scene.geometries().map(|(name, _)| name).collect();
    scene.replace_mesh(geometries[0], &scenes::grid_boxes(1).mesh()).unwrap();
    scene.replace_mesh(geometries[2], &scenes::soup(50, 0.5, 9).mesh()).unwrap();
    scene.remove_instance(names[3]).unwrap();
    scene.move_instance(names[4], translation([1.0, 2.0, 3.0])).unwrap();
    scene.add_instance(Instance::new(geometries[1], translation([0.5, 0.0, 0.0]))).unwrap();
}

/// Failing builds, cancellation at every call of the watch, limits: the old scene answers as before, and a later update
/// succeeds.
#[test]
fn a_failed_update_leaves_the_old_scene() {
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 5);
    let rays = objects::rays(&scene, 300, 6);
    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let (before, digest) = (traced(&*built, &rays), built.scene().digest());
    edited(&mut scene, &names);
    let mut failed = 0;
    for at in 0..2 {
        let fails = CountingBackend::new(CpuBackend::new());
        fails.fail_at(at);
        let error = fails.update_scene(&mut built, &scene, &options).unwrap_err();
        let SceneBuildError::Geometry { geometry, error: BuildError::Device(_) } = error else {
            panic!("{error}");
        };
        assert_eq!(geometry, [0, 2][at]);
        assert_eq!(built.scene().digest(), digest);
        failed += 1;
    }
    for at in 0.. {
        let calls = AtomicUsize::new(0);
        let watch = |_: &Progress| match calls.fetch_add(1, Relaxed) == at {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let watched = BuildOptions { watch: Some(&watch), ..options };
        let (fresh, _) = objects::scene(Kind::Ordinary, 40, 5);
        let mut fresh = backend.build_scene(&fresh, &options).unwrap();
        match backend.update_scene(&mut fresh, &scene, &watched) {
            Ok(_) => break,
            Err(error) => {
                let text = error.to_string();
                assert!(text.contains("cancelled"), "{text}");
                assert_eq!(fresh.scene().digest(), digest);
                failed += 1;
            }
        }
    }
    let (least, needed) = (built.scene().bytes(), built.scene().bytes() + (1 << 22));
    for step in 0..12 {
        let max_memory = Some(least + (needed - least) * step / 11);
        let limited = BuildOptions { max_memory, ..options };
        let (fresh, _) = objects::scene(Kind::Ordinary, 40, 5);
        let mut fresh = backend.build_scene(&fresh, &options).unwrap();
        if let Err(error) = backend.update_scene(&mut fresh, &scene, &limited) {
            assert!(error.to_string().contains("limit"), "{error}");
            assert_eq!(fresh.scene().digest(), digest);
            failed += 1;
        }
    }
    assert!(failed > 8, "{failed}");
    assert_eq!(traced(&*built, &rays), before);
    backend.update_scene(&mut built, &scene, &options).unwrap();
    let fresh = backend.build_scene(&scene, &options).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    assert_ne!(built.scene().digest(), digest);
    assert_eq!(traced(&*built, &rays), traced(&*fresh, &rays));
}

/// The default of backends of others, and cancelled batches.
#[test]
fn hosts_find_the_same_and_batches_can_be_cancelled() {
    let (scene, _) = objects::scene(Kind::Ordinary, 40, 15);
    let rays = objects::rays(&scene, 3000, 16);
    let backend = CpuBackend::new();
    let options = BuildOptions::default();
    let own = backend.build_scene(&scene, &options).unwrap();
    let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| backend.build(mesh, options);
    let host = HostScene::build(&scene, &options, &mut build).unwrap();
    assert_eq!(traced(&*own, &rays), traced(&host, &rays));
    let mut hits = vec![SceneHit::MISS; rays.len()];
    let report = host.closest_hits(&rays, &mut hits, &SceneOptions::default()).unwrap();
    assert_eq!(report.placed_by_cpu, 3000);
    let both: [&dyn SceneAccelerator; 2] = [&*own, &host];
    for scene in both {
        let wrong = scene.closest_hits(&rays, &mut hits[1..], &SceneOptions::default());
        assert_eq!(wrong, Err(QueryError::LengthMismatch { rays: 3000, results: 2999 }));
        let mut cancelled = 0;
        for at in [0, 1, 2, 5] {
            let calls = AtomicUsize::new(0);
            let watch = |_: &Progress| match calls.fetch_add(1, Relaxed) == at {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            };
            let watched = SceneOptions { watch: Some(&watch), ..SceneOptions::default() };
            let ended = scene.closest_hits(&rays, &mut hits, &watched);
            let Err(QueryError::Cancelled { total: 3000, .. }) = ended else { panic!("{ended:?}") };
            cancelled += 1;
        }
        assert_eq!(cancelled, 4);
    }
}

/// Geometries of several layouts and instruction sets in one scene, which no fast path takes together: the same answers.
#[test]
fn geometries_of_several_kinds_answer_alike() {
    let (mut scene, _) = objects::scene(Kind::Ordinary, 40, 25);
    let rays = objects::rays(&scene, 2000, 26);
    let options = BuildOptions::default();
    let compact = BuildOptions { layout: QueryLayout::Compact, ..options };
    let first = scene.geometries().next().expect("one").0;
    let same = scene.geometry(first).expect("one").mesh();
    let corners: Vec<_> = (0..same.len()).map(|triangle| same.triangle(triangle)).collect();
    for set in InstructionSet::available() {
        let backend = CpuBackend::with_instruction_set(set);
        let expected = backend.build_scene(&scene, &options).unwrap();
        for (other, options) in [
            (CpuBackend::with_instruction_set(set), &compact),
            (CpuBackend::with_instruction_set(InstructionSet::Portable), &options),
            (CpuBackend::new(), &compact),
        ] {
            let mut mixed = backend.build_scene(&scene, &BuildOptions::default()).unwrap();
            // The same triangles in new arrays, built by the other.
            scene.replace_mesh(first, &Mesh::soup(&corners).unwrap()).unwrap();
            let report = other.update_scene(&mut mixed, &scene, options).unwrap();
            assert_eq!(report.geometries_built, 1);
            assert!(traced(&*mixed, &rays) == traced(&*expected, &rays), "{set:?}");
            let settings = SceneOptions::default();
            let mut any = vec![false; rays.len()];
            mixed.any_hits(&rays, &mut any, &settings).unwrap();
            for (ray, any) in rays.iter().zip(any) {
                let hit = expected.closest_hit(ray, &settings);
                assert_eq!(mixed.closest_hit(ray, &settings), hit);
                assert_eq!((mixed.any_hit(ray, &settings), any), (hit.is_some(), hit.is_some()));
            }
        }
    }
}

/// A geometry becomes another shape within the same bounds: the boxes of its turned instances follow.
#[test]
fn boxes_follow_the_shape_within_the_same_bounds() {
    let backend = CpuBackend::new();
    // Small triangles in corners of one and the same box, so many that the tree cuts what is between them off.
    let corner = |at: [f32; 3]| -> Vec<[[f32; 3]; 3]> {
        let to = |axis: usize, by: f32| at[axis] - at[axis] * by;
        (1..40u8)
            .map(|place| f32::from(place) / 160.0)
            .map(|by| [at, [to(0, by), at[1], at[2]], [at[0], to(1, by), to(2, by)]])
            .collect()
    };
    let ends = |corners: [[f32; 3]; 2]| corners.map(corner).concat();
    let [one, other] =
        [ends([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]), ends([[-1.0, 1.0, -1.0], [1.0, -1.0, 1.0]])];
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&Mesh::soup(&one).unwrap()).unwrap();
    let mut random = Random::new(9);
    for _ in 0..30 {
        let turned = objects::transform(Kind::Ordinary, &mut random);
        scene.add_instance(Instance::new(geometry, turned)).unwrap();
    }
    let options = BuildOptions::default();
    let mut built = backend.build_scene(&scene, &options).unwrap();
    scene.replace_mesh(geometry, &Mesh::soup(&other).unwrap()).unwrap();
    let report = backend.update_scene(&mut built, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, report.instances_changed), (1, 30));
    let fresh = backend.build_scene(&scene, &options).unwrap();
    let rays = objects::rays(&scene, 3000, 8);
    let hits = traced(&*built, &rays);
    assert!(hits.iter().filter(|hit| hit.is_hit()).count() > 500);
    assert!(hits == traced(&*fresh, &rays));
    for (ray, hit) in rays.iter().zip(&hits) {
        let all: SceneHit = built.scene().answer_by_all(ray, &SceneOptions::default());
        assert_eq!(*hit, all);
    }
}

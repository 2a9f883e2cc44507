//! Updates whose trees are built while the old scene answers.

use core::ops::ControlFlow;

use splitplane_core::backend::scene::{FinishError, HostScene, PendingUpdate, SceneAccelerator};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{
    GeometryId, Instance, InstanceId, OpacityMask, Scene, SceneBuildError, translation,
};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::built::{CountingBackend, traced_bits};
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::scenes;

fn counting(fails_at: usize) -> CountingBackend<CpuBackend> {
    let own = CountingBackend::new(CpuBackend::new());
    own.fail_at(fails_at);
    own
}

fn build(scene: &Scene) -> Box<dyn SceneAccelerator> {
    CpuBackend::new().build_scene(scene, &BuildOptions::default()).expect("a scene")
}

/// Two new meshes, an instance that came, one that went, one that moved.
fn edit(scene: &mut Scene, names: &[InstanceId], seed: u64) {
    let geometries: Vec<_> = scene.geometries().map(|(name, _)| name).collect();
    scene.replace_mesh(geometries[0], &scenes::grid_boxes(1).mesh()).unwrap();
    scene.replace_mesh(geometries[2], &scenes::soup(500, 0.5, seed).mesh()).unwrap();
    scene.remove_instance(names[3]).unwrap();
    scene.move_instance(names[4], translation([1.0, 2.0, 3.0])).unwrap();
    scene.add_instance(Instance::new(geometries[1], translation([0.5, 0.0, 0.0]))).unwrap();
}

#[test]
fn the_old_scene_answers_until_the_new_one_is_in_place() {
    let options = BuildOptions::default();
    for by_host in [false, true] {
        let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 5);
        let rays = objects::rays(&scene, 2000, 6);
        let backend = counting(usize::MAX);
        let mut built = build(&scene);
        if by_host {
            let cpu = CpuBackend::new();
            let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| cpu.build(mesh, options);
            built = Box::new(HostScene::build(&scene, &options, &mut build).unwrap());
        }
        let (old, digest) = (traced_bits(&*built, &rays), built.scene().digest());
        edit(&mut scene, &names, 9);
        let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
        assert_eq!((pending.left(), pending.bytes()), (2, 0));
        let early = pending.finish(&backend, &mut built, &scene, &options).unwrap_err();
        assert_eq!(early, FinishError::NotBuilt { geometry: 0 });
        // Another thread builds, and this one asks.
        std::thread::scope(|scope| {
            let building = scope.spawn(|| pending.build(&backend, &options));
            while !building.is_finished() {
                assert_eq!(traced_bits(&*built, &rays), old);
            }
            building.join().unwrap().unwrap();
        });
        assert_eq!(traced_bits(&*built, &rays), old);
        assert_eq!((built.scene().digest(), pending.left()), (digest, 0));
        assert!(pending.bytes() > 0);
        // Instances may be edited meanwhile.
        scene.move_instance(names[6], translation([-1.0, 0.5, 0.25])).unwrap();
        let report = pending.finish(&backend, &mut built, &scene, &options).unwrap();
        assert_eq!((report.geometries_built, backend.builds()), (2, 2));
        let fresh = build(&scene);
        assert_eq!(built.scene().digest(), fresh.scene().digest());
        assert_ne!(built.scene().digest(), digest);
        let new = traced_bits(&*built, &rays);
        assert_eq!(new, traced_bits(&*fresh, &rays));
        assert_ne!(new, old);
        // What a scene knows of the triangles came with the trees.
        for ((_, one), (_, other)) in built.scene().geometries().zip(fresh.scene().geometries()) {
            assert_eq!((one.bounds(), one.outline()), (other.bounds(), other.outline()));
            assert_eq!(one.bytes(), other.bytes());
        }
        // Updates as ever go on from there.
        scene
            .replace_mesh(
                scene.instance(names[0]).unwrap().geometry,
                &scenes::soup(90, 0.5, 1).mesh(),
            )
            .unwrap();
        CpuBackend::new().update_scene(&mut *built, &scene, &options).unwrap();
        assert_eq!(traced_bits(&*built, &rays), traced_bits(&*build(&scene), &rays));
    }
}

#[test]
fn failures_leave_the_old_scene_and_what_was_built() {
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 5);
    let rays = objects::rays(&scene, 500, 6);
    let (mut built, options) = (build(&scene), BuildOptions::default());
    let (old, digest) = (traced_bits(&*built, &rays), built.scene().digest());
    edit(&mut scene, &names, 9);
    // Dropped.
    let backend = counting(1);
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
    assert!(pending.build_next(&backend, &options).unwrap());
    drop(pending);
    assert_eq!((traced_bits(&*built, &rays), built.scene().digest()), (old.clone(), digest));
    // The second build fails; the first is not made again.
    let backend = counting(1);
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
    let error = pending.build(&backend, &options).unwrap_err();
    assert!(matches!(error, SceneBuildError::Geometry { geometry: 2, .. }), "{error}");
    assert_eq!(pending.left(), 1);
    // Cancelled.
    let watch = |_: &Progress| ControlFlow::Break(());
    let watched = BuildOptions { watch: Some(&watch), ..options };
    let error = pending.build(&backend, &watched).unwrap_err();
    let SceneBuildError::Cancelled { progress } = error else { panic!("{error}") };
    assert_eq!((progress.done, progress.total), (1, 2));
    // A limit that the scene and the first tree reach.
    let limit = built.scene().bytes() + pending.bytes() + 100;
    let limited = BuildOptions { max_memory: Some(limit), ..options };
    let error = pending.build(&backend, &limited).unwrap_err();
    let SceneBuildError::Geometry {
        geometry: 2,
        error: BuildError::OutOfMemory { needed, limit: told },
    } = error
    else {
        panic!("{error}")
    };
    assert!(needed > limit && told == limit, "{needed} {told} {limit}");
    pending.build(&backend, &options).unwrap();
    assert_eq!(backend.builds(), 4);
    // Refused and cancelled when it is put in place: trees are kept.
    for options in [limited, watched] {
        let error = pending.finish(&backend, &mut built, &scene, &options).unwrap_err();
        assert!(matches!(error, FinishError::Build(_)), "{error}");
        assert_eq!((traced_bits(&*built, &rays), built.scene().digest()), (old.clone(), digest));
    }
    pending.finish(&backend, &mut built, &scene, &options).unwrap();
    assert_eq!(backend.builds(), 4);
    assert_eq!(traced_bits(&*built, &rays), traced_bits(&*build(&scene), &rays));
}

/// The first that is finished makes the other outdated; renewed, it builds nothing anew.
#[test]
fn of_two_at_once_the_second_is_outdated_and_loses_nothing() {
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 5);
    let rays = objects::rays(&scene, 500, 6);
    let (mut built, options) = (build(&scene), BuildOptions::default());
    let (one, other) = (counting(usize::MAX), counting(usize::MAX));
    edit(&mut scene, &names, 9);
    let mut first = PendingUpdate::begin(&one, built.scene(), &scene).unwrap();
    // One mesh is the same for both, one is not.
    let geometry = scene.geometries().nth(2).unwrap().0;
    let between = scene.geometry(geometry).unwrap().clone();
    scene.replace_mesh(geometry, &scenes::soup(300, 0.5, 77).mesh()).unwrap();
    let mut second = PendingUpdate::begin(&other, built.scene(), &scene).unwrap();
    first.build(&one, &options).unwrap();
    second.build(&other, &options).unwrap();
    let old = built.scene().digest();
    // The first has no tree of what the description says now.
    let stale = first.finish(&one, &mut built, &scene, &options).unwrap_err();
    assert_eq!(stale, FinishError::NotBuilt { geometry: geometry.0 });
    assert!(!std::sync::Arc::ptr_eq(&between, scene.geometry(geometry).unwrap()));
    assert_eq!(built.scene().digest(), old);
    second.finish(&other, &mut built, &scene, &options).unwrap();
    let now = built.scene().digest();
    assert_ne!(now, old);
    let outdated = first.finish(&one, &mut built, &scene, &options).unwrap_err();
    assert_eq!((outdated, built.scene().digest()), (FinishError::Outdated, now));
    first.renew(built.scene(), &scene).unwrap();
    assert_eq!(first.left(), 0);
    let report = first.finish(&one, &mut built, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, built.scene().digest()), (0, now));
    assert_eq!(one.builds(), 2);
    assert_eq!(traced_bits(&*built, &rays), traced_bits(&*build(&scene), &rays));
}

/// An update of an instance, of a mesh, or of a mask meanwhile is noticed; none, and one that failed, are not.
#[test]
fn every_update_meanwhile_is_noticed() {
    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    for change in 0..6 {
        let (mut scene, names) = objects::scene(Kind::Ordinary, 20, 5);
        let mut built = build(&scene);
        let geometry = scene.geometries().next().unwrap().0;
        let mesh = scenes::soup(200, 0.5, 3);
        let mut next = Scene::new();
        next.add_mesh(&mesh.mesh()).unwrap();
        let mut pending = PendingUpdate::begin(&backend, built.scene(), &next).unwrap();
        pending.build(&backend, &options).unwrap();
        let mut limit = None;
        match change {
            0 => {}
            1 => scene.move_instance(names[0], translation([9.0; 3])).unwrap(),
            2 => scene.replace_mesh(geometry, &scenes::soup(50, 0.5, 4).mesh()).unwrap(),
            3 => {
                let triangles = scene.geometry(geometry).unwrap().mesh().len();
                let mask = OpacityMask::new(triangles, 0, |_, _| false);
                scene.set_opacity(geometry, Some(mask.unwrap())).unwrap();
            }
            4 => drop(scene.add_mesh(&mesh.mesh()).unwrap()),
            _ => {
                scene.add_mesh(&mesh.mesh()).unwrap();
                limit = Some(1);
            }
        }
        let limited = BuildOptions { max_memory: limit, ..options };
        let updated = backend.update_scene(&mut *built, &scene, &limited);
        assert_eq!(updated.is_err(), limit.is_some());
        let digest = built.scene().digest();
        let finished = pending.finish(&backend, &mut built, &next, &options);
        if matches!(change, 0 | 5) {
            finished.unwrap();
        } else {
            assert_eq!(finished.unwrap_err(), FinishError::Outdated, "{change}");
            assert_eq!(built.scene().digest(), digest);
            pending.renew(built.scene(), &next).unwrap();
            pending.finish(&backend, &mut built, &next, &options).unwrap();
        }
        assert_eq!(built.scene().digest(), build(&next).scene().digest());
    }
}

/// Several geometries over the same arrays have one tree, which is built once and counts once.
#[test]
fn a_tree_that_geometries_share_counts_once() {
    let (backend, options) = (counting(usize::MAX), BuildOptions::default());
    let large = scenes::soup(3000, 0.2, 3);
    let mut scene = Scene::new();
    let names: Vec<_> = (0..5).map(|_| scene.add_mesh(&large.mesh()).unwrap()).collect();
    for (number, name) in names.iter().enumerate() {
        let place = translation([3.0 * number as f32, 0.0, 0.0]);
        scene.add_instance(Instance::new(*name, place)).unwrap();
    }
    let arrays = scene.geometry(names[0]).unwrap().clone();
    let other = sharing(&scene, &names);
    let mut built = build(&Scene::new());
    let empty = built.scene().bytes();
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &other).unwrap();
    assert_eq!((pending.left(), pending.progress().total), (2, 2));
    pending.build(&backend, &options).unwrap();
    assert_eq!((backend.builds(), pending.left()), (2, 0));
    let [one, last] = [names[0], names[4]].map(|name| {
        let mut single = Scene::new();
        let own = single.add_mesh(&large.mesh()).unwrap();
        single.share_geometry(own, &other, name).unwrap();
        let built = build(&single);
        let (_, own) = built.scene().geometries().next().unwrap();
        own.bytes()
    });
    assert_eq!(pending.bytes(), one + last);
    assert!(other.geometry(names[1]).is_ok_and(|own| std::sync::Arc::ptr_eq(own, &arrays)));
    // What fits when it counts once is put in place: four times would not.
    let limit = empty + one + last + (64 << 10);
    assert!(limit < empty + 2 * one + last);
    let limited = BuildOptions { max_memory: Some(limit), ..options };
    let tight = BuildOptions { max_memory: Some(one + last - 1), ..options };
    let error = pending.finish(&backend, &mut built, &other, &tight).unwrap_err();
    let FinishError::Build(SceneBuildError::Geometry {
        geometry,
        error: BuildError::OutOfMemory { needed, limit: told },
    }) = error
    else {
        panic!("{error}")
    };
    assert_eq!((geometry, needed, told), (names[4].0, empty + one + last, one + last - 1));
    pending.finish(&backend, &mut built, &other, &limited).unwrap();
    let bytes = built.scene().bytes() - built.scene().bytes_beside_geometries();
    assert_eq!(bytes, one + last);
    let rays = objects::rays(&other, 500, 6);
    assert_eq!(traced_bits(&*built, &rays), traced_bits(&*build(&other), &rays));
    // One of them goes, the tree stays; it counts until the last is gone.
    let mut fewer = sharing(&other, &names);
    for name in &names[..4] {
        let gone: Vec<_> = fewer.instances().filter(|(_, own)| own.geometry == *name).collect();
        let gone: Vec<_> = gone.into_iter().map(|(name, _)| name).collect();
        gone.into_iter().for_each(|own| fewer.remove_instance(own).unwrap());
        fewer.remove_geometry(*name).unwrap();
        CpuBackend::new().update_scene(&mut *built, &fewer, &options).unwrap();
        let bytes = built.scene().bytes() - built.scene().bytes_beside_geometries();
        assert_eq!(bytes, if *name == names[3] { last } else { one + last });
    }
}

/// A scene of the same instances, in which the first four geometries have the arrays of the first.
fn sharing(scene: &Scene, names: &[GeometryId]) -> Scene {
    let mut own = Scene::new();
    for (number, from) in names.iter().enumerate() {
        let name = own.add_mesh(&scenes::soup(1, 0.5, 1).mesh()).unwrap();
        let from = if number < 4 { names[0] } else { *from };
        own.share_geometry(name, scene, from).unwrap();
    }
    for (_, instance) in scene.instances() {
        own.add_instance(*instance).unwrap();
    }
    own
}

#[test]
fn a_tree_of_another_number_of_triangles_is_refused() {
    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    let mut scene = Scene::new();
    scene.add_mesh(&scenes::soup(20, 0.5, 3).mesh()).unwrap();
    let mut built = build(&Scene::new());
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
    let (_, mesh) = pending.next_mesh().unwrap();
    let mesh = mesh.clone();
    let tree = |count| backend.build(&scenes::soup(count, 0.5, 3).mesh(), &options).unwrap();
    for count in [0, 19, 21] {
        let error = pending.give(&mesh, tree(count)).unwrap_err();
        assert!(matches!(error, BuildError::WrongMesh { .. }), "{error}");
        assert_eq!((pending.left(), pending.bytes()), (1, 0));
    }
    pending.give(&mesh, tree(20)).unwrap();
    let bytes = pending.bytes();
    // One that nobody waits for is dropped.
    pending.give(&mesh, tree(20)).unwrap();
    assert_eq!((pending.left(), pending.bytes()), (0, bytes));
    pending.finish(&backend, &mut built, &scene, &options).unwrap();
    assert_eq!(built.scene().digest(), build(&scene).scene().digest());
}

//! Geometries that share arrays have one tree, which is built once and counts once, whoever brings the scene up to date.

use std::sync::Arc;

use splitplane_core::backend::scene::{SceneAccelerator, SceneUpdater};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::scene::{
    GeometryId, Instance, OpacityMask, Scene, SceneBuildError, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::built::{CountingBackend, traced_bits};
use splitplane_test_support::{objects, scenes};

/// Five geometries with an instance each. `shares`: the first four have one set of arrays, in place of equal ones.
fn scene(shares: bool, seed: u64) -> (Scene, Vec<GeometryId>) {
    let mut scene = Scene::new();
    let (large, small) = (scenes::soup(3000, 0.2, seed), scenes::soup(900, 0.2, seed + 1));
    let mut names = Vec::new();
    for number in 0..5 {
        let mesh = if number < 4 { &large } else { &small };
        let name = scene.add_mesh(&mesh.mesh()).unwrap();
        let place = translation([3.0 * number as f32, 0.0, 0.0]);
        scene.add_instance(Instance::new(name, place)).unwrap();
        names.push(name);
    }
    if shares {
        share(&mut scene, &names[..4]);
    }
    (scene, names)
}

/// Gives geometries the arrays of the first.
fn share(scene: &mut Scene, names: &[GeometryId]) {
    let mut aside = Scene::new();
    let own = aside.add_mesh(&scenes::one().mesh()).unwrap();
    aside.share_geometry(own, scene, names[0]).unwrap();
    for name in &names[1..] {
        scene.share_geometry(*name, &aside, own).unwrap();
    }
}

/// How many trees a scene has.
fn trees(built: &dyn SceneAccelerator) -> usize {
    let trees =
        built.scene().geometries().map(|(_, own)| core::ptr::from_ref(own.accelerator().tree()));
    trees.collect::<std::collections::BTreeSet<_>>().len()
}

/// Bytes of the trees.
fn bytes(built: &dyn SceneAccelerator) -> u64 {
    built.scene().bytes() - built.scene().bytes_beside_geometries()
}

#[test]
fn a_scene_is_built_with_one_tree_for_all_that_share_arrays() {
    let (backend, options) = (CountingBackend::new(CpuBackend::new()), BuildOptions::default());
    let (apart, names) = scene(false, 3);
    let (shared, _) = scene(true, 3);
    let rays = objects::rays(&apart, 800, 6);
    let expected = backend.build_scene(&apart, &options).unwrap();
    assert_eq!((backend.take_builds(), trees(&*expected)), (5, 5));
    let built = backend.build_scene(&shared, &options).unwrap();
    assert_eq!((backend.take_builds(), trees(&*built)), (2, 2));
    let of = |name| expected.scene().geometry(name).unwrap().bytes();
    assert_eq!(bytes(&*expected), 4 * of(names[0]) + of(names[4]));
    assert_eq!(bytes(&*built), of(names[0]) + of(names[4]));
    assert_eq!(built.scene().digest(), expected.scene().digest());
    assert_eq!(traced_bits(&*built, &rays), traced_bits(&*expected, &rays));
    for ((_, one), (_, other)) in built.scene().geometries().zip(expected.scene().geometries()) {
        assert_eq!((one.bounds(), one.outline()), (other.bounds(), other.outline()));
    }
    // What fits when it counts once is built.
    let most = (1..200).map(|step| 100_000 * step).find(|&limit| {
        backend.build_scene(&apart, &BuildOptions { max_memory: Some(limit), ..options }).is_ok()
    });
    let limit = most.expect("a limit") - 2 * of(names[0]);
    let limited = BuildOptions { max_memory: Some(limit), ..options };
    assert!(backend.build_scene(&apart, &limited).is_err());
    backend.take_builds();
    let built = backend.build_scene(&shared, &limited).unwrap();
    assert_eq!((backend.take_builds(), built.scene().digest()), (2, expected.scene().digest()));
}

#[test]
fn updates_build_shared_arrays_once() {
    let (backend, options) = (CountingBackend::new(CpuBackend::new()), BuildOptions::default());
    for by_updater in [false, true] {
        let (mut scene, names) = scene(true, 3);
        let rays = objects::rays(&scene, 800, 6);
        let mut built = backend.build_scene(&scene, &options).unwrap();
        let mut updater = SceneUpdater::new(u64::MAX);
        backend.take_builds();
        let mut most = 0;
        for seed in 10..16 {
            scene.replace_mesh(names[0], &scenes::soup(3000, 0.2, seed).mesh()).unwrap();
            share(&mut scene, &names[..4]);
            // Masks are each geometry's own.
            let mask = OpacityMask::new(3000, 1, |triangle, _| triangle % 3 != 0).unwrap();
            scene.set_opacity(names[2], Some(mask)).unwrap();
            let report = match by_updater {
                true => updater.update(&backend, &mut built, &scene, &options),
                false => backend.update_scene(&mut built, &scene, &options),
            };
            assert_eq!(report.unwrap().geometries_built, 4);
            assert_eq!((backend.take_builds(), trees(&*built)), (1, 2), "{by_updater}");
            let fresh = CpuBackend::new().build_scene(&scene, &options).unwrap();
            assert_eq!(built.scene().digest(), fresh.scene().digest());
            assert_eq!(bytes(&*built), bytes(&*fresh));
            assert_eq!(traced_bits(&*built, &rays), traced_bits(&*fresh, &rays));
            // One tree at most, of that size.
            if seed < 13 {
                most = most.max(updater.spare_bytes());
            }
            assert!(updater.spare_bytes() <= most + most / 4, "{} {most}", updater.spare_bytes());
        }
        assert_eq!(most > 0, by_updater);
        // One of them goes, the tree stays; it counts until the last is gone.
        let last = built.scene().geometry(names[4]).unwrap().bytes();
        for name in &names[..4] {
            let gone: Vec<_> = scene.instances().filter(|(_, own)| own.geometry == *name).collect();
            let gone: Vec<_> = gone.into_iter().map(|(name, _)| name).collect();
            gone.into_iter().for_each(|own| scene.remove_instance(own).unwrap());
            scene.remove_geometry(*name).unwrap();
            backend.update_scene(&mut built, &scene, &options).unwrap();
            let fresh = CpuBackend::new().build_scene(&scene, &options).unwrap();
            assert_eq!((backend.take_builds(), bytes(&*built)), (0, bytes(&*fresh)));
            assert_eq!(traced_bits(&*built, &rays), traced_bits(&*fresh, &rays));
        }
        assert_eq!(bytes(&*built), last);
    }
}

#[test]
fn a_tree_that_is_not_built_is_no_geometrys() {
    let (backend, options) = (CountingBackend::new(CpuBackend::new()), BuildOptions::default());
    let (mut scene, names) = scene(true, 3);
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let digest = built.scene().digest();
    scene.replace_mesh(names[1], &scenes::soup(200, 0.2, 8).mesh()).unwrap();
    scene.replace_mesh(names[2], &scenes::soup(300, 0.2, 8).mesh()).unwrap();
    share(&mut scene, &[names[2], names[3], names[4]]);
    for fails_at in [0, 1] {
        backend.fail_at(fails_at);
        let error = backend.update_scene(&mut built, &scene, &options).unwrap_err();
        let SceneBuildError::Geometry { geometry, .. } = error else { panic!("{error}") };
        assert_eq!((geometry, built.scene().digest()), (names[1 + fails_at].0, digest));
    }
    backend.fail_at(usize::MAX);
    // The first keeps the tree that it had; what the others have is another one.
    let report = backend.update_scene(&mut built, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, trees(&*built)), (4, 3));
    let arrays = |name| built.scene().geometry(name).unwrap().mesh();
    assert!(Arc::ptr_eq(arrays(names[2]), arrays(names[4])));
    let fresh = CpuBackend::new().build_scene(&scene, &options).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    // Arrays that a geometry has already are built again for one that gets them in a later update.
    share(&mut scene, &[names[0], names[1]]);
    backend.take_builds();
    let report = backend.update_scene(&mut built, &scene, &options).unwrap();
    assert_eq!((report.geometries_built, backend.take_builds(), trees(&*built)), (1, 1, 3));
}

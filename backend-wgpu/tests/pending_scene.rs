//! Updates that a device builds while the old scene answers.

use std::time::{Duration, Instant};

use crate::common::{self, PATIENCE, backend};
use splitplane_core::backend::scene::{FinishError, SceneAccelerator, SceneUpdater};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    Instance, InstanceId, Scene, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::scenes;
use splitplane_wgpu::{Gpu, PendingSceneUpdate, WgpuBackend};

fn traced(scene: &dyn SceneAccelerator, rays: &[Ray]) -> Vec<[u32; 6]> {
    let mut hits = vec![SceneHit::MISS; rays.len()];
    scene.closest_hits(rays, &mut hits, &SceneOptions::default()).expect("hits");
    hits.iter().map(|hit| bytemuck::cast(*hit)).collect()
}

/// What the CPU answers, of a scene built at once.
fn expected(scene: &Scene, rays: &[Ray]) -> Vec<[u32; 6]> {
    let built = CpuBackend::new().build_scene(scene, &BuildOptions::default()).expect("a scene");
    traced(&*built, rays)
}

fn edit(scene: &mut Scene, names: &[InstanceId], seed: u64) {
    let geometries: Vec<_> = scene.geometries().map(|(name, _)| name).collect();
    scene.replace_mesh(geometries[0], &scenes::grid_boxes(1).mesh()).unwrap();
    scene.replace_mesh(geometries[2], &scenes::soup(3000, 0.2, seed).mesh()).unwrap();
    scene.remove_instance(names[3]).unwrap();
    scene.add_instance(Instance::new(geometries[1], translation([0.5, 0.0, 0.0]))).unwrap();
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_old_scene_answers_until_the_new_one_is_in_place() {
    let (backend, options) = (backend(), BuildOptions::default());
    let (mut scene, names) = objects::scene(Kind::Ordinary, 30, 5);
    let rays = objects::rays(&scene, 1000, 6);
    let work = backend.build_scene_async(&scene, &options);
    let mut built = pollster::block_on(work).expect("a scene");
    let old = expected(&scene, &rays);
    assert_eq!((traced(&built, &rays), built.placed_by_cpu()), (old.clone(), None));
    for round in 0..3u32 {
        let old = traced(&built, &rays);
        if round == 0 {
            edit(&mut scene, &names, 9);
        } else {
            let geometry = scene.geometries().nth(2).unwrap().0;
            let next = scenes::soup(3000, 0.2, 20 + u64::from(round));
            scene.replace_mesh(geometry, &next.mesh()).unwrap();
        }
        let begin = || PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options);
        let mut pending = begin().unwrap();
        let start = Instant::now();
        match round {
            // Between two looks, the old one is asked.
            0 => {
                let early = pending.finish(&mut built, &scene).unwrap_err();
                assert!(matches!(early, FinishError::NotBuilt { .. }), "{early}");
                while !pending.poll().unwrap() {
                    assert_eq!(traced(&built, &rays), old);
                    assert!(start.elapsed() < PATIENCE);
                }
            }
            1 => pending.wait().unwrap(),
            _ => pollster::block_on(pending.wait_async()).unwrap(),
        }
        assert_eq!(traced(&built, &rays), old);
        let report = match round {
            2 => pollster::block_on(pending.finish_async(&mut built, &scene)).unwrap(),
            _ => pending.finish(&mut built, &scene).unwrap(),
        };
        assert_eq!(report.geometries_built, if round == 0 { 2 } else { 1 });
        assert_eq!(built.placed_by_cpu(), None);
        let new = traced(&built, &rays);
        assert_eq!(new, expected(&scene, &rays), "{round}");
        assert_ne!(new, old);
    }
}

/// A build that takes longer than the time-out goes on: it is waited for again and again, and is done in the end.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_build_goes_on_after_a_time_out() {
    let (backend, options) = (backend(), BuildOptions::default());
    let hasty = Gpu::clone(&common::gpu()).with_timeout(Duration::ZERO);
    let hasty = WgpuBackend::without_selftest(hasty);
    for yields in [false, true] {
        let (mut scene, names) = objects::scene(Kind::Ordinary, 10, 5);
        let rays = objects::rays(&scene, 300, 6);
        let mut built = pollster::block_on(backend.build_scene_async(&scene, &options)).unwrap();
        let old = traced(&built, &rays);
        edit(&mut scene, &names, 9);
        let mut pending =
            PendingSceneUpdate::begin(&hasty, built.scene(), &scene, &options).unwrap();
        let (start, mut waits) = (Instant::now(), 0);
        loop {
            let waited = match yields {
                true => pollster::block_on(pending.wait_async()),
                false => pending.wait(),
            };
            let Err(error) = waited else { break };
            let SceneBuildError::Geometry { error: BuildError::Device(told), .. } = error else {
                panic!("{error}")
            };
            assert_eq!(told, DeviceError::TimedOut { seconds: 0 });
            assert!(start.elapsed() < PATIENCE, "{:?}", pending.progress());
            waits += 1;
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(waits > 0);
        assert_eq!(traced(&built, &rays), old);
        pending.finish(&mut built, &scene).unwrap();
        assert_eq!(traced(&built, &rays), expected(&scene, &rays));
    }
}

/// Moved vertices over several updates, with spares: hits are the CPU's, and what is held does not grow.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_updater_builds_into_spares_and_holds_no_more_than_its_bound() {
    let (backend, options) = (backend(), BuildOptions::default());
    let frame = |number: u32| {
        let mut triangles = scenes::soup(2000, 0.1, 7).triangles();
        for corner in triangles.iter_mut().flatten() {
            corner[2] += 0.2 * (corner[0] * 5.0 + number as f32).sin();
        }
        triangles
    };
    let mut scene = Scene::new();
    let still = scene.add_mesh(&scenes::grid_boxes(2).mesh()).unwrap();
    let moves = scene.add_mesh(&Mesh::soup(&frame(0)).unwrap()).unwrap();
    for (number, geometry) in [still, moves, moves].into_iter().enumerate() {
        let place = translation([number as f32 * 2.0, 0.0, 0.0]);
        scene.add_instance(Instance::new(geometry, place)).unwrap();
    }
    let rays = objects::rays(&scene, 800, 6);
    let mut bound = u64::MAX;
    for bounded in [false, true] {
        let mut built = pollster::block_on(backend.build_scene_async(&scene, &options)).unwrap();
        let mut updater = SceneUpdater::new(if bounded { bound } else { u64::MAX });
        let (mut held, mut before) = (Vec::new(), traced(&built, &rays));
        for number in 1..9 {
            scene.replace_mesh(moves, &Mesh::soup(&frame(number % 3)).unwrap()).unwrap();
            let report = updater.update(&backend, &mut built, &scene, &options).unwrap();
            assert_eq!((report.geometries_built, built.placed_by_cpu()), (1, None));
            let hits = traced(&built, &rays);
            assert_eq!(hits, expected(&scene, &rays), "{number}");
            assert_ne!(hits, before);
            before = hits;
            held.push((updater.spare_bytes(), built.scene().bytes(), built.bytes_on_device()));
        }
        if bounded {
            // Too little for one tree.
            assert!(held.iter().all(|(spares, ..)| *spares == 0), "{held:?}");
        } else {
            // From the second update on, one tree.
            let trees = built.scene().bytes() - built.scene().bytes_beside_geometries();
            assert!(held[0].0 == 0 && held[1..].iter().all(|own| own.0 > 0), "{held:?}");
            let most = held[1..4].iter().map(|own| own.0).max().unwrap();
            assert!(held.iter().all(|own| own.0 <= most && own.0 < 4 * trees), "{held:?}");
            bound = held[1..].iter().map(|own| own.0).min().unwrap() - 1;
            // The tree that a new one is built beside counts: what leaves room for the new one alone is refused, and the scene stays.
            scene.replace_mesh(moves, &Mesh::soup(&frame(5)).unwrap()).unwrap();
            let needs = |limit| {
                let limited = BuildOptions { max_memory: Some(limit), ..options };
                let begun = PendingSceneUpdate::begin(&backend, built.scene(), &scene, &limited);
                begun.is_ok()
            };
            let (mut too_little, mut limit) = (built.scene().bytes(), 1 << 32);
            while limit - too_little > 1024 {
                let middle = (limit + too_little) / 2;
                if needs(middle) { limit = middle } else { too_little = middle }
            }
            let limited = BuildOptions { max_memory: Some(limit), ..options };
            let error = updater.update(&backend, &mut built, &scene, &limited).unwrap_err();
            let SceneBuildError::Geometry {
                error: BuildError::OutOfMemory { needed, limit: told },
                ..
            } = error
            else {
                panic!("{error}")
            };
            assert!(needed > limit && told == limit, "{needed} {told} {limit}");
            assert_eq!(traced(&built, &rays), before);
            assert!(updater.spare_bytes() > 0);
        }
        updater.clear();
        assert_eq!((traced(&built, &rays), updater.spare_bytes()), (before, 0));
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn dropped_refused_and_outdated_updates_leave_the_scene() {
    let (backend, options) = (backend(), BuildOptions::default());
    let (mut scene, names) = objects::scene(Kind::Ordinary, 20, 5);
    let rays = objects::rays(&scene, 500, 6);
    let mut built = pollster::block_on(backend.build_scene_async(&scene, &options)).unwrap();
    let (old, digest) = (traced(&built, &rays), built.scene().digest());
    edit(&mut scene, &names, 9);
    drop(PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options).unwrap());
    PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options).unwrap().cancel();
    assert_eq!((traced(&built, &rays), built.scene().digest()), (old.clone(), digest));
    // Refused at once, since the build needs more than is left.
    let small = BuildOptions { max_memory: Some(built.scene().bytes() + 1000), ..options };
    let refused = PendingSceneUpdate::begin(&backend, built.scene(), &scene, &small).err();
    let limit = small.max_memory.unwrap();
    let Some(SceneBuildError::Geometry {
        error: BuildError::OutOfMemory { needed, limit: told },
        ..
    }) = refused
    else {
        panic!("{refused:?}")
    };
    assert!(needed > limit && told == limit, "{needed} {told} {limit}");
    // Two at once: their builds are under way together.
    let mut one = PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options).unwrap();
    let mut other = PendingSceneUpdate::begin(&backend, built.scene(), &scene, &options).unwrap();
    let start = Instant::now();
    while !(one.poll().unwrap() & other.poll().unwrap()) {
        assert_eq!(traced(&built, &rays), old);
        assert!(start.elapsed() < PATIENCE);
    }
    other.finish(&mut built, &scene).unwrap();
    let new = traced(&built, &rays);
    assert_eq!(new, expected(&scene, &rays));
    assert_eq!(one.finish(&mut built, &scene).unwrap_err(), FinishError::Outdated);
    assert_eq!(traced(&built, &rays), new);
    // Renewed while the description changes: what is still needed is kept, the rest is built.
    let geometry = scene.geometries().nth(2).unwrap().0;
    scene.replace_mesh(geometry, &scenes::soup(900, 0.2, 31).mesh()).unwrap();
    one.renew(built.scene(), &scene).unwrap();
    assert_eq!((one.progress().done, one.progress().total), (0, 1));
    scene.replace_mesh(geometry, &scenes::soup(800, 0.2, 32).mesh()).unwrap();
    one.renew(built.scene(), &scene).unwrap();
    one.wait().unwrap();
    one.finish(&mut built, &scene).unwrap();
    assert_eq!(traced(&built, &rays), expected(&scene, &rays));
}

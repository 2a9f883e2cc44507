//! Updates that a device builds while the old scene answers.

mod common;

use std::time::{Duration, Instant};

use splitplane_core::backend::scene::{FinishError, SceneAccelerator};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::BuildError;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    Instance, InstanceId, Scene, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::scenes;
use splitplane_wgpu::{Gpu, PendingSceneUpdate, WgpuBackend};

/// Nothing here takes as long; what takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(120);

fn backend() -> WgpuBackend {
    WgpuBackend::new(Gpu::clone(&common::gpu())).expect("a backend")
}

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
        let report = pending.finish(&mut built, &scene).unwrap();
        assert_eq!(report.geometries_built, if round == 0 { 2 } else { 1 });
        assert_eq!(built.placed_by_cpu(), None);
        let new = traced(&built, &rays);
        assert_eq!(new, expected(&scene, &rays), "{round}");
        assert_ne!(new, old);
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

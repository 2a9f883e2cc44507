//! Scenes whose geometries are built when rays reach them, against scenes that are built at once.

use splitplane::core::watch::{Progress, Watch};
use splitplane::objects::{
    Instance, InstanceId, LazyError, LazyScene, Scene, SceneAccelerator, SceneAllHitsOptions,
    SceneBuildError, SceneClosestPoint, SceneClosestPointOptions, SceneHit, SceneOptions,
    SceneOverlapOptions, translation, write_file,
};
use splitplane::{
    Accelerator, Accuracy, Backend, BackendInfo, BuildError, BuildOptions, CpuBackend, KdTree,
    LoadOptions, LocateOptions, Mesh, QueryError, Ray, Volume,
};
use splitplane_test_support::built::bits;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::scenes;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Barrier};

/// The CPU backend, which counts the meshes with triangles that it builds.
#[derive(Default)]
struct Counting {
    inner: CpuBackend,
    builds: AtomicUsize,
}

impl Backend for Counting {
    fn describe(&self) -> BackendInfo {
        self.inner.describe()
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        if !mesh.is_empty() {
            self.builds.fetch_add(1, Relaxed);
            // Others get the time to come in between.
            std::thread::yield_now();
        }
        self.inner.build(mesh, options)
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.inner.load(mesh, tree, options)
    }
}

fn eager(scene: &Scene) -> Box<dyn SceneAccelerator> {
    CpuBackend::new().build_scene(scene, &BuildOptions::default()).unwrap()
}

fn lazy(scene: &Scene) -> LazyScene {
    LazyScene::new(Arc::new(CpuBackend::new()), scene, &BuildOptions::default()).unwrap()
}

/// Boxes in a row along -z, each a geometry of its own.
fn row(count: usize) -> Scene {
    let mut scene = Scene::new();
    for at in 0..count {
        let mesh = scenes::grid_boxes(1);
        let geometry = scene.add_mesh(&mesh.mesh()).unwrap();
        let place = translation([0.0, 0.0, -10.0 * at as f32]);
        scene.add_instance(Instance::new(geometry, place)).unwrap();
    }
    scene
}

/// A point in the middle of the front of the first box of a row.
fn ahead(scene: &Scene) -> [f32; 3] {
    let built = eager(scene);
    let bounds = built.scene().placement(InstanceId(0)).unwrap().bounds;
    [0.55 * bounds.lo[0] + 0.45 * bounds.hi[0], 0.6 * bounds.lo[1] + 0.4 * bounds.hi[1], 20.0]
}

#[test]
fn hits_are_those_of_a_scene_that_is_built_at_once() {
    for kind in Kind::ALL {
        let (scene, _) = objects::scene(kind, 60, 7);
        let rays = objects::rays(&scene, 600, 11);
        let at_once = eager(&scene);
        for accuracy in [Accuracy::Watertight, Accuracy::Exact] {
            for size in [1, 50, 600] {
                let lazy = lazy(&scene);
                let options = SceneOptions { accuracy, mask: 0x0f0f, ..SceneOptions::default() };
                let mut before = vec![SceneHit::MISS; rays.len()];
                lazy.look(|built| {
                    for (ray, hit) in rays.iter().zip(&mut before) {
                        *hit = built.answer_one(ray, &options);
                    }
                });
                let mut right = vec![SceneHit::MISS; rays.len()];
                at_once.closest_hits(&rays, &mut right, &options).unwrap();
                let mut right_any = vec![false; rays.len()];
                at_once.any_hits(&rays, &mut right_any, &options).unwrap();
                // What is not built would be missed.
                assert!(bits(&before) != bits(&right), "{kind:?}");
                let mut hits = vec![SceneHit::MISS; rays.len()];
                let mut any = vec![false; rays.len()];
                for (place, rays) in rays.chunks(size).enumerate() {
                    let here = place * size..place * size + rays.len();
                    if place % 2 == 0 {
                        lazy.any_hits(rays, &mut any[here.clone()], &options).unwrap();
                        lazy.closest_hits(rays, &mut hits[here], &options).unwrap();
                    } else {
                        lazy.closest_hits(rays, &mut hits[here.clone()], &options).unwrap();
                        lazy.any_hits(rays, &mut any[here], &options).unwrap();
                    }
                }
                assert!(bits(&hits) == bits(&right), "{kind:?} {accuracy:?} {size}");
                assert!(any == right_any, "{kind:?} {accuracy:?} {size}");
                assert!(lazy.built() > 0);
            }
        }
        let lazy = lazy(&scene);
        let options = SceneAllHitsOptions::default();
        assert!(
            lazy.all_hits(&rays, &options).unwrap() == at_once.all_hits(&rays, &options).unwrap()
        );
    }
}

#[test]
fn only_what_rays_reach_is_built() {
    let scene = row(20);
    let lazy = lazy(&scene);
    assert_eq!((lazy.built(), lazy.waiting(), lazy.builds()), (0, 20, 0));
    let options = SceneOptions::default();
    let origin = ahead(&scene);
    let ray = Ray::new(origin, [0.0, 0.0, -1.0]);
    // The first hides the others.
    let hit = lazy.closest_hit(&ray, &options).unwrap().unwrap();
    assert_eq!((hit.instance, lazy.built(), lazy.builds()), (0, 1, 1));
    let mut any = [false];
    lazy.any_hits(&[ray], &mut any, &options).unwrap();
    assert_eq!((any, lazy.built()), ([true], 1));
    // From behind it the next; past all of them, none; with a limit before it, none.
    let second = Ray::new([origin[0], origin[1], -5.0], [0.0, 0.0, -1.0]);
    assert_eq!(lazy.closest_hit(&second.with_limits(0.0, 1.0), &options).unwrap(), None);
    assert_eq!(lazy.built(), 1);
    assert_eq!(lazy.closest_hit(&second, &options).unwrap().unwrap().instance, 1);
    assert_eq!(lazy.closest_hit(&Ray::new([500.0; 3], [0.0, 0.0, -1.0]), &options).unwrap(), None);
    let masked = SceneOptions { mask: 0, ..options };
    assert_eq!(lazy.closest_hit(&ray, &masked).unwrap(), None);
    assert_eq!((lazy.built(), lazy.waiting()), (2, 18));
    // All hits need all on the way, points everything.
    let part = ray.with_limits(0.0, 45.0);
    lazy.all_hits(&[part], &SceneAllHitsOptions::default()).unwrap();
    assert!((3..6).contains(&lazy.built()), "{}", lazy.built());
    let located = lazy.locate(&[[0.0; 3]], &LocateOptions::default()).unwrap();
    assert_eq!(located.windings.len(), 1);
    assert_eq!((lazy.built(), lazy.waiting(), lazy.builds()), (20, 0, 20));
    let mut closest = [SceneClosestPoint::NONE];
    let options = SceneClosestPointOptions::default();
    lazy.closest_points(&[[0.0; 3]], &mut closest, &options).unwrap();
    let mut right = [SceneClosestPoint::NONE];
    eager(&scene).closest_points(&[[0.0; 3]], &mut right, &options).unwrap();
    assert_eq!(closest, right);
}

/// Overlaps have no way either: they build everything, and are those of the scene built at once.
#[test]
fn overlaps_are_those_of_a_scene_that_is_built_at_once() {
    let scene = row(5);
    let volumes = [0.0, -10.0, -25.0].map(|z| Volume::Ball { centre: [0.0, 0.0, z], radius: 8.0 });
    let options = SceneOverlapOptions::default();
    let (found, right) = (lazy(&scene), eager(&scene));
    let met = found.overlaps(&volumes, &options).unwrap();
    assert_eq!((found.built(), found.waiting()), (5, 0));
    assert_eq!(met, right.overlaps(&volumes, &options).unwrap());
    assert!(met.triangles.iter().any(|own| own.instance == 3));
    let (found, mut any) = (lazy(&scene), [true; 3]);
    found.overlaps_any(&volumes, &mut any, &options).unwrap();
    assert_eq!((any, found.waiting()), ([true; 3], 0));
    let masked = SceneOverlapOptions { mask: 0, ..options };
    found.overlaps_any(&volumes, &mut any, &masked).unwrap();
    assert_eq!(any, [false; 3]);
}

/// Many threads that reach the same geometries at once, many times.
#[test]
fn threads_that_race_have_the_answers_of_one() {
    let scene = row(6);
    let origin = ahead(&scene);
    let rays: Vec<Ray> = (0..6)
        .map(|at| Ray::new([origin[0], origin[1], 4.0 - 10.0 * at as f32], [0.0, 0.0, -1.0]))
        .collect();
    let mut right = vec![SceneHit::MISS; rays.len()];
    eager(&scene).closest_hits(&rays, &mut right, &SceneOptions::default()).unwrap();
    for round in 0..100 {
        let backend = Arc::new(Counting::default());
        let lazy = LazyScene::new(backend.clone(), &scene, &BuildOptions::default()).unwrap();
        let start = Barrier::new(4);
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let (lazy, start, rays, right) = (&lazy, &start, &rays, &right);
                scope.spawn(move || {
                    start.wait();
                    for step in 0..rays.len() {
                        // Two by two in the same order, and against it.
                        let place = if thread < 2 { step } else { rays.len() - 1 - step };
                        let options = SceneOptions::default();
                        let hit = lazy.closest_hit(&rays[place], &options).unwrap().unwrap();
                        assert_eq!(bits(&[hit]), bits(&right[place..=place]));
                    }
                });
            }
        });
        // Several may build one at the same time; one tree of each is kept.
        assert_eq!((lazy.built(), lazy.builds()), (6, 6), "{round}");
        assert!((6..=24).contains(&backend.builds.load(Relaxed)), "{round}");
    }
}

#[test]
fn a_build_that_fails_is_an_error_of_the_query_and_leaves_the_rest() {
    let mut scene = row(1);
    let big = scenes::sphere(60, [0.0; 3], 2.0);
    let geometry = scene.add_mesh(&big.mesh()).unwrap();
    scene.add_instance(Instance::new(geometry, translation([100.0, 0.0, 0.0]))).unwrap();
    let small = row(1);
    // Enough for the small one and what its build holds meanwhile.
    let limit = 300_000;
    let options = BuildOptions { max_memory: Some(limit), ..BuildOptions::default() };
    let backend = Arc::new(CpuBackend::new());
    let lazy = LazyScene::new(backend, &scene, &options).unwrap();
    let at_small = Ray::new(ahead(&small), [0.0, 0.0, -1.0]);
    let at_big = Ray::new([100.1, 0.1, 9.0], [0.0, 0.0, -1.0]);
    let query = SceneOptions::default();
    for _ in 0..2 {
        match lazy.closest_hit(&at_big, &query).unwrap_err() {
            LazyError::Build(SceneBuildError::Geometry { geometry, error }) => {
                assert_eq!(geometry, 1);
                assert!(matches!(error, BuildError::OutOfMemory { limit: of, .. } if of == limit));
            }
            other => panic!("{other:?}"),
        }
        // A batch in which one ray reaches it has no answer; what does not reach it has.
        let mut hits = [SceneHit::MISS; 2];
        lazy.closest_hits(&[at_small, at_big], &mut hits, &query).unwrap_err();
        assert_eq!(lazy.closest_hit(&at_small, &query).unwrap().unwrap().instance, 0);
        assert_eq!(lazy.waiting(), 1);
    }
    assert!(lazy.bytes() <= limit);
    assert!(matches!(lazy.save(None), Err(LazyError::Build(_))));
    // The length of answers is checked as ever.
    let error = lazy.closest_hits(&[at_small], &mut [], &query).unwrap_err();
    assert_eq!(error, LazyError::Query(QueryError::LengthMismatch { rays: 1, results: 0 }));
}

#[test]
fn a_watch_that_cancels_ends_the_build_and_the_next_query_goes_on() {
    struct Never;
    impl Watch for Never {
        fn progress(&self, progress: &Progress) -> ControlFlow<()> {
            // Only while something is built.
            match progress.stage {
                splitplane::Stage::Rays => ControlFlow::Continue(()),
                _ => ControlFlow::Break(()),
            }
        }
    }
    let scene = row(3);
    let lazy = lazy(&scene);
    let ray = Ray::new(ahead(&scene), [0.0, 0.0, -1.0]);
    let watched = SceneOptions { watch: Some(&Never), ..SceneOptions::default() };
    let error = lazy.closest_hit(&ray, &watched).unwrap_err();
    let cancelled = matches!(
        error,
        LazyError::Build(SceneBuildError::Cancelled { .. })
            | LazyError::Build(SceneBuildError::Geometry {
                error: BuildError::Cancelled { .. },
                ..
            })
    );
    assert!(cancelled, "{error:?}");
    assert_eq!(lazy.built(), 0);
    assert!(lazy.closest_hit(&ray, &SceneOptions::default()).unwrap().is_some());
}

#[test]
fn updates_keep_what_is_built_and_let_new_arrays_wait() {
    let (mut scene, instances) = objects::scene(Kind::Ordinary, 50, 3);
    let backend = Arc::new(Counting::default());
    let mut lazy = LazyScene::new(backend.clone(), &scene, &BuildOptions::default()).unwrap();
    let options = SceneOptions::default();
    let same = |lazy: &LazyScene, scene: &Scene| {
        let rays = objects::rays(scene, 400, 5);
        let (mut hits, mut right) = (vec![SceneHit::MISS; 400], vec![SceneHit::MISS; 400]);
        lazy.closest_hits(&rays, &mut hits, &options).unwrap();
        eager(scene).closest_hits(&rays, &mut right, &options).unwrap();
        assert!(bits(&hits) == bits(&right));
    };
    same(&lazy, &scene);
    let (built, builds) = (lazy.built(), backend.builds.load(Relaxed));
    // Moved, removed and added instances build nothing.
    scene.move_instance(instances[3], translation([0.5, 0.25, -1.0])).unwrap();
    scene.remove_instance(instances[7]).unwrap();
    lazy.update(&scene).unwrap();
    assert_eq!((lazy.built(), backend.builds.load(Relaxed)), (built, builds));
    same(&lazy, &scene);
    // Another mesh waits for a ray; a geometry that goes is gone.
    let geometry = scene.instance(instances[3]).unwrap().geometry;
    scene.replace_mesh(geometry, &scenes::sphere(9, [0.0; 3], 1.5).mesh()).unwrap();
    lazy.update(&scene).unwrap();
    assert_eq!(lazy.built(), built - 1);
    same(&lazy, &scene);
    assert_eq!(lazy.built(), built);
    let gone: Vec<InstanceId> = scene
        .instances()
        .filter(|(_, instance)| instance.geometry == geometry)
        .map(|(name, _)| name)
        .collect();
    gone.into_iter().for_each(|name| scene.remove_instance(name).unwrap());
    scene.remove_geometry(geometry).unwrap();
    lazy.update(&scene).unwrap();
    same(&lazy, &scene);
    // A file holds all of it, as if it had been built at once.
    let bytes = lazy.save(None).unwrap();
    assert!(bytes == write_file(eager(&scene).scene()).unwrap());
    assert_eq!(lazy.look(|built| built.digest()), eager(&scene).scene().digest());
}

/// Queries from tasks of the pool that builds and traces: whoever waits for a part of its work may take up another task, which must
/// not have to wait for the first one.
#[test]
fn tasks_of_one_pool_do_not_wait_for_one_another() {
    use rayon::prelude::*;
    let (scene, _) = objects::scene(Kind::Ordinary, 60, 9);
    let rays = objects::rays(&scene, 400, 21);
    let mut right = vec![SceneHit::MISS; rays.len()];
    eager(&scene).closest_hits(&rays, &mut right, &SceneOptions::default()).unwrap();
    for threads in [1, 2, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for _ in 0..5 {
            let lazy = lazy(&scene);
            let mut hits = vec![SceneHit::MISS; rays.len()];
            pool.install(|| {
                let tasks = rays.par_chunks(7).zip(hits.par_chunks_mut(7));
                tasks.for_each(|(rays, hits)| {
                    lazy.closest_hits(rays, hits, &SceneOptions::default()).unwrap();
                });
            });
            assert!(bits(&hits) == bits(&right), "{threads}");
            assert_eq!(lazy.builds(), lazy.built() as u64);
        }
    }
}

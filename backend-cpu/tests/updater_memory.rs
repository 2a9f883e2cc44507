//! What an updater of scenes holds, and what of it counts towards limits, by trees that are counted and limits that are noted.

use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

use splitplane_core::backend::scene::{FinishError, PendingUpdate, SceneAccelerator, SceneUpdater};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, LoadOptions};
use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::all_hits::{AllHits, AllHitsOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::{BackendInfo, BuildSummary};
use splitplane_core::scene::{GeometryId, Instance, Scene, SceneBuildError, translation};
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;

/// Trees of the CPU's that can be counted, and the limit of each build in turn.
#[derive(Default)]
struct Counted {
    cpu: CpuBackend,
    /// Rebuilds make a new tree beside the old one.
    beside: bool,
    /// Rebuilds fail once they have made a tree of so many triangles in the old one's place.
    fails_with: Mutex<Option<usize>>,
    alive: Arc<()>,
    limits: Mutex<Vec<Option<u64>>>,
    /// How often a tree was asked for its bytes.
    asked: Arc<AtomicUsize>,
}

impl Counted {
    fn new(beside: bool) -> Counted {
        Counted { beside, ..Counted::default() }
    }

    /// Trees that somebody holds.
    fn trees(&self) -> usize {
        Arc::strong_count(&self.alive) - 1
    }

    fn note(&self, options: &BuildOptions<'_>) {
        self.limits.lock().unwrap().push(options.max_memory);
    }

    fn limits(&self) -> Vec<Option<u64>> {
        std::mem::take(&mut *self.limits.lock().unwrap())
    }
}

impl Backend for Counted {
    fn describe(&self) -> BackendInfo {
        BackendInfo::new("counted")
    }

    fn build(
        &self,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.note(options);
        let tree = self.cpu.build(mesh, options)?;
        let (_alive, asked) = (Arc::clone(&self.alive), Arc::clone(&self.asked));
        Ok(Box::new(Tree { tree, _alive, asked }))
    }

    fn rebuild(
        &self,
        accelerator: &mut Box<dyn Accelerator>,
        mesh: &Mesh<'_>,
        options: &BuildOptions<'_>,
    ) -> Result<(), BuildError> {
        if self.beside {
            *accelerator = self.build(mesh, &options.beside(accelerator.held_bytes()))?;
            return Ok(());
        }
        self.note(options);
        let own = accelerator.downcast_mut::<Tree>().expect("one of this backend");
        if let Some(count) = *self.fails_with.lock().unwrap() {
            own.tree = self.cpu.build(&scenes::soup(count, 0.1, 9).mesh(), options)?;
            return Err(BuildError::Device(DeviceError::Failed("planted".into())));
        }
        self.cpu.rebuild(&mut own.tree, mesh, options)
    }

    fn load(
        &self,
        mesh: &Mesh<'_>,
        tree: KdTree,
        options: &LoadOptions<'_>,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        self.cpu.load(mesh, tree, options)
    }
}

struct Tree {
    tree: Box<dyn Accelerator>,
    _alive: Arc<()>,
    asked: Arc<AtomicUsize>,
}

impl Accelerator for Tree {
    fn tree(&self) -> &KdTree {
        self.tree.tree()
    }

    fn summary(&self) -> &BuildSummary {
        self.tree.summary()
    }

    fn query_bytes(&self) -> u64 {
        self.asked.fetch_add(1, Relaxed);
        self.tree.query_bytes()
    }

    fn held_bytes(&self) -> u64 {
        self.tree.held_bytes()
    }

    fn as_any_mut(&mut self) -> Option<&mut dyn core::any::Any> {
        Some(self)
    }

    fn closest_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> Option<Hit> {
        self.tree.closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &QueryOptions<'_>) -> bool {
        self.tree.any_hit(ray, options)
    }

    fn all_hits(&self, rays: &[Ray], options: &AllHitsOptions<'_>) -> Result<AllHits, QueryError> {
        self.tree.all_hits(rays, options)
    }
}

/// Two meshes of these numbers of triangles.
fn scene_of(counts: [usize; 2]) -> (Scene, [GeometryId; 2]) {
    let mut scene = Scene::new();
    let names = counts.map(|count| scene.add_mesh(&scenes::soup(count, 0.1, 1).mesh()).unwrap());
    for name in names {
        scene.add_instance(Instance::in_place(name)).unwrap();
    }
    (scene, names)
}

fn replace(scene: &mut Scene, name: GeometryId, count: usize, seed: u64) {
    scene.replace_mesh(name, &scenes::soup(count, 0.1, seed).mesh()).unwrap();
}

#[test]
fn trees_that_the_scene_has_no_more_are_not_kept_beyond_the_bound() {
    let options = BuildOptions::default();
    // Each way in which a scene loses a tree that came from the updater.
    for way in 0..4 {
        for bound in [0, u64::MAX] {
            let backend = Counted::new(false);
            let (mut scene, [one, other]) = scene_of([2_000, 30]);
            let mut built = backend.build_scene(&scene, &options).unwrap();
            let mut updater = SceneUpdater::new(bound);
            replace(&mut scene, one, 2_000, 2);
            updater.update(&backend, &mut *built, &scene, &options).unwrap();
            // The scene's two.
            assert_eq!(backend.trees(), 2);
            match way {
                0 => {
                    replace(&mut scene, one, 40, 3);
                    backend.update_scene(&mut *built, &scene, &options).unwrap();
                }
                1 => {
                    let gone: Vec<_> = scene.instances().map(|(name, _)| name).collect();
                    scene.remove_instance(gone[0]).unwrap();
                    scene.remove_geometry(one).unwrap();
                    backend.update_scene(&mut *built, &scene, &options).unwrap();
                }
                2 => built = backend.build_scene(&scene, &options).unwrap(),
                _ => {
                    (scene, _) = scene_of([10, 20]);
                    backend.update_scene(&mut *built, &scene, &options).unwrap();
                }
            }
            let scenes_own = built.scene().geometries().count();
            if bound == 0 {
                assert_eq!(backend.trees(), scenes_own, "{way}");
            }
            replace(&mut scene, other, 30, 4);
            updater.update(&backend, &mut *built, &scene, &options).unwrap();
            // With room, the lost tree is a spare now where its geometry is still there, and told.
            let spares = usize::from(bound > 0 && way != 1);
            assert_eq!(backend.trees(), scenes_own + spares, "{way}");
            assert_eq!(updater.spare_bytes() > 0, spares > 0, "{way}");
            updater.clear();
            assert_eq!((backend.trees(), updater.spare_bytes()), (scenes_own, 0));
            let fresh = CpuBackend::new().build_scene(&scene, &options).unwrap();
            assert_eq!(built.scene().digest(), fresh.scene().digest());
        }
    }
}

/// While the first mesh is built, the spare of the second is held, and the first's is what it is built into or beside.
#[test]
fn spares_count_towards_the_limit_until_they_are_built_into() {
    for beside in [false, true] {
        let (backend, options) = (Counted::new(beside), BuildOptions::default());
        let (mut scene, names) = scene_of([500, 5_000]);
        let mut built = backend.build_scene(&scene, &options).unwrap();
        let mut updater = SceneUpdater::new(u64::MAX);
        let change = |scene: &mut Scene, seed| {
            replace(scene, names[0], 500, seed);
            replace(scene, names[1], 5_000, seed);
        };
        for seed in 2..5 {
            change(&mut scene, seed);
            updater.update(&backend, &mut *built, &scene, &options).unwrap();
        }
        assert_eq!(backend.trees(), 4);
        // Of the small one alone: its spare's bytes.
        let spares = updater.spare_bytes();
        let small = {
            let [small, large] = names.map(|name| built.scene().geometry(name).unwrap().bytes());
            assert!(large > 5 * small);
            spares * small / (small + large)
        };
        change(&mut scene, 5);
        let (before, limit) = (built.scene().bytes(), 1 << 30);
        let limited = BuildOptions { max_memory: Some(limit), ..options };
        backend.limits();
        updater.update(&backend, &mut *built, &scene, &limited).unwrap();
        let limits: Vec<u64> = backend.limits().into_iter().flatten().collect();
        // Halves of what is meant, since the two sizes of spares are not told.
        let (first, second) = (limit - before - limits[0], limit - before - limits[1]);
        assert!(first >= (spares - 2 * small) && first <= spares, "{first} {spares} {small}");
        // The second has its own spare alone, beside which or into which it is built, and the first tree.
        assert!(second <= if beside { spares + small } else { 3 * small }, "{second} {spares}");
        // A limit that the spare of the large mesh does not leave room in is told as it was set.
        change(&mut scene, 6);
        let tight = built.scene().bytes() + updater.spare_bytes() / 2;
        let limited = BuildOptions { max_memory: Some(tight), ..options };
        let digest = built.scene().digest();
        let error = updater.update(&backend, &mut *built, &scene, &limited).unwrap_err();
        let SceneBuildError::Geometry {
            geometry,
            error: BuildError::OutOfMemory { needed, limit: told },
        } = error
        else {
            panic!("{error}")
        };
        assert_eq!((geometry, told, built.scene().digest()), (names[0].0, tight, digest));
        assert!(needed > tight);
        updater.update(&backend, &mut *built, &scene, &options).unwrap();
    }
}

/// A small tree in the memory of a large one counts as the large one.
#[test]
fn spares_count_by_what_they_hold() {
    let (backend, options) = (Counted::new(false), BuildOptions::default());
    let (mut scene, [one, _]) = scene_of([20_000, 30]);
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let mut updater = SceneUpdater::new(u64::MAX);
    for seed in 2..5 {
        replace(&mut scene, one, 20_000, seed);
        updater.update(&backend, &mut *built, &scene, &options).unwrap();
    }
    let large = updater.spare_bytes();
    for seed in 5..8 {
        replace(&mut scene, one, 10, seed);
        updater.update(&backend, &mut *built, &scene, &options).unwrap();
    }
    // Both trees are small now, in the memory that they had.
    let small = built.scene().geometry(one).unwrap().bytes();
    assert!(small < large / 100);
    assert!(updater.spare_bytes() > large / 2, "{} {large}", updater.spare_bytes());
    // So a bound below that drops it.
    let mut bounded = SceneUpdater::new(large / 4);
    replace(&mut scene, one, 20_000, 8);
    bounded.update(&backend, &mut *built, &scene, &options).unwrap();
    for seed in 9..12 {
        replace(&mut scene, one, 10, seed);
        bounded.update(&backend, &mut *built, &scene, &options).unwrap();
        assert!(bounded.spare_bytes() <= large / 4);
    }
}

/// What a spare holds after a build into it that failed is told, and bounded.
#[test]
fn spares_are_counted_again_after_a_build_into_them_failed() {
    let (backend, options) = (Counted::new(false), BuildOptions::default());
    let (mut scene, [one, _]) = scene_of([3_000, 30]);
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let bytes_of = |count| {
        let tree = backend.build(&scenes::soup(count, 0.1, 9).mesh(), &options).unwrap();
        tree.held_bytes()
    };
    let [small, middle, large] = [10, 3_000, 9_000].map(bytes_of);
    let bound = middle + large;
    let mut updater = SceneUpdater::new(bound);
    for seed in 2..5 {
        replace(&mut scene, one, 3_000, seed);
        updater.update(&backend, &mut *built, &scene, &options).unwrap();
    }
    let (digest, spares) = (built.scene().digest(), updater.spare_bytes());
    assert!(spares > small && spares < large && large < bound, "{small} {spares} {large}");
    assert_eq!(backend.trees(), 3);
    // Less, more, and more than the bound: that one is dropped.
    for (count, held, trees) in [(10, small, 3), (9_000, large, 3), (30_000, 0, 2)] {
        *backend.fails_with.lock().unwrap() = Some(count);
        replace(&mut scene, one, 3_000, 5);
        updater.update(&backend, &mut *built, &scene, &options).unwrap_err();
        assert_eq!((updater.spare_bytes(), backend.trees()), (held, trees), "{count}");
        assert_eq!(built.scene().digest(), digest);
    }
    // Without a spare it is built anew.
    updater.update(&backend, &mut *built, &scene, &options).unwrap();
    let fresh = CpuBackend::new().build_scene(&scene, &options).unwrap();
    assert_eq!(built.scene().digest(), fresh.scene().digest());
    assert!(updater.spare_bytes() > 0 && updater.spare_bytes() <= bound);
}

/// A pending update builds into spares where the updater builds and finishes it: no more trees are held than by updates at once.
#[test]
fn pending_updates_build_into_spares() {
    let (backend, options) = (Counted::new(false), BuildOptions::default());
    let (mut scene, [one, other]) = scene_of([2_000, 30]);
    let mut built = backend.build_scene(&scene, &options).unwrap();
    let mut updater = SceneUpdater::new(u64::MAX);
    let cpu = CpuBackend::new();
    for seed in 2..9 {
        let digest = built.scene().digest();
        replace(&mut scene, one, 2_000, seed);
        let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
        let spares = updater.spare_bytes();
        assert_eq!(spares > 0, seed > 3, "{seed}");
        // Too little for all that is held: the spare stays, and so does the scene.
        let tight = BuildOptions { max_memory: Some(built.scene().bytes() + 100), ..options };
        let error = updater.build_next(&backend, &mut pending, &tight).unwrap_err();
        let SceneBuildError::Geometry { error: BuildError::OutOfMemory { needed, limit }, .. } =
            error
        else {
            panic!("{error}")
        };
        assert!(needed > limit && Some(limit) == tight.max_memory, "{needed} {limit}");
        assert_eq!((pending.left(), updater.spare_bytes()), (1, spares));
        assert!(updater.build_next(&backend, &mut pending, &options).unwrap());
        assert!(!updater.build_next(&backend, &mut pending, &options).unwrap());
        assert_eq!((pending.left(), updater.spare_bytes()), (0, 0));
        assert_eq!(built.scene().digest(), digest);
        let error = updater.finish(&backend, &mut pending, &mut *built, &scene, &tight);
        assert!(matches!(error, Err(FinishError::Build(_))), "{error:?}");
        assert_eq!((pending.left(), built.scene().digest()), (0, digest));
        let report = updater.finish(&backend, &mut pending, &mut *built, &scene, &options).unwrap();
        drop(pending);
        assert_eq!(report.geometries_built, 1);
        assert_eq!(backend.trees(), if seed > 2 { 3 } else { 2 }, "{seed}");
        let fresh = cpu.build_scene(&scene, &options).unwrap();
        assert_eq!(built.scene().digest(), fresh.scene().digest());
    }
    // An update at once goes on with the same spares.
    replace(&mut scene, one, 2_000, 9);
    replace(&mut scene, other, 30, 9);
    updater.update(&backend, &mut *built, &scene, &options).unwrap();
    assert_eq!(backend.trees(), 3);
    // Dropped, a pending update takes along the spare that it was built into.
    replace(&mut scene, one, 2_000, 10);
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
    updater.build_next(&backend, &mut pending, &options).unwrap();
    drop(pending);
    assert_eq!((backend.trees(), updater.spare_bytes()), (2, 0));
    // An outdated one leaves spares and scene.
    let mut pending = PendingUpdate::begin(&backend, built.scene(), &scene).unwrap();
    updater.build_next(&backend, &mut pending, &options).unwrap();
    updater.update(&backend, &mut *built, &scene, &options).unwrap();
    let (digest, spares) = (built.scene().digest(), updater.spare_bytes());
    let outdated = updater.finish(&backend, &mut pending, &mut *built, &scene, &options);
    assert_eq!(outdated.unwrap_err(), FinishError::Outdated);
    assert_eq!((built.scene().digest(), updater.spare_bytes()), (digest, spares));
}

/// The limit is looked at between every few thousand instances, and the bytes of all geometries are summed no more often for it.
#[test]
fn many_instances_ask_no_tree_more_often_for_its_bytes() {
    let asked = |instances: usize| {
        let backend = Counted::new(false);
        let (mut scene, names) = scene_of([20, 30]);
        for _ in 0..50 {
            scene.add_mesh(&scenes::soup(10, 0.1, 3).mesh()).unwrap();
        }
        let options = BuildOptions { max_memory: Some(1 << 30), ..BuildOptions::default() };
        let mut built = backend.build_scene(&scene, &options).unwrap();
        for number in 0..instances {
            scene.add_instance(Instance::new(names[number % 2], translation([1.0; 3]))).unwrap();
        }
        backend.asked.store(0, Relaxed);
        backend.update_scene(&mut built, &scene, &options).unwrap();
        backend.asked.load(Relaxed)
    };
    let (few, many) = (asked(100), asked(30_000));
    assert!(few > 50, "{few}");
    assert_eq!(few, many);
}

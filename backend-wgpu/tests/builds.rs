//! Builds under way, consecutive and concurrent: whatever came before, the tree is the CPU's.

use std::time::{Duration, Instant};

use crate::common::{self, PATIENCE, backend};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::Kernel;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::report::BuildSummary;
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{
    DeviceBuild, DeviceMesh, DeviceTree, Effort, Gpu, GpuError, PendingBuild, WgpuAccelerator,
    WgpuBackend,
};

/// A backend that nothing was built on, not even by a self-test.
fn fresh() -> WgpuBackend {
    fresh_on(Gpu::clone(&common::gpu()))
}

fn fresh_on(gpu: Gpu) -> WgpuBackend {
    let kernel = Kernel::EmitTop;
    let source = splitplane_shaders::KERNELS[kernel as usize].source();
    WgpuBackend::with_replaced_kernel(gpu, kernel, source)
}

fn expected(scene: &Scene, config: BuildConfig) -> (KdTree, BuildSummary) {
    CpuBackend::new().build_tree(&scene.mesh(), &config.into()).expect("a tree")
}

#[track_caller]
fn assert_tree(backend: &WgpuBackend, built: &DeviceBuild, expected: &KdTree, what: &str) {
    let tree = built.tree.read(backend.gpu()).expect("a tree in host memory");
    assert_eq!(tree.digest(), expected.digest(), "{what}");
    assert!(tree == *expected, "{what}: one digest, two trees");
}

/// Builds and compares; gives what it took.
#[track_caller]
fn check(backend: &WgpuBackend, scene: &Scene, config: BuildConfig) -> Effort {
    let built = backend.build_on_device(&scene.mesh(), &config.into());
    let built = built.unwrap_or_else(|error| panic!("{}: {error}", scene.name));
    assert_tree(backend, &built, &expected(scene, config).0, &scene.name);
    built.effort
}

/// Rays at a scene, with the hits that the CPU finds.
struct Rays {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
}

impl Rays {
    fn at(scene: &Scene, count: usize) -> Rays {
        let mesh = scene.mesh();
        let mut rays = aim::rays(&mesh, Kind::Faces, count / 2, 5);
        rays.extend(aim::rays(&mesh, Kind::Random, count / 2, 6));
        let cpu = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
        let mut hits = vec![Hit::MISS; rays.len()];
        cpu.closest_hits(&rays, &mut hits, &QueryOptions::default()).expect("hits");
        assert!(hits.iter().filter(|hit| hit.is_hit()).count() > count / 4);
        Rays { rays, hits }
    }

    #[track_caller]
    fn check(&self, found: &[Hit], what: &str) {
        let [found, expected]: [&[u8]; 2] = [found, &self.hits].map(bytemuck::cast_slice);
        assert!(found == expected, "{what}: other hits than the CPU's");
    }

    #[track_caller]
    fn check_tree(&self, backend: &WgpuBackend, tree: &DeviceTree, what: &str) {
        let mut found = vec![Hit::MISS; self.rays.len()];
        let options = QueryOptions::default();
        backend.queries().closest_hits(tree, &self.rays, &mut found, &options).expect("hits");
        self.check(&found, what);
    }

    #[track_caller]
    fn check_accelerator(&self, accelerator: &dyn Accelerator, what: &str) {
        let mut found = vec![Hit::MISS; self.rays.len()];
        let options = QueryOptions::default();
        accelerator.closest_hits(&self.rays, &mut found, &options).expect("hits");
        self.check(&found, what);
        for (ray, hit) in self.rays.iter().zip(&self.hits).step_by(17) {
            assert_eq!(accelerator.closest_hit(ray, &options), hit.some(), "{what}: a single ray");
        }
    }
}

/// Polls, without ever waiting, until the build is done.
fn poll_until_done(pending: &mut PendingBuild, what: &str) -> DeviceBuild {
    let start = Instant::now();
    loop {
        if let Some(built) = pending.poll().unwrap_or_else(|error| panic!("{what}: {error}")) {
            return built;
        }
        assert!(start.elapsed() < PATIENCE, "{what} hangs");
        std::thread::sleep(Duration::from_micros(200));
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_old_tree_answers_while_the_new_one_is_built() {
    let backend = backend();
    let old = scenes::soup(2_000, 0.1, 1).named("old");
    let new = scenes::soup(20_000, 0.01, 2).named("new");
    let (old_rays, new_rays) = (Rays::at(&old, 500), Rays::at(&new, 500));
    let first = backend.build_on_device(&old.mesh(), &BuildOptions::default()).unwrap();
    // Twice: the second build finds the buffers of the first, the tree's taken out.
    let mut last = first;
    for round in 0..2 {
        let mut pending = backend.submit_build(&new.mesh(), &BuildOptions::default()).unwrap();
        // Queued after the build, and polled in between.
        for _ in 0..3 {
            old_rays.check_tree(&backend, &last.tree, "the old tree meanwhile");
        }
        let built = poll_until_done(&mut pending, "the build");
        assert_eq!((built.effort.submissions, built.effort.readbacks), (1, 1), "round {round}");
        assert_tree(&backend, &built, &expected(&new, BuildConfig::default()).0, "the new tree");
        new_rays.check_tree(&backend, &built.tree, "the new tree");
        old_rays.check_tree(&backend, &last.tree, "the old tree afterwards");
        last = backend.build_on_device(&old.mesh(), &BuildOptions::default()).unwrap();
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn builds_in_flight_do_not_disturb_one_another() {
    let backend = backend();
    let scenes = [
        scenes::soup(3_000, 0.1, 3).named("a"),
        scenes::fan(3_000).named("b, which outgrows its estimate"),
        scenes::grid_boxes(6).named("c"),
        scenes::soup(200, 0.5, 4).named("d"),
        scenes::none().named("e, empty"),
    ];
    // Later rounds find pooled buffers.
    for round in 0..2 {
        let mut pending: Vec<(usize, PendingBuild)> = scenes
            .iter()
            .map(|scene| backend.submit_build(&scene.mesh(), &BuildOptions::default()).unwrap())
            .enumerate()
            .collect();
        // Asked for in another order than they were submitted.
        pending.reverse();
        let mut built: Vec<(usize, DeviceBuild)> = Vec::new();
        let start = Instant::now();
        while !pending.is_empty() {
            assert!(start.elapsed() < PATIENCE, "round {round} hangs");
            pending.retain_mut(|(place, pending)| match pending.poll().expect("a build") {
                Some(done) => {
                    built.push((*place, done));
                    false
                }
                None => true,
            });
        }
        for (place, built) in built {
            let scene = &scenes[place];
            let expected = expected(scene, BuildConfig::default());
            assert_tree(&backend, &built, &expected.0, &format!("{}, round {round}", scene.name));
            assert_eq!(built.summary.large_levels, expected.1.large_levels, "{}", scene.name);
        }
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_build_that_nobody_asks_for_leaves_nothing_behind() {
    let backend = backend();
    let (large, small) = (scenes::soup(20_000, 0.05, 7), scenes::soup(1_500, 0.1, 8));
    for _ in 0..3 {
        drop(backend.submit_build(&large.mesh(), &BuildOptions::default()).unwrap());
        check(&backend, &small, BuildConfig::default());
        let mut polled = backend.submit_build(&large.mesh(), &BuildOptions::default()).unwrap();
        drop(polled.poll().unwrap());
        drop(polled);
        check(&backend, &small, BuildConfig::default());
    }
    check(&backend, &large, BuildConfig::default());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_outgrows_its_room_is_built_again() {
    let backend = backend();
    for scene in [scenes::fan(5_000), scenes::identical(8_000)] {
        let effort = check(&backend, &scene, BuildConfig::default());
        assert!(effort.repeats > 0, "{}: {effort:?}", scene.name);
        assert_eq!(effort.submissions, 1 + effort.repeats, "{}", scene.name);
        // The capacity is there now.
        let effort = check(&backend, &scene, BuildConfig::default());
        assert_eq!((effort.submissions, effort.repeats), (1, 0), "{}", scene.name);
    }
    // Without waiting, and with other scenes' capacities.
    let scene = scenes::fan(9_000);
    let backend = fresh();
    let mut pending = backend.submit_build(&scene.mesh(), &BuildOptions::default()).unwrap();
    let built = poll_until_done(&mut pending, "a build that overflows");
    assert!(built.effort.repeats > 0, "{:?}", built.effort);
    assert_tree(&backend, &built, &expected(&scene, BuildConfig::default()).0, "polled");
}

/// Room for one tree more is not the caller's business: with the host's copy too.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn an_overflow_behind_the_traits() {
    let backend = fresh();
    let scene = scenes::fan(6_000);
    let built = Backend::build(&backend, &scene.mesh(), &BuildOptions::default()).unwrap();
    assert!(*built.tree() == expected(&scene, BuildConfig::default()).0);
}

/// The pool remembers how many levels a scene took; a deeper one of as many triangles takes a second
/// submission.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_scene_deeper_than_the_last_one_is_finished_by_a_second_submission() {
    // With the middle stage only nodes of over 2,048 references are the levels' work, and the first submission must leave
    // that stage to the second. Where planes are found by bins there is no such stage.
    for (preset, triangles, size, halvings) in
        [(Preset::Fast, 20_000, 0.005, 15), (Preset::Balanced, 2_000, 0.02, 60)]
    {
        let config = preset.config();
        let shallow = scenes::soup(triangles, size, 9).named("shallow");
        // Two clusters of triangles, one much smaller than the other and far within it.
        let deep = deep(triangles, halvings);
        let levels = [&shallow, &deep].map(|scene| expected(scene, config).1.large_levels);
        assert!(levels[1] > levels[0] + 2, "{levels:?}: not deeper");
        let backend = fresh();
        let first = check(&backend, &shallow, config);
        assert_eq!((first.submissions, first.repeats), (1, 0));
        let built = backend.build_on_device(&deep.mesh(), &config.into()).unwrap();
        let expected = expected(&deep, config);
        assert_tree(&backend, &built, &expected.0, "deep after shallow");
        assert_eq!(built.effort.submissions, 2, "{:?}", built.effort);
        assert_eq!((built.effort.readbacks, built.effort.repeats), (2, 0), "{:?}", built.effort);
        assert_eq!(built.summary.large_levels, expected.1.large_levels);
        assert_eq!(built.summary.small_roots, expected.1.small_roots);
        // Now it is known; and from deep to shallow one suffices.
        assert_eq!(check(&backend, &deep, config).submissions, 1);
        assert_eq!(check(&backend, &shallow, config).submissions, 1);
        // The same without waiting.
        let mut pending = backend.submit_build(&deep.mesh(), &config.into()).unwrap();
        let built = poll_until_done(&mut pending, "the deep scene");
        assert_eq!(built.effort.submissions, 2, "{:?}", built.effort);
        assert_tree(&backend, &built, &expected.0, "polled");
    }
}

/// Triangles that come closer and closer to one corner, where they have shrunk so often to half: every level separates few.
fn deep(count: usize, halvings: u16) -> Scene {
    let soup = scenes::soup(count, 0.1, 10);
    let mut scene = soup.named("deep");
    let triangles = count as f32;
    for (i, corner) in scene.positions.iter_mut().enumerate() {
        let scale = 0.5f32.powf((i / 3) as f32 * f32::from(halvings) / triangles);
        *corner = corner.map(|x| x * scale);
    }
    scene
}

/// The old tree stands until the new one does; then its buffers are the next rebuild's. What is rebuilt by another
/// backend is replaced.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_rebuild_keeps_the_memory_of_the_tree_before() {
    let backend = backend();
    let options = BuildOptions::default();
    let scenes = [1, 2].map(|seed| scenes::soup(5_000, 0.1, seed));
    let buffers = |tree: &mut Box<dyn Accelerator>| {
        let own = tree.downcast_mut::<WgpuAccelerator>().expect("a tree on the device");
        let device = own.device_tree();
        [device.nodes(), device.leaf_references(), device.triangles()].map(Clone::clone)
    };
    let mut tree = backend.build(&scenes[0].mesh(), &options).unwrap();
    let first = buffers(&mut tree);
    backend.rebuild(&mut tree, &scenes[1].mesh(), &options).unwrap();
    let second = buffers(&mut tree);
    for (first, second) in first.iter().zip(&second) {
        assert_ne!(first, second);
    }
    assert_eq!(*tree.tree(), expected(&scenes[1], options.config).0);
    backend.rebuild(&mut tree, &scenes[0].mesh(), &options).unwrap();
    assert_eq!(buffers(&mut tree), first);
    assert_eq!(*tree.tree(), expected(&scenes[0], options.config).0);
    // An error leaves the tree and its buffers.
    let refused = BuildOptions { max_memory: Some(0), ..options };
    assert!(backend.rebuild(&mut tree, &scenes[1].mesh(), &refused).is_err());
    assert_eq!(buffers(&mut tree), first);
    let mut of_cpu = CpuBackend::new().build(&scenes[0].mesh(), &options).unwrap();
    assert!(of_cpu.downcast_mut::<WgpuAccelerator>().is_none());
    backend.rebuild(&mut of_cpu, &scenes[1].mesh(), &options).unwrap();
    assert_eq!(*of_cpu.tree(), expected(&scenes[1], options.config).0);
    assert!(of_cpu.downcast_mut::<WgpuAccelerator>().is_some());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn recycled_buffers_hold_nothing_stale() {
    let backend = backend();
    let options = BuildOptions::default();
    let scenes = [
        scenes::soup(9_000, 0.1, 11).named("large"),
        scenes::one(),
        scenes::soup(4_000, 0.3, 12).named("dense"),
        scenes::none(),
        scenes::grid_boxes(5),
        scenes::bad_vertices(),
        scenes::soup(65, 0.1, 13).named("small"),
        scenes::identical(1_500),
    ];
    let expected: Vec<KdTree> =
        scenes.iter().map(|scene| expected(scene, BuildConfig::default()).0).collect();
    let mut kept: Option<DeviceTree> = None;
    for round in 0..3 {
        for (place, scene) in scenes.iter().enumerate() {
            if let Some(tree) = kept.take() {
                backend.recycle(tree);
            }
            let built = backend.build_on_device(&scene.mesh(), &options).unwrap();
            let what = format!("{}, round {round}", scene.name);
            assert_tree(&backend, &built, &expected[place], &what);
            // Every other tree is dropped, and the next build makes new buffers.
            kept = (place % 3 != round % 2).then_some(built.tree);
        }
    }
    // An uploaded tree's buffers are as small as can be.
    let scene = &scenes[6];
    let loaded = DeviceTree::upload(
        backend.queries(),
        &expected[6].view(),
        scene.positions.as_chunks::<3>().0,
    );
    backend.recycle(loaded.unwrap());
    check(&backend, &scenes[0], BuildConfig::default());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn memory_that_is_not_allowed_is_not_taken() {
    let scene = scenes::soup(3_000, 0.1, 23);
    let mesh = scene.mesh();
    let whole = fresh().build_accelerator(&mesh, &BuildOptions::default()).unwrap();
    let peak = whole.summary().peak_bytes;
    for backend in [fresh(), backend()] {
        let (mut refused, mut enough) = (0, 0);
        for eighth in 0..=9 {
            let max_memory = Some(peak * eighth / 8);
            let options = BuildOptions { max_memory, ..Default::default() };
            match backend.build_accelerator(&mesh, &options) {
                Ok(built) => {
                    assert_eq!(*built.tree(), *whole.tree(), "a limit changes the tree");
                    let took = built.summary().peak_bytes;
                    assert!(Some(took) <= max_memory, "{took} bytes under {max_memory:?}");
                    // Less suffices where subtrees need not be kept, and without the middle stage.
                    assert!(eighth >= 8 || took < peak, "{eighth} eighths: {took} of {peak}");
                    enough += 1;
                }
                Err(BuildError::OutOfMemory { needed, limit }) => {
                    assert_eq!(Some(limit), max_memory);
                    assert!(needed > limit, "{needed} under {limit}");
                    assert!(eighth < 8, "{eighth} eighths: {needed} over {limit}, {peak}");
                    assert_eq!(enough, 0, "{eighth} eighths, and less sufficed");
                    refused += 1;
                }
                Err(other) => panic!("{other}"),
            }
        }
        assert!(refused >= 3 && enough >= 2, "{refused} refused, {enough} enough");
    }
    // Buffers of a larger scene are given up for the limit's sake.
    let backend = fresh();
    check(&backend, &scenes::soup(30_000, 0.02, 24), BuildConfig::default());
    let options = BuildOptions { max_memory: Some(peak), ..Default::default() };
    let built = backend.build_accelerator(&mesh, &options).expect("what suffices when fresh");
    assert!(built.summary().peak_bytes <= peak, "{} over {peak}", built.summary().peak_bytes);
    // A scene that outgrows what is allowed, in its second attempt.
    let fan = scenes::fan(5_000);
    let first = Some(peak * 2);
    let options = BuildOptions { max_memory: first, ..Default::default() };
    let error = fresh().build_accelerator(&fan.mesh(), &options).unwrap_err();
    let BuildError::OutOfMemory { needed, limit } = error else { panic!("{error}") };
    assert!(needed > limit && Some(limit) == first);
}

/// Positions that two bindings cannot hold, and triangles that they cannot.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_scene_over_the_limits_of_the_device_is_refused_by_name() {
    let backend = fresh();
    let limit_of = |mesh: &Mesh<'_>| match backend.build_on_device(mesh, &BuildOptions::default()) {
        Err(BuildError::Device(DeviceError::Limit { what, limit, needed, allowed })) => {
            assert_eq!(limit, "max_storage_buffer_binding_size");
            // Readers of a few elements in a row see a little of the second half with the first.
            assert_eq!(allowed, 2 * ((128 << 20) - 8192));
            assert!(needed > allowed, "{what}: {needed}");
            (what, needed)
        }
        Err(other) => panic!("{other}"),
        Ok(built) => panic!("{:?}", built.summary),
    };
    // Zeroed memory that nobody touches.
    let triangles = vec![[[0.0f32; 3]; 3]; 7_500_000];
    let (what, needed) = limit_of(&Mesh::soup(&triangles).unwrap());
    assert!(what.contains("Triangles"), "{what}");
    assert_eq!(needed, 36 * 7_500_000);
    let positions = vec![[0.0f32; 3]; 23_000_000];
    let (what, needed) = limit_of(&Mesh::indexed(&positions, &[[0, 1, 2]]).unwrap());
    assert!(what.contains("Input"), "{what}");
    assert_eq!(needed, 12 * 23_000_000 + 12);
    check(&backend, &scenes::soup(300, 0.1, 3), BuildConfig::default());
}

/// Room that grows with every attempt until the device cannot bind it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_scene_that_grows_over_the_limits_is_refused_by_name() {
    // Below what a backend asks for when it is opened, so that little work suffices.
    let binding = 1 << 18;
    let [(device, queue), _] = common::host_devices(&wgpu::Limits {
        max_storage_buffer_binding_size: binding,
        ..wgpu::Limits::default()
    });
    let backend = fresh_on(Gpu::borrow(device, queue));
    assert!(matches!(
        WgpuBackend::new(backend.gpu().clone()),
        Err(GpuError::Limit { limit: "max_storage_buffer_binding_size", .. })
    ));
    // Triangles that all cross one another: nearly every plane cuts nearly all.
    let scene = scenes::soup(3_000, 5.0, 25);
    match backend.build_on_device(&scene.mesh(), &BuildOptions::default()) {
        Err(BuildError::Device(DeviceError::Limit { limit, needed, allowed, .. })) => {
            // In two bindings.
            let both = 2 * (binding - 8192);
            assert_eq!((limit.as_str(), allowed), ("max_storage_buffer_binding_size", both));
            assert!(needed > allowed);
        }
        Err(other) => panic!("{other}"),
        Ok(built) => panic!("{:?}, {:?}", built.summary, built.effort),
    }
    check(&backend, &scenes::soup(300, 0.1, 3), BuildConfig::default());
}

/// The host's callback for errors panics unless the host sets one: nothing of ours may reach it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn what_wgpu_refuses_is_an_error_on_a_device_of_the_host() {
    let devices = common::host_devices(&wgpu::Limits::default());
    let [backend, other] = devices.map(|(device, queue)| fresh_on(Gpu::borrow(device, queue)));
    let (small, large) = (scenes::soup(300, 0.1, 26), scenes::soup(2_000, 0.1, 27));
    check(&backend, &small, BuildConfig::default());
    // Buffers of another device.
    let other = other.build_on_device(&large.mesh(), &BuildOptions::default()).unwrap();
    backend.recycle(other.tree);
    let refused = backend.build_on_device(&small.mesh(), &BuildOptions::default());
    assert!(
        matches!(refused, Err(BuildError::Device(DeviceError::Failed(_)))),
        "{:?}",
        refused.err()
    );
    check(&backend, &small, BuildConfig::default());
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn small_meshes_and_meshes_by_index() {
    let backend = backend();
    for scene in [scenes::none(), scenes::one(), scenes::all_bad()] {
        let built = Backend::build(&backend, &scene.mesh(), &BuildOptions::default()).unwrap();
        let expected = expected(&scene, BuildConfig::default());
        assert!(*built.tree() == expected.0, "{}", scene.name);
        assert_eq!(built.summary().dropped, expected.1.dropped, "{}", scene.name);
        let ray = Ray::new([0.3, 0.3, 5.0], [0.0, 0.0, -1.0]);
        let mut hit = [Hit { triangle: 7, ..Hit::MISS }];
        built.closest_hits(&[ray], &mut hit, &QueryOptions::default()).unwrap();
        assert_eq!(hit[0].is_hit(), scene.name == "one", "{}: {hit:?}", scene.name);
        assert_eq!(built.closest_hit(&ray, &QueryOptions::default()), hit[0].some());
        built.closest_hits(&[], &mut [], &QueryOptions::default()).unwrap();
    }
    for scene in [scenes::sphere(20, [0.5; 3], 1.0), scenes::grid_boxes(3), scenes::bad_vertices()]
    {
        let soup = scene.joined(&scenes::none(), "as soup");
        let indexed = backend.build_accelerator(&scene.mesh(), &BuildOptions::default()).unwrap();
        let separate = backend.build_accelerator(&soup.mesh(), &BuildOptions::default()).unwrap();
        assert_eq!(indexed.tree().digest(), separate.tree().digest(), "{}", scene.name);
        assert!(indexed.tree() == separate.tree(), "{}", scene.name);
        let [a, b]: [&[u8]; 2] =
            [indexed.triangles(), separate.triangles()].map(bytemuck::cast_slice);
        assert!(a == b, "{}: other corners", scene.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn bad_configurations_are_refused() {
    let config = BuildConfig { block_width: 0, ..Default::default() };
    let refused = Backend::build(&fresh(), &scenes::one().mesh(), &config.into());
    assert!(matches!(refused, Err(BuildError::Config(_))));
}

/// The preset `best` is built on the CPU alone: a device says so, however it is asked, and builds
/// nothing else in its place.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_preset_of_the_cpu_is_refused() {
    let backend = fresh();
    let scene = scenes::soup(300, 0.1, 18);
    let mesh = scene.mesh();
    let config = Preset::Best.config();
    let options = BuildOptions::from(config);
    let positions = backend.gpu().buffer("positions", 12, wgpu::BufferUsages::COPY_SRC).unwrap();
    let on_device = DeviceMesh { positions: &positions, vertices: 0, indices: None, triangles: 0 };
    let refusals: [Option<BuildError>; 6] = [
        Backend::build(&backend, &mesh, &options).err(),
        backend.build_on_device(&mesh, &options).err(),
        backend.submit_build(&mesh, &options).err(),
        backend.submit_build_from(&on_device, &options).err(),
        backend.build_profiled(&mesh, &options).err(),
        backend.with_executor(&mesh, &config, |_| ()).err(),
    ];
    for (way, refused) in refusals.into_iter().enumerate() {
        let expected = BuildError::PresetNotOnDevice { preset: Preset::Best };
        assert_eq!(refused, Some(expected), "way {way}");
    }
}

/// Presets by turns over the same buffers: each build is the CPU's by the same preset, and takes what
/// it needs. Bins are only where planes are found by them.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn presets_by_turns() {
    let scene = scenes::soup(3_000, 0.1, 19);
    let [fast, balanced] = [Preset::Fast, Preset::Balanced].map(Preset::config);
    let peak = |backend: &WgpuBackend, config: BuildConfig| {
        let built = backend.build_on_device(&scene.mesh(), &config.into()).expect("a tree");
        assert_tree(backend, &built, &expected(&scene, config).0, config.preset().name());
        // What the other preset took says nothing of this one: no level is missing.
        assert_eq!((built.effort.submissions, built.effort.repeats), (1, 0), "{config:?}");
        built.summary.peak_bytes
    };
    let [alone, with_bins] = [fast, balanced].map(|config| peak(&fresh(), config));
    let chunks = 3_000u64.div_ceil(256);
    let backend = fresh();
    assert_eq!(peak(&backend, fast), alone);
    // Bins come to what the other preset left, which has none; alone, bins need no pool of the middle stage.
    let both = peak(&backend, balanced);
    assert!(both >= alone + 768 * chunks, "{alone} and {both} bytes");
    assert!(both >= with_bins + 32 * 8 * 3_000, "{with_bins} and {both} bytes");
    for _ in 0..2 {
        peak(&backend, balanced);
        peak(&backend, BuildConfig { clip: false, ..balanced }.with_bins(5));
        peak(&backend, balanced.with_stages(|stages| stages.empty_cutoff = 128));
        peak(&backend, fast);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_tree_of_the_cpu_answers_like_one_built_here() {
    let backend = backend();
    let options = BuildOptions::default();
    for scene in
        [scenes::soup(3_000, 0.1, 14), scenes::bad_vertices(), scenes::zeros_and_subnormals()]
    {
        let mesh = scene.mesh();
        let rays = Rays::at(&scene, 400);
        let (tree, summary) = expected(&scene, BuildConfig::default());
        let loaded = backend.load(&mesh, tree.clone(), &options.for_loading()).unwrap();
        let built = Backend::build(&backend, &mesh, &options).unwrap();
        rays.check_accelerator(&*loaded, &format!("{}, loaded", scene.name));
        rays.check_accelerator(&*built, &format!("{}, built", scene.name));
        assert!(*loaded.tree() == tree);
        let [a, b] =
            [loaded.summary(), built.summary()].map(|s| (s.triangles, s.dropped, s.snapped));
        assert_eq!(a, b, "{}", scene.name);
        assert_eq!(a, (summary.triangles, summary.dropped, summary.snapped), "{}", scene.name);
    }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_tree_is_not_loaded_for_another_mesh_nor_into_too_little_memory() {
    let backend = fresh();
    let scene = scenes::soup(1_000, 0.1, 15);
    let (tree, _) = expected(&scene, BuildConfig::default());
    let mut moved = scene.clone();
    for corner in &mut moved.positions {
        corner[0] += 1.0;
    }
    let fewer = scenes::soup(999, 0.1, 15);
    let mut broken = tree.clone();
    broken.references.swap_remove(0);
    let options = BuildOptions::default();
    for (what, mesh, tree) in [
        ("moved", moved.mesh(), tree.clone()),
        ("fewer", fewer.mesh(), tree.clone()),
        ("broken", scene.mesh(), broken),
    ] {
        match backend.load(&mesh, tree, &options.for_loading()) {
            Err(BuildError::WrongMesh { reason }) => assert!(!reason.is_empty()),
            Err(other) => panic!("{what}: {other}"),
            Ok(_) => panic!("{what} is loaded"),
        }
    }
    let little = BuildOptions { max_memory: Some(1000), ..options };
    let Err(error) = backend.load(&scene.mesh(), tree.clone(), &little.for_loading()) else {
        panic!("loaded")
    };
    assert!(matches!(error, BuildError::OutOfMemory { needed, limit: 1000 } if needed > 1000));
    backend.load(&scene.mesh(), tree, &options.for_loading()).expect("the right mesh");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn threads_share_a_backend() {
    let backend = backend();
    let options = BuildOptions::default();
    let scenes = [
        scenes::soup(2_500, 0.1, 16).named("soup"),
        scenes::grid_boxes(5),
        scenes::fan(3_000),
        scenes::sphere(24, [0.5; 3], 1.0),
    ];
    let cases: Vec<(&Scene, KdTree, Rays)> = scenes
        .iter()
        .map(|scene| (scene, expected(scene, BuildConfig::default()).0, Rays::at(scene, 300)))
        .collect();
    let (backend, cases) = (&backend, &cases);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            scope.spawn(move || {
                for round in 0..6 {
                    let (scene, tree, rays) = &cases[(thread + round) % cases.len()];
                    let what = format!("{} on thread {thread}, round {round}", scene.name);
                    let mesh = scene.mesh();
                    match (thread + round) % 3 {
                        0 => {
                            let built = Backend::build(backend, &mesh, &options).expect(&what);
                            assert!(built.tree() == tree, "{what}");
                            rays.check_accelerator(&*built, &what);
                        }
                        1 => {
                            let built = backend.build_on_device(&mesh, &options).expect(&what);
                            assert_tree(backend, &built, tree, &what);
                            rays.check_tree(backend, &built.tree, &what);
                            backend.recycle(built.tree);
                        }
                        _ => {
                            let mut pending = backend.submit_build(&mesh, &options).expect(&what);
                            let built = poll_until_done(&mut pending, &what);
                            rays.check_tree(backend, &built.tree, &what);
                            assert_tree(backend, &built, tree, &what);
                        }
                    }
                }
            });
        }
    });
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn every_kernel_is_timed() {
    for preset in [Preset::Fast, Preset::Balanced] {
        check_times(preset.config());
    }
}

fn check_times(config: BuildConfig) {
    let backend = backend();
    let scene = scenes::soup(3_000, 0.1, 17);
    let options = BuildOptions::from(config);
    let built = backend.build_profiled(&scene.mesh(), &options).unwrap();
    assert_tree(&backend, &built, &expected(&scene, config).0, "profiled");
    let Some(times) = &built.times else {
        assert!(!backend.gpu().has_timestamps());
        return;
    };
    assert!(backend.gpu().has_timestamps());
    let not_run: &[Kernel] = match config.preset() {
        Preset::Balanced => &[
            Kernel::SplitMedian,
            Kernel::BuildMiddle,
            Kernel::ScanMiddle,
            Kernel::PlaceMiddle,
            Kernel::MeasureMiddle,
            Kernel::EmitMiddle,
        ],
        _ => &[Kernel::NodeBounds, Kernel::BinReferences, Kernel::SplitBinned],
    };
    let run: Vec<_> = Kernel::ALL.into_iter().filter(|kernel| !not_run.contains(kernel)).collect();
    assert_eq!(times.iter().map(|time| time.kernel).collect::<Vec<_>>(), run);
    for time in times {
        // Behind the three kernels of the start.
        let levels = times[3].dispatches;
        let by_level = (Kernel::SplitMedian as usize..=Kernel::ScatterReferences as usize)
            .contains(&(time.kernel as usize));
        assert_eq!(time.dispatches, if by_level { levels } else { 1 }, "{time:?}");
        assert!(time.nanoseconds.is_finite() && time.nanoseconds >= 0.0, "{time:?}");
    }
    let all: f64 = times.iter().map(|time| time.nanoseconds).sum();
    assert!(all > 0.0 && all < PATIENCE.as_nanos() as f64, "{all} ns");
    // What was not asked for is not measured.
    let plain = backend.build_on_device(&scene.mesh(), &options).unwrap();
    assert_eq!(plain.times, None);
}

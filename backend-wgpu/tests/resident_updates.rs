//! Scenes on a device whose geometries change: only what changed is sent, and hits stay those of all instances asked one after the other.
//! `SPLITPLANE_LONG=1` makes 4,000 updates in place of 120.

use core::ops::ControlFlow;
use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use crate::common::own_gpu;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::scene::packed::{PackedInstance, PackedScene, PackedTopNode};
use splitplane_core::backend::scene::{SceneAccelerator, UpdateReport};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::DeviceError;
use splitplane_core::layout::SceneBatch;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::Ray;
use splitplane_core::scene::{
    GeometryId, Instance, Scene, SceneBuildError, SceneHit, SceneOptions, translation,
};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::edits::edit;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;
use splitplane_wgpu::WgpuBackend;
use splitplane_wgpu::query::WgpuScene;

fn device() -> WgpuBackend {
    WgpuBackend::without_selftest(own_gpu())
}

/// A device and a scene whose geometries the CPU builds, which is the quicker way to many updates.
struct World {
    device: WgpuBackend,
    cpu: CpuBackend,
    built: WgpuScene,
}

impl World {
    fn new() -> World {
        let device = device();
        let built = device.build_wgpu_scene(&Scene::new(), &BuildOptions::default());
        World { built: built.expect("a scene"), cpu: CpuBackend::new(), device }
    }

    fn try_update(&mut self, scene: &Scene) -> Result<UpdateReport, SceneBuildError> {
        let World { device, cpu, built } = self;
        let before = device.gpu().traffic();
        let build =
            &mut |mesh: &Mesh<'_>, options: &BuildOptions<'_>| Backend::build(cpu, mesh, options);
        let report = built.update_by(scene, &BuildOptions::default(), build)?;
        let sent = device.gpu().traffic() - before;
        assert_eq!(sent.bytes_up, report.bytes_sent, "what is sent is counted");
        Ok(report)
    }

    fn update(&mut self, scene: &Scene) -> UpdateReport {
        let report = self.try_update(scene).expect("an update");
        assert_eq!(self.built.placed_by_cpu(), None);
        report
    }

    /// Bytes of the packed scene.
    fn all(&self) -> u64 {
        self.built.scene().packed_sizes().bytes().iter().sum()
    }

    /// The number of hits, which are right.
    fn check(&self, rays: &[Ray]) -> usize {
        let options = SceneOptions::default();
        let mut hits = vec![SceneHit { t: -7.0, ..SceneHit::MISS }; rays.len()];
        let report = self.built.closest_hits(rays, &mut hits, &options).expect("hits");
        assert_eq!(report.placed_by_cpu, 0);
        let words = |hit: &SceneHit| bytemuck::cast::<SceneHit, [u32; 6]>(*hit);
        for (ray, hit) in rays.iter().zip(&hits) {
            let all: SceneHit = self.built.scene().answer_by_all(ray, &options);
            assert_eq!(words(hit), words(&all), "{ray:?}");
        }
        hits.iter().filter(|hit| hit.is_hit()).count()
    }

    /// What the device holds, as the serial reference takes it.
    fn read_back(&self) -> PackedScene {
        let bindings = self.built.bindings().expect("on the device");
        let [box_nodes, instances, nodes, references, triangles, shapes, _] = bindings.buffers();
        let sizes = self.built.scene().packed_sizes();
        let mut top: Vec<PackedTopNode> = self.read(box_nodes);
        let mut named: Vec<PackedInstance> = self.read(instances);
        top.truncate(sizes.top_nodes);
        named.truncate(sizes.instances);
        PackedScene {
            box_nodes: top,
            instances: named,
            nodes: self.read(nodes),
            references: self.read(references),
            triangles: self.read(triangles),
            shapes: self.read(shapes),
        }
    }

    fn read<T: bytemuck::Pod>(&self, from: &wgpu::Buffer) -> Vec<T> {
        let gpu = self.device.gpu();
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let to = gpu.buffer("read back", from.size(), usage).expect("memory");
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(from, 0, &to, 0, from.size());
        gpu.submit([encoder.finish()]).expect("commands");
        to.map_async(wgpu::MapMode::Read, .., |result| result.expect("a mapped buffer"));
        gpu.device().poll(wgpu::PollType::wait_indefinitely()).expect("a device that works");
        let bytes = to.get_mapped_range(..).expect("a mapped buffer");
        let whole = bytes.len() / size_of::<T>() * size_of::<T>();
        bytemuck::pod_collect_to_vec(&bytes[..whole])
    }
}

/// A plane of so many triangles, with a wave in it.
fn sheet(triangles: usize, phase: f32) -> Vec<[[f32; 3]; 3]> {
    let at = |x: f32, y: f32| [x, y, 0.1 * (4.0 * x + phase).sin()];
    let one = |i: usize| {
        let (x, y) = ((i % 16) as f32 / 16.0, (i / 16) as f32 / 16.0);
        [at(x, y), at(x + 0.06, y), at(x, y + 0.06)]
    };
    (0..triangles).map(one).collect()
}

/// A scene of sheets of so many triangles, two instances each.
fn sheets(count: usize, triangles: usize) -> (Scene, Vec<GeometryId>) {
    let mut scene = Scene::new();
    let names = (0..count).map(|number| {
        let mesh = sheet(triangles, number as f32);
        let name = scene.add_mesh(&Mesh::soup(&mesh).expect("a mesh")).expect("a geometry");
        for z in [0.0, 1.0] {
            let place = translation([(number % 8) as f32, (number / 8) as f32, z]);
            scene.add_instance(Instance::new(name, place)).expect("an instance");
        }
        name
    });
    let names = names.collect();
    (scene, names)
}

/// Bytes of one of the geometries among all.
fn own_bytes(world: &World, name: GeometryId) -> u64 {
    let geometry = world.built.scene().geometry(name).expect("a geometry");
    let (tree, triangles) = (geometry.accelerator().tree(), geometry.mesh().mesh().len());
    (8 * tree.nodes.len() + 4 * tree.references.len() + 36 * triangles) as u64
}

/// Moved vertices of one geometry of many are sent with its tree, its instances and the nodes above them. All is counted.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn one_of_many_sends_its_own_bytes() {
    let mut world = World::new();
    let (mut scene, names) = sheets(64, 200);
    let report = world.update(&scene);
    assert_eq!(report.bytes_sent, world.all());
    let exact = world.built.bytes_on_device();
    assert!(exact < world.all() + 64, "{exact}");
    let rays = objects::rays(&scene, 100, 5);
    for step in 1..8 {
        let mesh = sheet(200, step as f32 * 0.37);
        let name = names[step * 5];
        scene.replace_mesh(name, &Mesh::soup(&mesh).expect("a mesh")).expect("an edit");
        let report = world.update(&scene);
        // Two instances, and at most all nodes of three levels above them.
        let most = own_bytes(&world, name) + 2 * 128 + 6 * 256;
        assert!(report.bytes_sent <= most, "{step}: {report:?}, {most}");
        assert!(report.bytes_sent >= own_bytes(&world, name), "{step}: {report:?}");
        assert!(report.bytes_sent < world.all() / 30, "{step}: {report:?}");
        assert!(world.check(&rays) > 20);
    }
    // Room for what grew, and not much more.
    let held = world.built.bytes_on_device();
    assert!(held >= exact && held < exact * 3 / 2, "{held}, {exact}");
    // One that is new sends itself; instances that come make the tree over them anew.
    let extra = sheet(50, 3.0);
    let name = scene.add_mesh(&Mesh::soup(&extra).expect("a mesh")).expect("a geometry");
    let report = world.update(&scene);
    assert_eq!(report.bytes_sent, own_bytes(&world, name));
    // One that goes sends nothing.
    scene.remove_geometry(name).expect("an edit");
    assert_eq!(world.update(&scene).bytes_sent, 0);
    assert!(world.check(&rays) > 20);
}

/// Updates of vertices that move every frame come to an end of growing: no memory is made, and nothing else is sent.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn frames_make_no_memory() {
    let mut world = World::new();
    let (mut scene, names) = sheets(16, 300);
    world.update(&scene);
    let mut made = Vec::new();
    for frame in 0..24 {
        for &name in &names[..4] {
            let mesh = sheet(300, frame as f32 * 0.7 + name.0 as f32);
            scene.replace_mesh(name, &Mesh::soup(&mesh).expect("a mesh")).expect("an edit");
        }
        let before = world.device.gpu().traffic();
        let report = world.update(&scene);
        made.push((world.device.gpu().traffic() - before).buffers);
        assert!(report.bytes_sent < world.all() / 2, "{report:?}");
    }
    assert!(made[12..].iter().all(|made| *made == 0), "{made:?}");
    assert!(world.check(&objects::rays(&scene, 60, 6)) > 10);
}

/// Room of which more than half is free is given back, and everything is sent once.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn free_room_is_given_back() {
    let mut world = World::new();
    let (mut scene, names) = sheets(24, 200);
    world.update(&scene);
    let full = world.built.bytes_on_device();
    let mut sent_all = 0;
    for &name in &names[..20] {
        let instances: Vec<_> = scene
            .instances()
            .filter(|(_, own)| own.geometry == name)
            .map(|(name, _)| name)
            .collect();
        for instance in instances {
            scene.remove_instance(instance).expect("an edit");
        }
        scene.remove_geometry(name).expect("an edit");
        let report = world.update(&scene);
        sent_all += usize::from(report.bytes_sent == world.all());
        let room = world.built.bytes_on_device();
        assert!(room <= 3 * world.all() || room < 16 << 10, "{room}, {}", world.all());
        world.check(&objects::rays(&scene, 10, u64::from(name.0)));
    }
    assert!((1..6).contains(&sent_all), "{sent_all}");
    assert!(world.built.bytes_on_device() < full / 3);
}

/// Random edits: hits of the device's kernels, and of the serial reference on what the device holds.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_after_random_edits_are_those_of_all_instances() {
    let long = std::env::var_os("SPLITPLANE_LONG").is_some_and(|value| value == "1");
    let (mut hits, mut partly, mut all_again) = (0, 0, 0);
    let batch = SceneBatch {
        count: 0,
        culling: 0,
        mask: u32::MAX,
        ignored_instance: u32::MAX,
        ignored_triangle: 0,
        any: 0,
        zero: 0,
        way: 0,
    };
    let mut world = World::new();
    for seed in 0..if long { 100 } else { 3 } {
        let mut random = Random::new(7000 + seed);
        let (mut scene, names) = objects::scene(Kind::Ordinary, 12, seed);
        if seed.is_multiple_of(2) {
            objects::add_shapes(&mut scene, &names, seed);
        }
        for step in 0..40 {
            let report = world.update(&scene);
            partly += usize::from(report.bytes_sent > 0 && report.bytes_sent < world.all() / 2);
            all_again += usize::from(report.bytes_sent >= world.all());
            let rays = objects::rays(&scene, 48, seed ^ step << 8);
            hits += world.check(&rays);
            if step.is_multiple_of(4) {
                let held = world.read_back();
                for ray in &rays {
                    let all: SceneHit =
                        world.built.scene().answer_by_all(ray, &SceneOptions::default());
                    assert_eq!(held.trace::<Strict>(ray, &batch), all, "{seed}, {step}, {ray:?}");
                }
            }
            for _ in 0..1 + random.below(3) {
                edit(&mut scene, &mut random);
            }
        }
    }
    println!("{hits} hits, {partly} updates of less than half, {all_again} of all");
    assert!(hits > 1_000 && partly > 60 && (1..40).contains(&all_again), "{hits} {partly}");
}

/// A driver that refuses the memory for what grows leaves the old scene; with memory the update is made.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn refused_memory_leaves_the_old_scene() {
    let mut world = World::new();
    let (mut scene, names) = sheets(8, 200);
    world.update(&scene);
    let rays = objects::rays(&scene, 60, 8);
    let (before, digest) = (world.check(&rays), world.built.scene().digest());
    let large = scenes::soup(3_000, 0.2, 4);
    scene.replace_mesh(names[3], &large.mesh()).expect("an edit");
    let most = world.built.scene().packed_sizes().bytes()[4];
    world.device.gpu().plant_memory(most);
    let error = world.try_update(&scene).unwrap_err();
    assert!(matches!(error, SceneBuildError::Device(DeviceError::OutOfMemory { .. })), "{error}");
    assert_eq!((world.built.placed_by_cpu(), world.built.scene().digest()), (None, digest));
    assert_eq!(world.check(&rays), before);
    // A smaller one still finds room where it is.
    scene.replace_mesh(names[3], &Mesh::soup(&sheet(100, 1.0)).unwrap()).expect("an edit");
    let report = world.update(&scene);
    assert!(report.bytes_sent < world.all() / 4, "{report:?}");
    world.check(&rays);
    world.device.gpu().plant_memory(u64::MAX);
    scene.replace_mesh(names[3], &large.mesh()).expect("an edit");
    world.update(&scene);
    assert!(world.check(&objects::rays(&scene, 100, 9)) > 20);
}

/// A limit of memory that holds no room to spare: what is needed is there all the same.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn tight_limits_have_no_room_to_spare() {
    let mut world = World::new();
    let (old, names) = sheets(64, 200);
    world.update(&old);
    let (mut scene, _) = sheets(64, 200);
    // The others are the same meshes.
    for &name in names.iter().filter(|name| **name != names[2]) {
        scene.share_geometry(name, &old, name).expect("an edit");
    }
    let mesh = sheet(256, 2.0);
    scene.replace_mesh(names[2], &Mesh::soup(&mesh).expect("a mesh")).expect("an edit");
    world.update(&scene);
    // The new scene on the host and on the device to the byte, where the buffer for shapes, of which there are none, has 16.
    let enough = world.built.scene().bytes() + world.all() + 16;
    for (less, is_there) in [(1, false), (0, true)] {
        let max_memory = Some(enough - less);
        let options = BuildOptions { max_memory, ..BuildOptions::default() };
        let mut fresh = World::new();
        fresh.update(&old);
        let cpu = CpuBackend::new();
        let build =
            &mut |mesh: &Mesh<'_>, options: &BuildOptions<'_>| Backend::build(&cpu, mesh, options);
        fresh.built.update_by(&scene, &options, build).expect("an update");
        assert_eq!(fresh.built.placed_by_cpu().is_none(), is_there, "{less}");
    }
}

/// Where very many geometries change, the search for their places can be cancelled anywhere: the old scene stays, on the device.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_watch_ends_the_search_for_places() {
    let mut world = World::new();
    let mut scene = Scene::new();
    let (small, large) = (sheet(1, 0.0), sheet(2, 0.0));
    let names: Vec<_> = (0..4000)
        .map(|_| scene.add_mesh(&Mesh::soup(&small).expect("a mesh")).expect("a geometry"))
        .collect();
    scene.add_instance(Instance::in_place(names[0])).expect("an instance");
    world.update(&scene);
    let rays = objects::rays(&scene, 60, 8);
    let (before, digest) = (world.check(&rays), world.built.scene().digest());
    for &name in names.iter().step_by(2) {
        scene.replace_mesh(name, &Mesh::soup(&large).expect("a mesh")).expect("an edit");
    }
    // Ends it at one of the calls that come when all trees are built: the first is before instances are placed, the others are among places.
    let mut ended_at = |last: u64| {
        let seen = AtomicU64::new(0);
        let watch =
            |own: &Progress| match own.done < own.total || seen.fetch_add(1, Relaxed) + 1 < last {
                true => ControlFlow::Continue(()),
                false => ControlFlow::Break(()),
            };
        let World { cpu, built, .. } = &mut world;
        let build = &mut |mesh: &Mesh<'_>, options: &BuildOptions<'_>| {
            Backend::build(cpu, mesh, &options.unwatched())
        };
        let options = BuildOptions { watch: Some(&watch), ..BuildOptions::default() };
        let told = built.update_by(&scene, &options, build);
        if told.is_err() {
            assert_eq!((built.placed_by_cpu(), built.scene().digest()), (None, digest));
        }
        (told, seen.into_inner())
    };
    let mut calls = 0;
    loop {
        let (told, seen) = ended_at(calls + 1);
        if told.is_ok() {
            break;
        }
        assert!(matches!(told, Err(SceneBuildError::Cancelled { .. })), "{told:?}");
        calls += 1;
        assert_eq!(seen, calls);
    }
    assert!(calls > 3, "{calls}");
    assert!(before > 0 && world.check(&rays) > 0);
    assert_ne!(world.built.scene().digest(), digest);
}

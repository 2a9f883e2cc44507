//! Scenes that are wholly on a device: the answers of all instances asked one after the other, bit for bit; what updates send; what
//! happens where the device has no room. `SPLITPLANE_LONG=1` casts 1,080,000 rays in place of 7,200, through ten scenes of each
//! kind, each of them with four settings.

use crate::common::{hostile, odd_rays::odd, own_gpu};
use splitplane_core::backend::scene::packed::PackedInstance;
use splitplane_core::backend::scene::{SceneAccelerator, TopUpdate};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::kernel::QueryKernel;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::{
    IgnoredTriangle, Instance, InstanceId, OpacityMask, Scene, SceneBuildError, SceneHit,
    SceneOptions, SceneReport, translation,
};
use splitplane_cpu::CpuBackend;
use splitplane_shaders::TriangleTest;
use splitplane_test_support::objects::{self, Kind};
use splitplane_test_support::random::Random;
use splitplane_wgpu::WgpuBackend;

fn device() -> WgpuBackend {
    WgpuBackend::new(own_gpu()).expect("a backend")
}

type Answers = Vec<([u32; 6], bool)>;

fn answers(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> (Answers, SceneReport) {
    let mut hits = vec![SceneHit { t: -7.0, ..SceneHit::MISS }; rays.len()];
    let mut report = scene.closest_hits(rays, &mut hits, options).expect("hits");
    let mut any = vec![true; rays.len()];
    report.add(scene.any_hits(rays, &mut any, options).expect("hits")).expect("a sum");
    (hits.iter().map(|hit| bytemuck::cast(*hit)).zip(any).collect(), report)
}

fn expected(scene: &dyn SceneAccelerator, rays: &[Ray], options: &SceneOptions<'_>) -> Answers {
    let scene = scene.scene();
    let closest = |ray| bytemuck::cast(scene.answer_by_all::<SceneHit>(ray, options));
    rays.iter().map(|ray| (closest(ray), scene.answer_by_all(ray, options))).collect()
}

fn asked(names: &[InstanceId]) -> [SceneOptions<'static>; 4] {
    let all = SceneOptions::default();
    let ignore = Some(IgnoredTriangle { instance: names[3], triangle: 2 });
    [
        all,
        SceneOptions { culling: Culling::Back, ..all },
        SceneOptions { culling: Culling::Front, mask: 0x0f0f_00ff, ..all },
        SceneOptions { ignore, mask: 0x8000_0001, ..all },
    ]
}

/// How many scenes of each kind, and how many rays go through each by each setting, a sixth of them odd ones.
fn how_many() -> (u64, usize) {
    let long = std::env::var_os("SPLITPLANE_LONG").is_some_and(|value| value == "1");
    if long { (10, 18_000) } else { (1, 1_200) }
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_are_those_of_all_instances() {
    let (device, cpu) = (device(), CpuBackend::new());
    let (scenes, count) = how_many();
    let (mut found, mut all_entered, mut asked_in_all) = (0, 0, 0);
    for round in 0..scenes {
        for (number, kind) in Kind::ALL.into_iter().enumerate() {
            let seed = 1000 * round + number as u64;
            let (scene, names) = objects::scene(kind, 60, 800 + seed);
            let mut rays = objects::rays(&scene, count / 6 * 5, 900 + seed);
            rays.extend(odd(&rays[..count / 6]));
            let build = BuildOptions::default();
            let built = device.build_scene(&scene, &build).expect("a scene");
            assert_eq!(built.placed_by_cpu(), None);
            let on_cpu = cpu.build_scene(&scene, &build).expect("a scene");
            for options in asked(&names) {
                let (all, _) = answers(&*on_cpu, &rays, &options);
                // All instances one after the other take much longer, so not for all rays of many.
                let step = rays.len() / 1_200;
                let few: Vec<Ray> = rays.iter().step_by(step).copied().collect();
                for (i, one) in expected(&*built, &few, &options).into_iter().enumerate() {
                    assert_eq!(one, all[i * step], "{kind:?} {:?} {options:?}", few[i]);
                }
                let (own, report) = answers(&*built, &rays, &options);
                for (i, ray) in rays.iter().enumerate() {
                    assert_eq!(own[i], all[i], "{kind:?} {ray:?} {options:?}");
                }
                assert_eq!((report.placed_by_cpu, report.batches), (0, 0));
                assert_eq!(report.geometries.answered_by_cpu, report.geometries.unfinished);
                assert!(report.geometries.unfinished < rays.len() as u64 / 10, "{report:?}");
                all_entered += report.entered;
                found += all.iter().filter(|(_, any)| *any).count();
                asked_in_all += rays.len();
            }
        }
        println!("{asked_in_all} rays, {found} hits, {all_entered} instances entered");
    }
    assert!(found > asked_in_all / 5 && all_entered > asked_in_all as u64, "{found} {all_entered}");
}

/// Masks of all bits on all instances, and rays of any mask.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn masks_are_those_of_instances_and_rays() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Coincident, 80, 91);
    let mut random = Random::new(92);
    for name in &names {
        // Few bits, so that most instances are out of most masks.
        scene.set_mask(*name, random.bits() & random.bits() & random.bits()).expect("an edit");
    }
    let rays = objects::rays(&scene, 400, 93);
    let built = device.build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let mut seen = std::collections::BTreeSet::new();
    for round in 0..12u32 {
        let mask = match round {
            0 => 0,
            1 => u32::MAX,
            2 => 1 << 31,
            _ => random.bits() & random.bits(),
        };
        let options = SceneOptions { mask, ..SceneOptions::default() };
        let all = expected(&*built, &rays, &options);
        assert!(answers(&*built, &rays, &options).0 == all, "{mask:#x}");
        seen.insert(all.iter().filter(|(_, any)| *any).count());
    }
    assert!(seen.len() > 8 && seen.first() == Some(&0), "{seen:?}");
}

/// What the device does not answer alone is answered in waves, and counted.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn exact_answers_and_filters_are_placed_by_the_cpu() {
    let device = device();
    let (scene, _) = objects::scene(Kind::Ordinary, 30, 5);
    let rays = objects::rays(&scene, 300, 6);
    let built = device.build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let even = |hit: &SceneHit| hit.triangle.is_multiple_of(2);
    for options in [
        SceneOptions { accuracy: Accuracy::Exact, ..SceneOptions::default() },
        SceneOptions { filter: Some(&even), ..SceneOptions::default() },
    ] {
        let (own, report) = answers(&*built, &rays, &options);
        assert_eq!(own, expected(&*built, &rays, &options));
        assert_eq!(report.placed_by_cpu, 2 * rays.len() as u64);
    }
}

/// Scenes without instances, without triangles, and with one of a name that was given up.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn scenes_with_nothing_in_them() {
    let device = device();
    let (full, names) = objects::scene(Kind::Ordinary, 12, 31);
    let rays = objects::rays(&full, 200, 32);
    let options = SceneOptions::default();
    let mut built = device.build_scene(&Scene::new(), &BuildOptions::default()).expect("a scene");
    let none =
        |hit: &([u32; 6], bool)| !hit.1 && hit.0 == bytemuck::cast::<_, [u32; 6]>(SceneHit::MISS);
    assert!(answers(&*built, &rays, &options).0.iter().all(none));
    let build = &BuildOptions::default();
    device.update_scene(&mut *built, &full, build).expect("an update");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    let mut few = full;
    for name in &names[..11] {
        few.remove_instance(*name).expect("an instance");
    }
    device.update_scene(&mut *built, &few, build).expect("an update");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    few.remove_instance(names[11]).expect("an instance");
    device.update_scene(&mut *built, &few, build).expect("an update");
    assert!(answers(&*built, &rays, &options).0.iter().all(none));
    assert_eq!(built.placed_by_cpu(), None);
}

/// An update sends what changed and nothing else.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn updates_send_what_changed() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Ordinary, 1000, 41);
    let rays = objects::rays(&scene, 300, 42);
    let build = BuildOptions::default();
    let mut built = device.build_scene(&scene, &build).expect("a scene");
    let sizes = built.scene().packed_sizes();
    let all: u64 = sizes.bytes().iter().sum();
    let own = scene.instance(names[500]).expect("an instance").transform;
    let nothing = device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(nothing.bytes_sent, 0);
    for step in 0..4 {
        let mut becomes = own;
        becomes[0][3] += 0.125 * step as f32 + 0.125;
        scene.move_instance(names[500], becomes).expect("an edit");
        let before = device.gpu().traffic();
        let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
        let sent = device.gpu().traffic() - before;
        assert_eq!(sent.bytes_up, report.bytes_sent);
        assert_eq!(sent.buffers, 0, "no memory is made");
        // One instance, and the nodes above it.
        let most = 128 + 8 * 256 * report.top_nodes_changed;
        assert!((128..=most).contains(&report.bytes_sent), "{report:?}");
        assert!(report.bytes_sent < all / 20, "{report:?} of {all}");
        let options = SceneOptions::default();
        assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    }
    scene.remove_instance(names[7]).expect("an instance");
    let geometry = scene.instance(names[8]).expect("an instance").geometry;
    let sphere = splitplane_test_support::scenes::sphere(10, [0.5; 3], 0.75);
    scene.replace_mesh(geometry, &sphere.mesh()).expect("an edit");
    let before = device.gpu().traffic();
    let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    let sent = (device.gpu().traffic() - before).bytes_up;
    // The geometry's own tree is sent besides, and all of the tree over instances.
    let now: u64 = built.scene().packed_sizes().bytes().iter().sum();
    assert!(report.bytes_sent < now && sent > report.bytes_sent, "{report:?} of {now}");
    let options = SceneOptions::default();
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    scene.move_instance(names[9], translation([0.5; 3])).expect("an edit");
    device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
}

/// A driver that refuses memory ends an update in an error, and the old scene answers; so does a geometry that is not built.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_failed_update_leaves_the_old_scene() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 61);
    let rays = objects::rays(&scene, 300, 62);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    let mut built = device.build_scene(&scene, &build).expect("a scene");
    let before = expected(&*built, &rays, &options);
    let digest = built.scene().digest();
    for i in 0..200u16 {
        let instance = *scene.instance(names[usize::from(i) % 40]).expect("an instance");
        scene.add_instance(instance).expect("an instance");
    }
    let most = built.scene().packed_sizes().bytes()[1];
    device.gpu().plant_memory(most);
    let error = device.update_scene(&mut *built, &scene, &build).unwrap_err();
    let SceneBuildError::Device(DeviceError::OutOfMemory { what, needed }) = &error else {
        panic!("{error:?}")
    };
    assert!(what == "the tree over instances" && *needed > most, "{error}");
    let mut cancelled = 0;
    let none = &mut |_: &Mesh<'_>, _: &BuildOptions<'_>| {
        cancelled += 1;
        Err(BuildError::WrongMesh { reason: "planted".into() })
    };
    device.gpu().plant_memory(u64::MAX);
    scene.add_mesh(&splitplane_test_support::scenes::one().mesh()).expect("a geometry");
    assert!(built.update_by(&scene, &build, none).is_err());
    assert_eq!(cancelled, 1);
    assert_eq!((built.scene().digest(), built.placed_by_cpu()), (digest, None));
    assert_eq!(answers(&*built, &rays, &options).0, before);
    device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
}

/// A worn tree over instances that is built anew and has more nodes gets the room that it needs. Where the device has none, the CPU
/// places rays until there is some.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_tree_over_instances_may_grow_when_it_is_worn() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Coincident, 300, 111);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    for name in &names {
        scene.move_instance(*name, translation([0.5; 3])).expect("an edit");
    }
    let mut built = device.build_scene(&scene, &build).expect("a scene");
    let before = built.scene().packed_sizes();
    let mut random = Random::new(112);
    for name in &names {
        let far = [0, 1, 2].map(|_| 500.0 * (random.unit() as f32 - 0.5));
        scene.move_instance(*name, translation(far)).expect("an edit");
    }
    let rays = objects::rays(&scene, 300, 113);
    device.gpu().plant_memory(before.bytes()[0]);
    let mut report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(report.top, TopUpdate::Rebuilt);
    let after = built.scene().packed_sizes();
    assert!(after.top_nodes > before.top_nodes && after.instances == before.instances, "{after:?}");
    let reason = built.placed_by_cpu().expect("no room").to_owned();
    assert!(reason.contains("the tree over instances"), "{reason}");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    device.gpu().plant_memory(u64::MAX);
    let mut built = device.build_scene(&Scene::new(), &build).expect("a scene");
    for name in &names {
        scene.move_instance(*name, translation([0.5; 3])).expect("an edit");
    }
    device.update_scene(&mut *built, &scene, &build).expect("an update");
    random = Random::new(112);
    for name in &names {
        let far = [0, 1, 2].map(|_| 500.0 * (random.unit() as f32 - 0.5));
        scene.move_instance(*name, translation(far)).expect("an edit");
    }
    report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!((report.top, built.placed_by_cpu()), (TopUpdate::Rebuilt, None));
    assert_eq!(report.bytes_sent, after.bytes()[..2].iter().sum::<u64>());
    let (own, report) = answers(&*built, &rays, &options);
    assert_eq!((own, report.placed_by_cpu), (expected(&*built, &rays, &options), 0));
}

/// Opacity masks of all levels: hits count in opaque cells, as on the CPU.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn opacity_masks_are_those_of_the_cpu() {
    let (device, cpu) = (device(), CpuBackend::new());
    let (scenes, count) = how_many();
    let (mut found, mut other, mut rejected) = (0, 0, 0);
    for round in 0..scenes {
        for (number, kind) in Kind::ALL.into_iter().enumerate() {
            let seed = 1000 * round + number as u64;
            let (mut scene, names) = objects::scene(kind, 60, 1800 + seed);
            let mut rays = objects::rays(&scene, count / 6 * 5, 1900 + seed);
            rays.extend(odd(&rays[..count / 6]));
            let build = BuildOptions::default();
            let plain = cpu.build_scene(&scene, &build).expect("a scene");
            objects::mask(&mut scene, 2000 + seed);
            let built = device.build_scene(&scene, &build).expect("a scene");
            assert_eq!(built.placed_by_cpu(), None);
            let on_cpu = cpu.build_scene(&scene, &build).expect("a scene");
            for options in asked(&names) {
                let (all, counted) = answers(&*on_cpu, &rays, &options);
                let (unmasked, _) = answers(&*plain, &rays, &options);
                let (own, report) = answers(&*built, &rays, &options);
                for (i, ray) in rays.iter().enumerate() {
                    assert_eq!(own[i], all[i], "{kind:?} {ray:?} {options:?}");
                }
                assert_eq!(report.placed_by_cpu, 0);
                assert!(report.geometries.unfinished < rays.len() as u64 / 10, "{report:?}");
                // What masks reject is counted on the CPU alone.
                assert_eq!(report.rejected, 0);
                rejected += counted.rejected;
                found += all.iter().filter(|(_, any)| *any).count();
                other += (0..rays.len()).filter(|&i| all[i] != unmasked[i]).count();
            }
        }
    }
    println!("{found} hits, {other} rays with other answers than without masks");
    assert!(found > count * 4 && other > count / 2, "{found} {other}");
    assert!(rejected > other as u64 / 2, "{rejected}");
}

/// A mask that comes, changes or goes is sent with its geometry and its instances; what only the description's other parts say is not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn masks_that_change_are_sent() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 121);
    let rays = objects::rays(&scene, 300, 122);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    let mut built = device.build_scene(&scene, &build).expect("a scene");
    let hit = |hit: &([u32; 6], bool)| bytemuck::cast::<_, SceneHit>(hit.0);
    let first = expected(&*built, &rays, &options).iter().map(hit).find(SceneHit::is_hit);
    let geometry =
        scene.instance(InstanceId(first.expect("a hit").instance)).expect("one").geometry;
    let triangles = scene.geometry(geometry).expect("a geometry").mesh().len();
    let mut seen = Vec::new();
    for odd in [Some(0), Some(1), None] {
        let mask = odd.map(|odd| OpacityMask::new(triangles, 4, |own, _| own % 2 == odd));
        scene.set_opacity(geometry, mask.map(|mask| mask.expect("a mask"))).expect("an edit");
        let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
        let own = built.scene().geometry(geometry).expect("a geometry");
        let words = own.opacity().map_or(0, |mask| 2 + mask.words().len());
        let (tree, triangles) = (own.accelerator().tree(), own.mesh().mesh().len());
        let bytes = 8 * tree.nodes.len() + 4 * (tree.references.len() + words) + 36 * triangles;
        // Instances know where a mask lies.
        let most = bytes + 40 * size_of::<PackedInstance>();
        let sent = report.bytes_sent as usize;
        assert!((bytes..=most).contains(&sent), "{report:?}, {bytes}");
        let (own, answered) = answers(&*built, &rays, &options);
        assert_eq!((&own, answered.placed_by_cpu), (&expected(&*built, &rays, &options), 0));
        seen.push(own);
        scene.move_instance(names[3], translation([0.25; 3])).expect("an edit");
        let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
        assert!(report.bytes_sent < 10_000, "{report:?}");
        assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2] && seen[2] != seen[0]);
}

/// Spheres and capsules among meshes, with opacity masks and without: the CPU's hits.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn shapes_are_hit_as_on_the_cpu() {
    let (device, cpu) = (device(), CpuBackend::new());
    let (scenes, count) = how_many();
    let mut round_hits = 0;
    for round in 0..scenes {
        for (number, kind) in Kind::ALL.into_iter().enumerate() {
            let seed = 1000 * round + number as u64;
            let (mut scene, names) = objects::scene(kind, 60, 2800 + seed);
            let meshes = scene.geometries().count() as u32;
            let mut rays = objects::rays(&scene, count / 6 * 5, 2900 + seed);
            rays.extend(odd(&rays[..count / 6]));
            if number % 2 == 1 {
                objects::mask(&mut scene, 3000 + seed);
            }
            objects::add_shapes(&mut scene, &names, 3100 + seed);
            let build = BuildOptions::default();
            let built = device.build_scene(&scene, &build).expect("a scene");
            assert_eq!(built.placed_by_cpu(), None);
            let on_cpu = cpu.build_scene(&scene, &build).expect("a scene");
            let mut all_options = asked(&names);
            all_options[3].ignore = Some(IgnoredTriangle { instance: names[0], triangle: 2 });
            for options in all_options {
                let (all, _) = answers(&*on_cpu, &rays, &options);
                let (own, report) = answers(&*built, &rays, &options);
                for (i, ray) in rays.iter().enumerate() {
                    assert_eq!(own[i], all[i], "{kind:?} {ray:?} {options:?}");
                }
                assert_eq!(report.placed_by_cpu, 0);
                assert!(report.geometries.unfinished < rays.len() as u64 / 10, "{report:?}");
                round_hits += all.iter().filter(|(hit, any)| *any && hit[4] >= meshes).count();
            }
        }
    }
    println!("{round_hits} hits with shapes");
    assert!(round_hits > count / 2, "{round_hits}");
}

/// Shapes that come, move and go.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn shapes_come_and_go() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 121);
    let rays = objects::rays(&scene, 300, 122);
    let (build, options) = (BuildOptions::default(), SceneOptions::default());
    let mut built = device.build_scene(&scene, &build).expect("a scene");
    let same = |built: &dyn SceneAccelerator| {
        let (own, report) = answers(built, &rays, &options);
        assert_eq!((own, report.placed_by_cpu), (expected(built, &rays, &options), 0));
    };
    let meshes: Vec<Instance> =
        names.iter().map(|name| *scene.instance(*name).expect("an instance")).collect();
    objects::add_shapes(&mut scene, &names, 123);
    let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    let bytes = built.scene().packed_sizes().bytes();
    // Sets of shapes have a node each besides.
    let most = bytes[0] + bytes[1] + bytes[5] + 4 * 8;
    assert!((bytes[5]..=most).contains(&report.bytes_sent), "{report:?}, {bytes:?}");
    same(&*built);
    scene.move_instance(names[3], translation([0.25; 3])).expect("an edit");
    let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert!(report.bytes_sent < 10_000, "{report:?}");
    same(&*built);
    for (name, own) in names.iter().zip(meshes) {
        scene.set_instance(*name, own).expect("an edit");
    }
    device.update_scene(&mut *built, &scene, &build).expect("an update");
    same(&*built);
}

/// Rays enter more instances than one submission has waves for, and each is counted; with so many hits that they are not
/// copied in each of them.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn all_that_is_entered_is_counted() {
    const ROW: u32 = 40;
    let mut scene = Scene::new();
    let corners = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let geometry = scene.add_mesh(&Mesh::soup(&corners).expect("a mesh")).expect("a geometry");
    for i in 0..ROW {
        let transform = translation([0.0, 0.0, i as f32]);
        scene.add_instance(Instance::new(geometry, transform)).expect("an instance");
    }
    let built = device().build_scene(&scene, &BuildOptions::default()).expect("a scene");
    for count in [10, 7_000] {
        let rays = vec![Ray::new([0.25, 0.25, -1.0], [0.0, 0.0, 1.0]); count];
        let mut hits = vec![SceneHit::MISS; count];
        // From behind: none of them is a hit.
        let through = SceneOptions { culling: Culling::Back, ..SceneOptions::default() };
        let report = built.closest_hits(&rays, &mut hits, &through).expect("hits");
        assert_eq!(report.entered, count as u64 * u64::from(ROW));
        assert!(hits.iter().all(|hit| !hit.is_hit()));
        let report = built.closest_hits(&rays, &mut hits, &SceneOptions::default()).expect("hits");
        assert_eq!(report.entered, count as u64);
        assert!(hits.iter().all(|hit| (hit.t, hit.instance) == (1.0, 0)));
    }
}

/// A scene on a device with a changed kernel. The CPU builds the geometries, so that no kernel of the builder is compiled.
fn built_on(kernel: QueryKernel, source: String) -> impl Fn(&Scene) -> Box<dyn SceneAccelerator> {
    let backend = WgpuBackend::with_replaced_query(own_gpu(), kernel, source);
    move |scene| {
        let (cpu, build) = (CpuBackend::new(), BuildOptions::default());
        let mut built = backend.build_scene(&Scene::new(), &build).expect("a scene");
        let own = &mut |mesh: &Mesh<'_>, options: &BuildOptions<'_>| cpu.build(mesh, options);
        built.update_by(scene, &build, own).expect("an update");
        assert_eq!(built.placed_by_cpu(), None);
        built
    }
}

fn source_of(kernel: QueryKernel) -> String {
    let shader = splitplane_shaders::query(kernel.name(), TriangleTest::Watertight);
    shader.expect("a shader").source()
}

/// The kernels of waves, without masks (0), with them (1), and with shapes (2).
fn waves() -> Vec<(usize, QueryKernel)> {
    let masked =
        QueryKernel::MASKED_WAVE.into_iter().filter(|own| !QueryKernel::WAVE.contains(own));
    QueryKernel::WAVE
        .map(|own| (0, own))
        .into_iter()
        .chain(masked.map(|own| (1, own)))
        .chain([(2, QueryKernel::TraceShapes)])
        .collect()
}

/// Drivers that do what WGSL lets them do give the same hits: each kernel, rewritten as such a driver has it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_on_drivers_that_round_badly() {
    let cpu = CpuBackend::new();
    let cases = [Kind::Ordinary, Kind::IllConditioned, Kind::Coincident].map(|kind| {
        let (scene, _) = objects::scene(kind, 40, 81);
        let rays = objects::rays(&scene, 400, 82);
        let built = cpu.build_scene(&scene, &BuildOptions::default()).expect("a scene");
        let all = expected(&*built, &rays, &SceneOptions::default());
        let (mut masked, _) = objects::scene(kind, 40, 81);
        objects::mask(&mut masked, 83);
        let built = cpu.build_scene(&masked, &BuildOptions::default()).expect("a scene");
        let opaque = expected(&*built, &rays, &SceneOptions::default());
        assert!(opaque != all);
        let (mut round, names) = objects::scene(kind, 40, 81);
        objects::add_shapes(&mut round, &names, 84);
        let built = cpu.build_scene(&round, &BuildOptions::default()).expect("a scene");
        let shapes = expected(&*built, &rays, &SceneOptions::default());
        assert!(shapes != all);
        let again = rays.clone();
        [
            (kind, scene, rays.clone(), all),
            (kind, masked, rays, opaque),
            (kind, round, again, shapes),
        ]
    });
    for driver in hostile::ALLOWED {
        for (case, kernel) in waves() {
            let on = built_on(kernel, driver.compiled(&source_of(kernel)));
            for (kind, scene, rays, all) in cases.iter().map(|cases| &cases[case]) {
                let (own, report) = answers(&*on(scene), rays, &SceneOptions::default());
                let place = format!("{}, {kernel:?}, {kind:?}", driver.name);
                assert!(own == *all, "{place}");
                let unfinished = report.geometries.unfinished;
                assert!(unfinished < rays.len() as u64 / 5, "{place}: {unfinished}");
            }
        }
    }
}

/// Each fault in a kernel changes the answer to some ray.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_found() {
    use QueryKernel::{
        EnterInstances, TraceInstances, TraceInstancesMasked, TraceInstancesRetry,
        TraceInstancesRetryMasked, TraceShapes,
    };
    let faults = [
        (TraceInstances, "ties", "instance < best.instance ||", "instance > best.instance ||"),
        (TraceInstances, "order", "hit.t < best.t ||", "hit.t > best.t ||"),
        (TraceInstances, "limits", "0x00800000u) + 1u", "0x00800000u) - 1u"),
        (TraceInstances, "reflections", "3u - sides, mirrored", "sides, mirrored"),
        (TraceInstances, "inverses", "bitcast<f32>(row.w));", "bitcast<f32>(row.w ^ 1u));"),
        (TraceInstances, "directions", "snapped_product(m.z, d.z)", "snapped_product(m.z, p_z(d))"),
        (TraceInstances, "ignored triangles", "+ scene_batch.ignored_triangle", "+ 0u"),
        (TraceInstances, "slack", "bitcast<f32>(lo.w)", "-1.0"),
        (TraceInstances, "deferred rays", "        defer_ray(index, vec3<u32>());\n", ""),
        (
            TraceInstancesRetry,
            "retries",
            "take_entries(first, deferred_count(),",
            "take_entries(first, deferred_count() & 0u,",
        ),
        (EnterInstances, "masks", "(asked.x & scene_batch.mask) != 0u", "true"),
        (EnterInstances, "both sides", "& 3u) != 3u", "& 3u) != 4u"),
        (
            EnterInstances,
            "widening",
            "free_mul(reach, ray.distance)",
            "free_mul(reach, -ray.distance)",
        ),
        (EnterInstances, "stops", "out.stop = sum(t_max, ", "out.stop = difference(t_max, "),
        (EnterInstances, "rests", "if rest != 0u", "if rest > 15u"),
        (EnterInstances, "boxes that do not count", "(child & TOP_ALWAYS) == 0u", "true"),
        (TraceInstancesMasked, "cells", "|| !is_opaque(triangle, candidate.weights)", ""),
        (TraceInstancesMasked, "levels", "let bits = 2u * level;", "let bits = 2u * level + 1u;"),
        (TraceInstancesMasked, "upper cells", ">= 1.0;", ">= 2.0;"),
        (
            TraceInstancesMasked,
            "last cells",
            "2u * (edge - row) - 2u);",
            "2u * (edge - row) - 3u);",
        ),
        (TraceInstancesMasked, "rows", "row * (2u * edge - row)", "row * (2u * edge - row - 1u)"),
        (
            TraceInstancesMasked,
            "own triangles",
            "leaf_references[mask + 1u]",
            "(leaf_references[mask + 1u] ^ 1u)",
        ),
        (TraceInstancesMasked, "words", "(cell >> 5u), bits > 5u)", "(cell >> 6u), bits > 5u)"),
        (TraceInstancesMasked, "no mask", "if mask == 0u", "if mask == 1u"),
        (
            TraceInstancesRetryMasked,
            "cells of retries",
            "|| !is_opaque(triangle, candidate.weights)",
            "",
        ),
        (TraceShapes, "nearer shapes", "|| t < hit.t ||", "|| t > hit.t ||"),
        (TraceShapes, "order of shapes", "hit.t < before.t ||", "hit.t > before.t ||"),
        (TraceShapes, "limits of shapes", "0x00800000u) + 1u", "0x00800000u) - 1u"),
        (TraceShapes, "far ends", "select(span.t.x, span.t.y, k == 1u)", "span.t.x"),
        (
            TraceShapes,
            "sides of shapes",
            "select(CULL_FRONT, CULL_BACK,",
            "select(CULL_BACK, CULL_FRONT,",
        ),
        (TraceShapes, "ignored shapes", "|| next.instance == ignored", ""),
        (TraceShapes, "places of shapes", "2u * next.instance;", "2u * (next.instance ^ 1u);"),
        (TraceShapes, "second ends", "at = minus3(start, axis);", "at = start;"),
        (TraceShapes, "planes", "vec2<f32>(low, high), low < high);", "-no_span(), low < high);"),
        (TraceShapes, "places on axes", "select(span.u.x, span.u.y, k == 1u)", "span.u.x"),
        (TraceShapes, "scales", "size + 2 - ray.exponent", "size + 1 - ray.exponent"),
        (
            TraceShapes,
            "radii",
            "snapped_product(snap(first.w), 0.25)",
            "snapped_product(snap(first.w), 0.5)",
        ),
    ];
    let cpu = CpuBackend::new();
    let kinds = [Kind::Ordinary, Kind::IllConditioned, Kind::Coincident, Kind::Wide];
    let case = |kind, which: usize| {
        let (mut scene, names) = objects::scene(kind, 60, 71);
        let mut rays = objects::rays(&scene, 900, 72);
        rays.extend(odd(&rays[..90]));
        let meshes = scene.geometries().count() as u32;
        match which {
            0 => {}
            1 => objects::mask(&mut scene, 73),
            _ => objects::add_shapes(&mut scene, &names, 74),
        }
        let built = cpu.build_scene(&scene, &BuildOptions::default()).expect("a scene");
        let mut options = asked(&names);
        // One that is hit.
        let hits = expected(&*built, &rays, &options[0]);
        let hit = hits.iter().map(|(hit, _)| bytemuck::cast::<_, SceneHit>(*hit));
        let suits = |hit: &SceneHit| hit.triangle > 0 && (which < 2 || hit.geometry >= meshes);
        let hit = hit.filter(SceneHit::is_hit).find(suits).expect("a hit");
        let instance = InstanceId(hit.instance);
        let ignore = Some(IgnoredTriangle { instance, triangle: hit.triangle });
        options[1] = options[3];
        options[3] = SceneOptions { ignore, ..options[0] };
        let all = options.map(|options| expected(&*built, &rays, &options));
        (scene, rays, options, all)
    };
    let cases = [0, 1, 2].map(|which| kinds.map(|kind| case(kind, which)));
    let mut never = Vec::new();
    for (kernel, what, from, to) in faults {
        let source = source_of(kernel);
        let faulty = source.replace(from, to) + "\nfn p_z(d: vec3<f32>) -> f32 { return d.y; }\n";
        assert!(source.contains(from), "{what}: {from}");
        let on = built_on(kernel, faulty);
        let which = match kernel {
            TraceShapes => 2,
            TraceInstancesMasked | TraceInstancesRetryMasked => 1,
            _ => 0,
        };
        let is_found = cases[which].iter().any(|(scene, rays, options, all)| {
            let built = on(scene);
            (0..all.len()).any(|i| answers(&*built, rays, &options[i]).0 != all[i])
        });
        if !is_found {
            never.push(what);
        }
    }
    assert_eq!(never, [""; 0], "faults that no ray finds");
}

/// A scene that does not fit what is allowed is answered in waves, and says why; with room again it is on the device again.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn without_room_the_cpu_places_rays() {
    let device = device();
    let (mut scene, names) = objects::scene(Kind::Ordinary, 40, 51);
    let rays = objects::rays(&scene, 300, 52);
    let options = SceneOptions::default();
    let mut built = device.build_scene(&scene, &BuildOptions::default()).expect("a scene");
    let held = built.scene().bytes();
    let all: u64 = built.scene().packed_sizes().bytes().iter().sum();
    let tight = BuildOptions { max_memory: Some(held + all - 1), ..BuildOptions::default() };
    scene.move_instance(names[3], translation([0.25; 3])).expect("an edit");
    device.update_scene(&mut *built, &scene, &tight).expect("an update");
    let reason = built.placed_by_cpu().expect("a reason").to_owned();
    assert!(reason.contains("allowed"), "{reason}");
    let (own, report) = answers(&*built, &rays, &options);
    assert_eq!(own, expected(&*built, &rays, &options));
    assert_eq!(report.placed_by_cpu, 2 * rays.len() as u64);
    device.update_scene(&mut *built, &scene, &BuildOptions::default()).expect("an update");
    assert_eq!(built.placed_by_cpu(), None);
    let (own, report) = answers(&*built, &rays, &options);
    assert_eq!((own, report.placed_by_cpu), (expected(&*built, &rays, &options), 0));
}

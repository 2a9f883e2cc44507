//! Scenes that are wholly on a device: the answers of all instances asked one after the other, bit for bit; what updates send; what
//! happens where the device has no room.

mod common;

use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Accuracy, Culling, Ray};
use splitplane_core::scene::{
    IgnoredTriangle, InstanceId, Scene, SceneHit, SceneOptions, SceneReport, translation,
};
use splitplane_test_support::objects::{self, Kind};
use splitplane_wgpu::{Gpu, OpenOptions, WgpuBackend};

fn open() -> Gpu {
    let adapter = std::env::var("SPLITPLANE_ADAPTER").ok();
    let open = OpenOptions { default_limits: true, adapter, ..Default::default() };
    Gpu::open(&open).expect("the device tests need a GPU or a software Vulkan")
}

fn device() -> WgpuBackend {
    WgpuBackend::new(open()).expect("a backend")
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

fn expected(
    scene: &dyn SceneAccelerator,
    rays: &[Ray],
    options: &SceneOptions<'_>,
) -> Answers {
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

/// Rays that hit nothing, whatever there is, or that are odd otherwise.
fn odd(rays: &[Ray]) -> Vec<Ray> {
    let [nan, infinite] = [f32::NAN, f32::INFINITY];
    let change = |(i, ray): (usize, &Ray)| match i % 9 {
        0 => Ray::new([nan, 0.0, 0.0], ray.direction),
        1 => Ray::new(ray.origin, [0.0, infinite, 1.0]),
        2 => Ray::new(ray.origin, [0.0, -0.0, 0.0]),
        3 => ray.with_limits(1.0, 0.5),
        4 => ray.with_limits(nan, 1.0),
        5 => ray.with_limits(-infinite, -0.0),
        6 => Ray::new(ray.origin.map(|x| x + 1e19), ray.direction),
        7 => Ray::new(ray.origin, ray.direction.map(|x| x * 1e20)),
        _ => Ray::new(ray.origin, ray.direction.map(|x| x * 1e-20)),
    };
    rays.iter().enumerate().map(change).collect()
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn hits_are_those_of_all_instances() {
    let device = device();
    let (mut found, mut all_entered) = (0, 0);
    for (number, kind) in Kind::ALL.into_iter().enumerate() {
        let (scene, names) = objects::scene(kind, 60, 800 + number as u64);
        let mut rays = objects::rays(&scene, 1000, 900 + number as u64);
        rays.extend(odd(&rays[..200]));
        let built = device.build_scene(&scene, &BuildOptions::default()).expect("a scene");
        assert_eq!(built.placed_by_cpu(), None);
        for options in asked(&names) {
            let all = expected(&*built, &rays, &options);
            let (own, report) = answers(&*built, &rays, &options);
            for (i, ray) in rays.iter().enumerate() {
                assert_eq!(own[i], all[i], "{kind:?} {ray:?} {options:?}");
            }
            assert_eq!((report.placed_by_cpu, report.batches), (0, 0));
            assert_eq!(report.geometries.answered_by_cpu, report.geometries.unfinished);
            assert!(report.geometries.unfinished < rays.len() as u64 / 10, "{report:?}");
            all_entered += report.entered;
            found += all.iter().filter(|(_, any)| *any).count();
        }
    }
    assert!(found > 6_000 && all_entered > 50_000, "{found} {all_entered}");
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
    let none = |hit: &([u32; 6], bool)| !hit.1 && hit.0 == bytemuck::cast::<_, [u32; 6]>(SceneHit::MISS);
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
    let report = device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(report.bytes_sent, built.scene().packed_sizes().bytes().iter().sum::<u64>());
    let options = SceneOptions::default();
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
    scene.move_instance(names[9], translation([0.5; 3])).expect("an edit");
    device.update_scene(&mut *built, &scene, &build).expect("an update");
    assert_eq!(answers(&*built, &rays, &options).0, expected(&*built, &rays, &options));
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

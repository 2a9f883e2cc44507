//! Closest points and overlaps on a device: the CPU backend's answers, bit for bit, on meshes that trees and bounds trip over; faults planted in
//! the kernels are found; what a device cannot answer the host does, and it is counted.

use std::ops::ControlFlow;
use std::sync::Arc;

use crate::common::{self, own_gpu, tested_queries as kept, trusted};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::error::{DeviceError, QueryError};
use splitplane_core::kernel::NearKernel;
use splitplane_core::points::build::{PointBuildError, PointOptions};
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::query::overlap::{OverlapOptions, Plane, Volume};
use splitplane_core::ray::Accuracy;
use splitplane_core::report::QueryReport;
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::{Aim, Kind};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes::{self, Scene};
use splitplane_wgpu::{Gpu, Parity, Queries, WgpuAccelerator, WgpuBackend};

/// A scene's tree on the CPU and on a device.
fn both(scene: &Scene, queries: Arc<Queries>) -> (CpuAccelerator, WgpuAccelerator) {
    let mesh = scene.mesh();
    let cpu = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let triangles: Vec<Triangle> =
        (0..mesh.len()).map(|index| prepare(&mesh.triangle(index)).corners).collect();
    let (tree, summary) = (cpu.tree().clone(), *cpu.summary());
    let device = WgpuAccelerator::upload(queries, tree, triangles, summary).expect("memory");
    (cpu, device)
}

/// Scenes whose numbers are far from 1, too, and with more triangles that are as near than a device keeps.
fn hostile() -> Vec<Scene> {
    let mut all = scenes::awkward();
    for (factor, name) in [(1e-30, "tiny"), (1e30, "huge"), (3e37, "at the end of the range")] {
        all.push(scenes::scaled(&scenes::soup(60, 0.3, 4), factor, name));
    }
    all.push(scenes::sphere(5, [1e7, -1e7, 1e7], 1000.0));
    all.push(scenes::identical(40));
    all.push(scenes::needle_star());
    all
}

/// Points on corners, edges and faces, near them, in the box, and far off; and some that are nowhere.
fn points(scene: &Scene, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mesh = scene.mesh();
    let mut all = vec![[f32::NAN, 0.0, 0.0], [0.0, f32::INFINITY, 0.0], [f32::MAX; 3], [0.0; 3]];
    if mesh.is_empty() {
        return all;
    }
    let mut aim = Aim::new(&mesh, seed);
    let size = aim.bounds().diagonal().clamp(1e-30, 1e38);
    all.extend((0..count).map(|number| {
        let target = aim.target(Kind::ALL[number % Kind::ALL.len()]);
        let away = [0.0, 1e-6, 0.03, 1.0, 1e4][number % 5] * size;
        let direction = aim.random().direction();
        [0, 1, 2].map(|axis| (target[axis] + away * direction[axis]) as f32)
    }));
    all
}

fn bits(found: &ClosestPoint) -> (u64, u32, [u32; 5]) {
    let [x, y, z] = found.point.map(f32::to_bits);
    let words = [x, y, z, found.u.to_bits(), found.v.to_bits()];
    (found.distance_squared.to_bits(), found.triangle, words)
}

/// The first point that the device answers otherwise than the CPU, and its report.
fn closest_differ(
    (cpu, device): &(CpuAccelerator, WgpuAccelerator),
    points: &[[f32; 3]],
    options: &ClosestPointOptions<'_>,
) -> (Option<String>, QueryReport) {
    let odd = ClosestPoint { triangle: 7, ..ClosestPoint::NONE };
    let (mut expected, mut found) = (vec![odd; points.len()], vec![odd; points.len()]);
    cpu.closest_points(points, &mut expected, options).expect("answers");
    let report = device.closest_points(points, &mut found, options).expect("answers");
    let differs =
        points.iter().zip(expected.iter().zip(&found)).find_map(|(point, (expected, found))| {
            let same = bits(expected) == bits(found);
            (!same).then(|| format!("{point:?}: {found:?} in place of {expected:?}"))
        });
    (differs, report)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn closest_points_are_the_cpus() {
    let (mut asked, mut by_cpu, mut unfinished) = (0, 0, 0);
    for (number, scene) in hostile().iter().enumerate() {
        let trees = both(scene, kept());
        let points = points(scene, 100, number as u64);
        let diagonal = trees.0.tree().bounds.diagonal();
        let near = if diagonal.is_finite() { (0.05 * diagonal) as f32 } else { 1.0 };
        for options in [
            ClosestPointOptions::default(),
            ClosestPointOptions { max_distance: near, ignore: Some(3), ..Default::default() },
            ClosestPointOptions { accuracy: Accuracy::Exact, ..Default::default() },
            ClosestPointOptions {
                accuracy: Accuracy::Exact,
                max_distance: near,
                ..Default::default()
            },
            ClosestPointOptions { max_distance: 0.0, ..ClosestPointOptions::default() },
            ClosestPointOptions { max_distance: -1.0, ..ClosestPointOptions::default() },
        ] {
            let (differs, report) = closest_differ(&trees, &points, &options);
            assert_eq!(differs, None, "{} {options:?}", scene.name);
            asked += points.len();
            by_cpu += report.answered_by_cpu;
            unfinished += report.unfinished;
        }
    }
    assert!(asked > 5_000 && by_cpu > 0 && by_cpu < asked as u64 / 3, "{by_cpu} of {asked}");
    // llvmpipe ends the loops of some in crowds of triangles.
    assert!(unfinished < asked as u64 / 10, "{unfinished} of {asked}");
}

/// Volumes of all kinds around a scene, some of which only touch, meet nothing, or cannot be measured.
fn volumes<'a>(
    scene: &Scene,
    (seed, step): (u64, usize),
    planes: &'a [Vec<Plane>],
) -> Vec<Volume<'a>> {
    let points = points(scene, 48, seed);
    let mut random = Random::new(seed);
    let size = Aabb::of_points(&points[3..]).diagonal().clamp(1e-30, 1e30) as f32;
    let mut all = Vec::new();
    for three in points.windows(3).step_by(step) {
        let [a, b, c] = [three[0], three[1], three[2]];
        let radius = [0.0, 1e-5, 0.01, 0.01, 0.1, 0.1, f32::INFINITY, -1.0][random.below(8)] * size;
        let box_of = |[a, b]: [[f32; 3]; 2]| {
            let side = |pick: fn(f32, f32) -> f32| [0, 1, 2].map(|axis| pick(a[axis], b[axis]));
            Aabb { lo: side(f32::min), hi: side(f32::max) }
        };
        all.push(Volume::Box(box_of([a, b])));
        all.push(Volume::Box(box_of([a.map(|x| x - radius), a.map(|x| x + radius)])));
        all.push(Volume::Ball { centre: a, radius });
        all.push(Volume::Capsule { from: a, to: b, radius });
        all.push(Volume::Triangle([a, b, c]));
    }
    all.push(Volume::Box(Aabb { lo: [f32::NEG_INFINITY; 3], hi: [f32::INFINITY; 3] }));
    all.push(Volume::Box(Aabb { lo: [1.0; 3], hi: [0.0; 3] }));
    all.extend(planes.iter().map(|planes| Volume::Planes(planes)));
    all
}

/// Slabs, frusta and halves whose planes go through corners or past all of them; and more planes than a device takes.
fn plane_sets(scene: &Scene, seed: u64) -> Vec<Vec<Plane>> {
    let points = points(scene, 40, seed);
    let mut random = Random::new(seed);
    let mut sets: Vec<Vec<Plane>> = (0..12)
        .map(|count| {
            let plane = |_| {
                let normal = [(); 3].map(|()| random.below(5) as f32 - 2.0);
                let through = points[3 + random.below(points.len() - 3)];
                let offset = (0..3).map(|axis| normal[axis] * through[axis]).sum();
                Plane { normal, offset }
            };
            (0..count % 7).map(plane).collect()
        })
        .collect();
    let far = Plane { normal: [1e-20, 1e-20, 0.0], offset: 1e20 };
    sets.push(vec![far; 80]);
    sets.push(vec![far, Plane { normal: far.normal, offset: -1e20 }]);
    sets
}

/// The first volume that the device answers otherwise than the CPU, and how many the host answered of lists and of the others.
fn overlaps_differ(
    (cpu, device): &(CpuAccelerator, WgpuAccelerator),
    volumes: &[Volume<'_>],
    options: &OverlapOptions<'_>,
) -> (Option<String>, [u64; 2]) {
    let expected = cpu.overlaps(volumes, options).expect("answers");
    let found = device.overlaps(volumes, options).expect("answers");
    let mut any = vec![false; volumes.len()];
    let report = device.overlaps_any(volumes, &mut any, options).expect("answers");
    let differs = volumes.iter().enumerate().find_map(|(place, volume)| {
        let (expected, found) = (expected.of(place), found.of(place));
        let same = expected == found && any[place] != expected.is_empty();
        (!same).then(|| format!("{volume:?}: {found:?}, {} for {expected:?}", any[place]))
    });
    (differs, [found.report.answered_by_cpu, report.answered_by_cpu])
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn overlaps_are_the_cpus() {
    let (mut asked, mut by_cpu) = (0, [0; 2]);
    for (number, scene) in hostile().iter().enumerate() {
        let trees = both(scene, kept());
        let planes = plane_sets(scene, number as u64);
        let volumes = volumes(scene, (90 + number as u64, 8), &planes);
        let ignore = [None, Some(2)][number % 2];
        let options = OverlapOptions { ignore, ..OverlapOptions::default() };
        let (differs, host) = overlaps_differ(&trees, &volumes, &options);
        assert_eq!(differs, None, "{}", scene.name);
        asked += volumes.len() as u64;
        by_cpu = [by_cpu[0] + host[0], by_cpu[1] + host[1]];
    }
    assert!(asked > 1_000, "{asked}");
    // Volumes far away, and those of scenes of extreme scale, are the host's.
    assert!(by_cpu.iter().all(|&host| host > 0 && host < asked / 2), "{by_cpu:?} of {asked}");
}

/// An ordinary scene is the device's alone.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_device_answers_ordinary_batches_alone() {
    let scene = scenes::soup(4_000, 0.05, 3);
    let trees = both(&scene, kept());
    let mut random = Random::new(1);
    let points: Vec<[f32; 3]> = (0..10_000).map(|_| random.point(1.5)).collect();
    for max_distance in [f32::INFINITY, 0.2] {
        let options = ClosestPointOptions { max_distance, ..ClosestPointOptions::default() };
        let (differs, report) = closest_differ(&trees, &points, &options);
        assert_eq!(differs, None);
        assert_eq!((report.answered_by_cpu, report.unfinished), (0, 0));
    }
    let volumes: Vec<Volume<'_>> = points[..400]
        .iter()
        .map(|&centre| match centre[0] < 0.0 {
            true => Volume::Ball { centre, radius: 0.2 },
            false => Volume::Capsule { from: centre, to: [0.0; 3], radius: 0.01 },
        })
        .collect();
    let (differs, host) = overlaps_differ(&trees, &volumes, &OverlapOptions::default());
    assert_eq!((differs, host), (None, [0, 0]));
}

/// A scanned object, whose vertices have six triangles or so: points on them and around are nearly all the device's.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[cfg_attr(no_scenes, ignore = "no scenes folder; set SPLITPLANE_SCENES")]
fn scans_are_the_devices() {
    let scene = scenes::real("bunny").expect("bunny.obj in the scenes folder");
    let trees = both(&scene, kept());
    let points = points(&scene, 2_000, 3);
    let (differs, report) = closest_differ(&trees, &points, &ClosestPointOptions::default());
    assert_eq!(differs, None);
    println!("{} of {} by the host", report.answered_by_cpu, points.len());
    // A fifth of the points are too far away.
    assert!(report.answered_by_cpu < points.len() as u64 / 2, "{report:?}");
    let volumes = volumes(&scene, (3, 40), &[]);
    let (differs, _) = overlaps_differ(&trees, &volumes, &OverlapOptions::default());
    assert_eq!(differs, None);
}

/// Triangles that one binding does not hold.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn triangles_by_halves_give_the_same() {
    let [(device, queue), _] = common::host_devices(&wgpu::Limits {
        max_storage_buffer_binding_size: 420_000,
        ..wgpu::Limits::default()
    });
    let scene = scenes::soup(12_000, 0.01, 41);
    let trees = both(&scene, trusted(Arc::new(Gpu::borrow(device, queue))));
    let mut random = Random::new(4);
    let points: Vec<[f32; 3]> = (0..500).map(|_| random.point(1.0)).collect();
    let (differs, report) = closest_differ(&trees, &points, &ClosestPointOptions::default());
    assert_eq!((differs, report.answered_by_cpu), (None, 0));
    let balls = points.iter().map(|&centre| Volume::Ball { centre, radius: 0.1 });
    let volumes: Vec<Volume<'_>> = balls.collect();
    let (differs, host) = overlaps_differ(&trees, &volumes, &OverlapOptions::default());
    assert_eq!((differs, host), (None, [0, 0]));
}

/// Where no self-test has found that bounds of errors hold, the host answers.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_host_answers_where_bounds_may_not_hold() {
    let scene = scenes::medley(400, 0.2, 3);
    let trees = both(&scene, Arc::new(Queries::new(common::gpu())));
    let points = points(&scene, 200, 5);
    let (differs, report) = closest_differ(&trees, &points, &ClosestPointOptions::default());
    assert_eq!((differs, report.answered_by_cpu), (None, points.len() as u64));
    let volumes = volumes(&scene, (5, 4), &[]);
    let (differs, host) = overlaps_differ(&trees, &volumes, &OverlapOptions::default());
    assert_eq!((differs, host), (None, [volumes.len() as u64; 2]));
}

/// Each fault in a kernel changes an answer, or leaves to the host what the device answers without it.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_found() {
    use NearKernel::{ClosestTriangles as C, OverlappedTriangles as O};
    let faults = [
        (C, "dot3(far, far) <= stop", "dot3(far, far) <= 0.0 * stop"),
        (C, "dot3(nearest, nearest) <= stop", "dot3(nearest, nearest) > stop"),
        (C, "select(payload, node + 1u, is_below)", "select(node + 1u, payload, is_below)"),
        (C, "range.x > cut", "range.x >= 0.9 * cut"),
        (C, "least_lost > cut", "least_lost >= 0.0"),
        (C, "sum(product(square, inverse), NEAR_BATCH_SLACK)", "product(square, 0.5 * inverse)"),
        (C, "least(least(dot3(x, seen.a), dot3(x, seen.b)), dot3(x, seen.c))", "dot3(x, seen.a)"),
        (C, "start = select(seen.b, seen.a, number == 0u)", "start = seen.a"),
        (C, "triangle == near_batch.ignore", "triangle + 1u == near_batch.ignore"),
        (C, "most(gap, on_axis(gaps, tag))", "sum(gap, 0.2)"),
        (O, "any(lo > own.hi)", "any(lo >= own.hi)"),
        (O, "select(above, below, plane.xyz > vec3<f32>(0.0))", "below"),
        (O, "all(sides > vec3<f32>(NEAR_BATCH_SLACK))", "any(sides > vec3<f32>(NEAR_BATCH_SLACK))"),
        (O, "is_in_box(corners.c);", "!is_in_box(corners.c);"),
        (O, "is_certain = range.y <= own.radius", "is_certain = range.x <= 2.0 * own.radius"),
        (O, "range.x > own.radius", "range.x > 0.5 * own.radius"),
        (O, "is_certain = any(is_inside)", "is_certain = !any(is_inside)"),
        (O, "upper_stack[top] = hi", "upper_stack[top] = lo"),
        (O, "own_first + 1u + own_count", "own_first + 1u"),
        (O, "most3(most3(below, -above), vec3<f32>(0.0))", "abs(below)"),
    ];
    let scenes = [scenes::grid_boxes(1), scenes::soup(150, 0.3, 3), scenes::identical(40)];
    let asked = scenes.each_ref().map(|scene| (points(scene, 60, 8), plane_sets(scene, 8)));
    let found = |kernel: NearKernel, place: usize, queries: &Arc<Queries>| {
        let (scene, (points, planes)) = (&scenes[place], &asked[place]);
        let trees = both(scene, queries.clone());
        if kernel == C {
            let ignore = Some(3);
            let options = ClosestPointOptions { ignore, ..ClosestPointOptions::default() };
            let (differs, report) = closest_differ(&trees, &points[3..], &options);
            (differs, [report.answered_by_cpu, 0])
        } else {
            let volumes = volumes(scene, (8, 2), planes);
            overlaps_differ(&trees, &volumes, &OverlapOptions::default())
        }
    };
    let usual = [C, O].map(|kernel| [0, 1, 2].map(|place| found(kernel, place, &kept())));
    let mut unseen = Vec::new();
    for (kernel, from, to) in faults {
        let source = splitplane_shaders::NEAR[kernel as usize].source();
        assert!(source.contains(from), "{from}: the text is not there");
        let own = trusted(common::gpu());
        own.replace_near_kernel(kernel, Some(source.replacen(from, to, 1)));
        let seen = [0, 1, 2]
            .iter()
            .any(|&place| found(kernel, place, &own) != usual[kernel as usize][place]);
        if !seen {
            unseen.push((kernel, from));
        }
    }
    assert!(unseen.is_empty(), "{unseen:#?}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn batches_can_be_cancelled_and_limited() {
    let scene = scenes::soup(300, 0.3, 3);
    let (_, device) = both(&scene, kept());
    let mut random = Random::new(6);
    let points: Vec<[f32; 3]> = (0..3_000).map(|_| random.point(1.0)).collect();
    let mut found = vec![ClosestPoint::NONE; points.len()];
    for calls in [1, 2, 3] {
        let left = std::sync::atomic::AtomicU64::new(calls);
        let ends = |progress: &Progress| {
            assert!(progress.done <= progress.total, "{progress:?}");
            match left.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) {
                1 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        };
        let watched = ClosestPointOptions { watch: Some(&ends), ..Default::default() };
        let cancelled = device.closest_points(&points, &mut found, &watched);
        assert!(
            matches!(cancelled, Err(QueryError::Cancelled { total: 3_000, .. })),
            "{cancelled:?}"
        );
        left.store(calls, std::sync::atomic::Ordering::Relaxed);
        let volumes: Vec<Volume<'_>> =
            points.iter().map(|&centre| Volume::Ball { centre, radius: 0.2 }).collect();
        let watched = OverlapOptions { watch: Some(&ends), ..Default::default() };
        let cancelled = device.overlaps(&volumes, &watched).map(|_| ());
        assert!(matches!(cancelled, Err(QueryError::Cancelled { .. })), "{cancelled:?}");
    }
    let short = device.closest_points(&points, &mut found[1..], &Default::default());
    assert_eq!(short, Err(QueryError::LengthMismatch { rays: 3_000, results: 2_999 }));
    let volumes = [Volume::Ball { centre: [0.0; 3], radius: 9.0 }; 40];
    let limited = OverlapOptions { max_memory: Some(2_000), ..Default::default() };
    let refused = device.overlaps(&volumes, &limited).map(|_| ());
    assert!(matches!(refused, Err(QueryError::OutOfMemory { limit: 2_000, .. })), "{refused:?}");
    let short = device.overlaps_any(&volumes, &mut [false; 39], &limited).map(|_| ());
    assert!(matches!(short, Err(QueryError::LengthMismatch { .. })), "{short:?}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_lost_device_is_an_error() {
    let gpu = own_gpu();
    let raw = gpu.device().clone();
    let (_, device) = both(&scenes::soup(100, 0.3, 3), trusted(Arc::new(gpu)));
    raw.destroy();
    let mut found = [ClosestPoint::NONE; 1];
    let lost = device.closest_points(&[[0.0; 3]], &mut found, &Default::default());
    assert!(matches!(lost, Err(QueryError::Device(DeviceError::Lost { .. }))), "{lost:?}");
    let ball = [Volume::Ball { centre: [0.0; 3], radius: 1.0 }];
    let lost = device.overlaps(&ball, &OverlapOptions::default()).map(|_| ());
    assert!(matches!(lost, Err(QueryError::Device(DeviceError::Lost { .. }))), "{lost:?}");
}

/// A device whose arithmetic differs from the CPU's builds no trees of points.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn points_are_refused_where_parity_is_structural() {
    let structural = Parity::Structural("the quotient of 1 and 3".into());
    let gpu = Gpu::clone(&common::gpu());
    let backend = WgpuBackend::with_parity(gpu.clone(), structural);
    let points = [[0.0, 1.0], [2.0, 3.0]];
    let refused = backend.points(&points, &PointOptions::default()).map(|_| ());
    let difference = "the quotient of 1 and 3".into();
    assert_eq!(refused, Err(PointBuildError::NotBitwise { difference }));
    let backend = WgpuBackend::with_parity(gpu, Parity::Bitwise);
    assert!(backend.points(&points, &PointOptions::default()).is_ok());
}

//! Overlaps against fractions of whole numbers, on meshes where everything touches.

use std::ops::ControlFlow;

use crate::common::lattice;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::scene::{SceneOverlapOptions, SceneTriangle};
use splitplane_core::backend::{Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::overlap::{self, OverlapOptions, Overlaps, Plane, Volume};
use splitplane_core::scene::{Instance, Scene, Transform};
use splitplane_core::triangle::Triangle;
use splitplane_core::watch::Progress;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::exact::is_dropped;
use splitplane_test_support::overlap::meets;
use splitplane_test_support::random::Random;

fn soup(count: usize, size: f32, seed: u64) -> Vec<Triangle> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let middle = [(); 3].map(|()| 2.0 * random.signed());
            [(); 3].map(|()| middle.map(|x| (x + random.signed()) * size))
        })
        .collect()
}

fn meshes() -> Vec<(&'static str, Vec<Triangle>, f32)> {
    let mut sizes = soup(40, 1.0, 9);
    for (place, triangle) in sizes.iter_mut().enumerate() {
        let size = 10f32.powi(place as i32 % 13 - 6);
        *triangle = triangle.map(|corner| corner.map(|x| x * size));
    }
    vec![
        ("lattice", lattice(60, 1.0, 1), 1.0),
        ("lattice at 1e-30", lattice(40, 1e-30, 2), 1e-30),
        ("lattice at 1e30", lattice(40, 1e30, 3), 1e30),
        ("soup", soup(50, 1.0, 4), 1.0),
        ("all sizes", sizes, 1.0),
        ("none", Vec::new(), 1.0),
    ]
}

/// Volumes of all kinds, with numbers of the grid and of corners, so that many only touch.
fn volumes<'a>(triangles: &[Triangle], size: f32, planes: &'a [Vec<Plane>]) -> Vec<Volume<'a>> {
    let mut random = Random::new(7);
    let mut all = Vec::new();
    for round in 0..16 {
        let mut point = || match triangles.get(random.below(triangles.len().max(1))) {
            Some(triangle) if round % 2 == 1 => triangle[random.below(3)],
            _ => [(); 3].map(|()| (random.below(9) as f32 - 4.0) * size),
        };
        let [a, b, c] = [point(), point(), point()];
        // 0, and the lengths of whole vectors.
        let radius = [0.0, 1.0, 2.0, 3.0, 0.5, 5.0, 0.25, 1.0 / 3.0][random.below(8)] * size;
        all.push(Volume::Box(Aabb::of_points(&[a, b])));
        all.push(Volume::Ball { centre: a, radius });
        all.push(Volume::Capsule { from: a, to: b, radius });
        all.push(Volume::Triangle([a, b, c]));
    }
    all.extend(planes.iter().map(|planes| Volume::Planes(planes)));
    all
}

/// Frusta and slabs whose planes go through points of the grid.
fn plane_sets(size: f32) -> Vec<Vec<Plane>> {
    let mut random = Random::new(11);
    (0..16)
        .map(|count| {
            (0..count % 7)
                .map(|_| {
                    let normal = [(); 3].map(|()| random.below(5) as f32 - 2.0);
                    Plane { normal, offset: (random.below(7) as f32 - 1.0) * size }
                })
                .collect()
        })
        .collect()
}

fn expected(triangles: &[Triangle], volumes: &[Volume<'_>]) -> Vec<Vec<u32>> {
    let own = |volume: &Volume<'_>| {
        (0..)
            .zip(triangles)
            .filter(|(_, corners)| !is_dropped(corners) && meets(volume, corners))
            .map(|(triangle, _)| triangle)
            .collect()
    };
    volumes.iter().map(own).collect()
}

fn check(found: &Overlaps, expected: &[Vec<u32>]) -> Result<(), String> {
    if found.volumes() != expected.len() {
        return Err(format!("{} volumes of {}", found.volumes(), expected.len()));
    }
    for (volume, expected) in expected.iter().enumerate() {
        if found.of(volume) != expected {
            return Err(format!("volume {volume}: {:?} for {expected:?}", found.of(volume)));
        }
    }
    Ok(())
}

#[test]
fn overlaps_are_those_of_whole_numbers() {
    let options = OverlapOptions::default();
    let (mut some, mut found_any) = (0, 0);
    for (name, triangles, size) in meshes() {
        let planes = plane_sets(size);
        let volumes = volumes(&triangles, size, &planes);
        let expected = expected(&triangles, &volumes);
        some += expected.iter().map(Vec::len).sum::<usize>();
        let mesh = Mesh::soup(&triangles).unwrap();
        for (preset, layout) in
            [(Preset::Fast, QueryLayout::Fast), (Preset::Best, QueryLayout::Compact)]
        {
            let build = BuildOptions { layout, ..preset.config().into() };
            for set in InstructionSet::available() {
                let tree = CpuBackend::with_instruction_set(set).build(&mesh, &build).unwrap();
                let found = tree.overlaps(&volumes, &options).unwrap();
                check(&found, &expected).unwrap_or_else(|error| panic!("{name} {set:?}: {error}"));
                let view = tree.tree().view();
                let reference = overlap::one_by_one(&view, &mesh, &volumes, &options).unwrap();
                assert_eq!(
                    (&reference.starts, &reference.triangles),
                    (&found.starts, &found.triangles)
                );
                let mut any = vec![false; volumes.len()];
                tree.overlaps_any(&volumes, &mut any, &options).unwrap();
                assert!(
                    any.iter().zip(&expected).all(|(any, own)| *any != own.is_empty()),
                    "{name}"
                );
                found_any += any.iter().filter(|any| **any).count();
                // One that is ignored is left out, of all volumes.
                if let Some(&ignored) = expected.iter().flatten().next() {
                    let options = OverlapOptions { ignore: Some(ignored), ..options };
                    let fewer = tree.overlaps(&volumes, &options).unwrap();
                    let mut left = expected.clone();
                    left.iter_mut().for_each(|own| own.retain(|own| *own != ignored));
                    check(&fewer, &left).unwrap();
                }
            }
        }
    }
    assert!(some > 1000 && found_any > 300, "{some} {found_any}");
}

/// What a backend that is wrong by one rounding would answer.
#[test]
fn faults_are_found() {
    let triangles = lattice(60, 1.0, 1);
    let planes = plane_sets(1.0);
    let volumes = volumes(&triangles, 1.0, &planes);
    let expected = expected(&triangles, &volumes);
    let mesh = Mesh::soup(&triangles).unwrap();
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let answer =
        |volumes: &[Volume<'_>]| tree.overlaps(volumes, &OverlapOptions::default()).unwrap();
    check(&answer(&volumes), &expected).unwrap();
    let smaller = |x: f32| if x > 0.0 { x.next_down() } else { x };
    let faults: [&dyn Fn(Volume<'_>) -> Volume<'_>; 3] = [
        &|volume| match volume {
            Volume::Ball { centre, radius } => Volume::Ball { centre, radius: smaller(radius) },
            other => other,
        },
        &|volume| match volume {
            Volume::Capsule { from, to, radius } => {
                Volume::Capsule { from, to, radius: smaller(radius) }
            }
            other => other,
        },
        &|volume| match volume {
            Volume::Box(bounds) => {
                Volume::Box(Aabb { hi: bounds.hi.map(f32::next_down), ..bounds })
            }
            other => other,
        },
    ];
    for (number, fault) in faults.iter().enumerate() {
        let wrong: Vec<Volume<'_>> = volumes.iter().map(|volume| fault(*volume)).collect();
        assert!(check(&answer(&wrong), &expected).is_err(), "fault {number}");
    }
    // A corner moved by one rounding; planes; one triangle too few.
    let moved: Vec<Volume<'_>> = volumes
        .iter()
        .map(|volume| match *volume {
            Volume::Triangle(own) => Volume::Triangle(own.map(|corner| corner.map(f32::next_up))),
            other => other,
        })
        .collect();
    assert!(check(&answer(&moved), &expected).is_err());
    let nearer: Vec<Vec<Plane>> = planes
        .iter()
        .map(|own| own.iter().map(|own| Plane { offset: own.offset.next_down(), ..*own }).collect())
        .collect();
    let mut wrong = volumes.clone();
    let first = wrong.len() - nearer.len();
    for (volume, planes) in wrong[first..].iter_mut().zip(&nearer) {
        *volume = Volume::Planes(planes);
    }
    assert!(check(&answer(&wrong), &expected).is_err());
    let mut short = answer(&volumes);
    let last = short.starts.len() - 1;
    short.starts[last] -= 1;
    assert!(check(&short, &expected).is_err());
}

#[test]
fn odd_volumes_limits_and_cancellation() {
    let triangles = lattice(60, 1.0, 1);
    let mesh = Mesh::soup(&triangles).unwrap();
    let tree = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let options = OverlapOptions::default();
    let kept = triangles.iter().filter(|corners| !is_dropped(corners)).count();
    let infinite = Aabb { lo: [f32::NEG_INFINITY; 3], hi: [f32::INFINITY; 3] };
    let beyond = [Plane { normal: [1.0, 0.0, 0.0], offset: f32::NAN }];
    let all = [
        Volume::Box(infinite),
        Volume::Ball { centre: [9.0; 3], radius: f32::INFINITY },
        Volume::Planes(&[]),
        Volume::Capsule { from: [0.0; 3], to: [1e30; 3], radius: f32::MAX },
    ];
    let found = tree.overlaps(&all, &options).unwrap();
    assert!((0..all.len()).all(|volume| found.of(volume).len() == kept));
    let none = [
        Volume::Box(Aabb { lo: [1.0; 3], hi: [-1.0; 3] }),
        Volume::Box(Aabb { lo: [f32::NAN; 3], hi: [1.0; 3] }),
        Volume::Ball { centre: [0.0; 3], radius: -1.0 },
        Volume::Ball { centre: [f32::INFINITY; 3], radius: 1.0 },
        Volume::Capsule { from: [0.0; 3], to: [f32::NAN; 3], radius: 1.0 },
        Volume::Triangle([[0.0; 3], [1.0; 3], [f32::INFINITY; 3]]),
        Volume::Planes(&beyond),
    ];
    assert!(tree.overlaps(&none, &options).unwrap().triangles.is_empty());
    let limit = |max_memory| OverlapOptions { max_memory: Some(max_memory), ..options };
    assert!(matches!(tree.overlaps(&all, &limit(100)), Err(QueryError::OutOfMemory { .. })));
    assert!(tree.overlaps(&all, &limit(1 << 20)).is_ok());
    let mut found = [false; 2];
    let mismatch = tree.overlaps_any(&all, &mut found, &options);
    assert!(matches!(mismatch, Err(QueryError::LengthMismatch { .. })));
    let stop = |_: &Progress| ControlFlow::Break(());
    let stopped = OverlapOptions { watch: Some(&stop), ..options };
    assert!(matches!(tree.overlaps(&all, &stopped), Err(QueryError::Cancelled { .. })));
    let mut found = [false; 4];
    let stopped = tree.overlaps_any(&all, &mut found, &stopped);
    assert!(matches!(stopped, Err(QueryError::Cancelled { .. })));
}

/// Corners in the world by the stated operations.
fn in_world(transform: &Transform, triangle: &Triangle) -> Triangle {
    triangle.map(|corner| {
        let [x, y, z] = corner.map(f64::from);
        transform.map(|row| {
            let [a, b, c, d] = row.map(f64::from);
            (((a * x + b * y) + c * z) + d) as f32
        })
    })
}

#[test]
fn scenes_have_the_overlaps_of_their_triangles_in_the_world() {
    let triangles: Vec<Triangle> =
        lattice(40, 1.0, 1).into_iter().filter(|corners| !is_dropped(corners)).collect();
    let mesh = Mesh::soup(&triangles).unwrap();
    let mut scene = Scene::new();
    let geometry = scene.add_mesh(&mesh).unwrap();
    let transforms: [Transform; 4] = [
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        [[0.0, -1.0, 0.0, 2.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]],
        [[0.3, 0.4, 0.0, 0.1], [-0.2, 0.7, 0.9, 0.0], [0.0, 0.5, -0.6, 3.0]],
        [[0.5, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
    ];
    let names = transforms.map(|transform| {
        let mut instance = Instance::new(geometry, transform);
        instance.mask = 1;
        scene.add_instance(instance).unwrap()
    });
    let built = CpuBackend::new().build_scene(&scene, &BuildOptions::default()).unwrap();
    let planes = plane_sets(1.0);
    let volumes = volumes(&triangles, 1.0, &planes);
    let options = SceneOverlapOptions::default();
    // On all threads, and on the calling one.
    let found = built.overlaps(&volumes, &options).unwrap();
    assert_eq!(found, built.scene().overlaps(&volumes, &options).unwrap());
    let mut any = vec![false; volumes.len()];
    built.overlaps_any(&volumes, &mut any, &options).unwrap();
    let mut some = 0;
    for (number, volume) in volumes.iter().enumerate() {
        let mut expected = Vec::new();
        for (name, transform) in names.iter().zip(&transforms) {
            for (triangle, corners) in (0..).zip(&triangles) {
                if meets(volume, &in_world(transform, corners)) {
                    expected.push(SceneTriangle { instance: name.0, triangle });
                }
            }
        }
        assert_eq!(found.of(number), expected, "{volume:?}");
        assert_eq!(built.scene().overlaps_any(volume, &options), Ok(!expected.is_empty()));
        assert_eq!(any[number], !expected.is_empty(), "{volume:?}");
        some += expected.len();
    }
    assert!(some > 500, "{some}");
    let masked = SceneOverlapOptions { mask: 2, ..options };
    assert!(built.scene().overlaps(&volumes, &masked).unwrap().triangles.is_empty());
    let limited = SceneOverlapOptions { max_memory: Some(64), ..options };
    for error in [built.overlaps(&volumes, &limited), built.scene().overlaps(&volumes, &limited)] {
        assert!(matches!(error, Err(QueryError::OutOfMemory { .. })));
    }
    let ends = |progress: &Progress| match progress.done {
        0 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let watched = SceneOverlapOptions { watch: Some(&ends), ..options };
    let ended = built.overlaps(&volumes, &watched);
    assert!(matches!(ended, Err(QueryError::Cancelled { .. })), "{ended:?}");
    let ended = built.overlaps_any(&volumes, &mut any, &watched);
    assert!(matches!(ended, Err(QueryError::Cancelled { .. })), "{ended:?}");
    let short = built.overlaps_any(&volumes, &mut any[1..], &options);
    assert!(matches!(short, Err(QueryError::LengthMismatch { .. })), "{short:?}");
}

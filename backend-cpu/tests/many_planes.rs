//! Overlaps with many half-spaces: exact, in time that grows with their number, and ended by the
//! watch within one volume.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::mesh::Mesh;
use splitplane_core::query::overlap::{OverlapOptions, Plane, Volume, overlapping};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::random::Random;

/// Whether a triangle and half-spaces share a point, with whole numbers, by all crossings of two
/// lines: the half-spaces as lines in weights of the corners.
fn meets(triangle: &[[i128; 3]; 3], planes: &[([i128; 3], i128)]) -> bool {
    let mut halves = vec![[-1, 0, 0], [0, -1, 0], [0, 0, -1]];
    for (normal, offset) in planes {
        halves.push(
            triangle.map(|p| (0..3).map(|axis| normal[axis] * p[axis]).sum::<i128>() - offset),
        );
    }
    let is_shared = |a: [i128; 3], b: [i128; 3]| {
        let point = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i] * b[j] - a[j] * b[i]);
        let sum: i128 = point.iter().sum();
        let within = |half: &[i128; 3]| {
            (0..3).map(|place| half[place] * point[place]).sum::<i128>() * sum <= 0
        };
        sum != 0 && halves.iter().all(within)
    };
    (0..halves.len()).any(|i| (0..i).any(|j| is_shared(halves[i], halves[j])))
}

#[test]
fn few_planes_on_a_lattice_are_decided_as_by_fractions() {
    let mut random = Random::new(11);
    let backend = CpuBackend::new();
    let mut counts = [0; 2];
    for round in 0..3000 {
        let mut whole = |reach: usize| random.below(2 * reach + 1) as i128 - reach as i128;
        let triangle = [(); 3].map(|()| [(); 3].map(|()| whole(3)));
        let planes: Vec<([i128; 3], i128)> =
            (0..2 + round % 11).map(|_| ([(); 3].map(|()| whole(2)), whole(3) + 1)).collect();
        let corners = triangle.map(|p| p.map(|x| x as f32));
        let mesh = [corners];
        let mesh = Mesh::soup(&mesh).unwrap();
        let built = backend.build(&mesh, &BuildOptions::default()).unwrap();
        if built.summary().dropped > 0 {
            continue;
        }
        let given: Vec<Plane> = planes
            .iter()
            .map(|(normal, offset)| Plane {
                normal: normal.map(|x| x as f32),
                offset: *offset as f32,
            })
            .collect();
        let found = built.overlaps(&[Volume::Planes(&given)], &OverlapOptions::default()).unwrap();
        let expected = meets(&triangle, &planes);
        assert_eq!(found.of(0).len(), usize::from(expected), "{triangle:?} {planes:?}");
        counts[usize::from(expected)] += 1;
    }
    assert!(counts.iter().all(|&count| count > 300), "{counts:?}");
}

/// Half-spaces around a ball.
fn around_a_ball(count: usize) -> Vec<Plane> {
    let mut random = Random::new(5);
    let mut planes = Vec::new();
    while planes.len() < count {
        let normal = random.point(1.0);
        let length = normal.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length > 0.1 && length < 1.0 {
            planes.push(Plane { normal: normal.map(|x| x / length), offset: 1.0 });
        }
    }
    planes
}

fn triangles(count: usize) -> Vec<[[f32; 3]; 3]> {
    let mut random = Random::new(6);
    let mut corner = || random.point(2.0);
    (0..count).map(|_| [corner(), corner(), corner()]).collect()
}

#[test]
fn thousands_of_planes_are_answered() {
    let (planes, triangles) = (around_a_ball(4000), triangles(200));
    let built = CpuBackend::new().build(&Mesh::soup(&triangles).unwrap(), &BuildOptions::default());
    let found = built.unwrap().overlaps(&[Volume::Planes(&planes)], &OverlapOptions::default());
    // Those of the ball, and hardly any more.
    let ball = Volume::Ball { centre: [0.0; 3], radius: 1.0 };
    let built = CpuBackend::new().build(&Mesh::soup(&triangles).unwrap(), &BuildOptions::default());
    let near = built.unwrap().overlaps(&[ball], &OverlapOptions::default()).unwrap();
    let found = found.unwrap();
    assert!(near.triangles.iter().all(|triangle| found.triangles.contains(triangle)));
    assert!(found.triangles.len() <= near.triangles.len() + 10);
}

#[test]
fn a_watch_ends_a_volume_of_many_planes() {
    let (planes, triangles) = (around_a_ball(3000), triangles(3000));
    let mesh = Mesh::soup(&triangles).unwrap();
    let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
    let calls = AtomicU64::new(0);
    let ends = |_: &Progress| match calls.fetch_add(1, Relaxed) {
        0..20 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let options = OverlapOptions { watch: Some(&ends), ..OverlapOptions::default() };
    let volume = Volume::Planes(&planes);
    let cancelled = Err(QueryError::Cancelled { done: 0, total: 1 });
    assert_eq!(built.overlaps(&[volume], &options).map(drop), cancelled);
    assert_eq!(calls.swap(0, Relaxed), 21);
    assert_eq!(
        built.overlaps_any(&[volume], &mut [false], &options).is_ok(),
        calls.load(Relaxed) < 21
    );
    calls.store(0, Relaxed);
    let by_reference = overlapping(&built.tree().view(), &triangles[..], &volume, false, &options);
    assert_eq!(by_reference.map(drop), cancelled);
}

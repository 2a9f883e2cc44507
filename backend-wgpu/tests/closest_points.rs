//! Closest points of a tree on a device: the CPU backend's answers, bit for bit, and counted as the CPU's.

mod common;

use std::ops::ControlFlow;
use std::sync::Arc;

use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::error::QueryError;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::triangle::{Triangle, prepare};
use splitplane_core::watch::Progress;
use splitplane_cpu::CpuBackend;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;
use splitplane_wgpu::{Queries, WgpuAccelerator};

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn the_host_answers_as_the_cpu_backend_does() {
    let scene = scenes::medley(400, 0.2, 3);
    let mesh = scene.mesh();
    let cpu = CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let triangles: Vec<Triangle> =
        (0..mesh.len()).map(|index| prepare(&mesh.triangle(index)).corners).collect();
    let queries = Arc::new(Queries::new(common::gpu()));
    let (tree, summary) = (cpu.tree().clone(), *cpu.summary());
    let device = WgpuAccelerator::upload(queries, tree, triangles, summary).expect("memory");

    let mut random = Random::new(1);
    let points: Vec<[f32; 3]> = (0..3_000).map(|_| random.point(2.0)).collect();
    let mut expected = vec![ClosestPoint::NONE; points.len()];
    let mut found = expected.clone();
    for max_distance in [f32::INFINITY, 0.3] {
        let options = ClosestPointOptions { max_distance, ..Default::default() };
        cpu.closest_points(&points, &mut expected, &options).expect("answers");
        let report = device.closest_points(&points, &mut found, &options).expect("answers");
        assert_eq!(found, expected);
        assert_eq!(report.answered_by_cpu, points.len() as u64);
    }
    assert!(found.iter().any(ClosestPoint::is_some) && !found.iter().all(ClosestPoint::is_some));

    let ends = |progress: &Progress| match progress.done {
        0 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let watched = ClosestPointOptions { watch: Some(&ends), ..Default::default() };
    let cancelled = device.closest_points(&points, &mut found, &watched);
    assert!(matches!(cancelled, Err(QueryError::Cancelled { total: 3_000, .. })), "{cancelled:?}");
    let short = device.closest_points(&points, &mut found[1..], &watched);
    assert_eq!(short, Err(QueryError::LengthMismatch { rays: 3_000, results: 2_999 }));
}

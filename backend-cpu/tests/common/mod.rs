//! What several tests use.

use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::ray::Hit;
use splitplane_core::scene::{Scene, SceneHit};
use splitplane_core::tree::KdTree;
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;

/// Whether there is time for many rays.
pub(crate) fn long() -> bool {
    std::env::var_os("SPLITPLANE_LONG").is_some_and(|value| value == "1")
}

pub(crate) fn tree_of(scene: &scenes::Scene, preset: Preset) -> KdTree {
    let options = BuildOptions { config: preset.config(), ..Default::default() };
    CpuBackend::new().build_accelerator(&scene.mesh(), &options).expect("a tree").tree().clone()
}

pub(crate) fn built(scene: &Scene) -> Box<dyn SceneAccelerator> {
    CpuBackend::new().build_scene(scene, &BuildOptions::default()).expect("a scene")
}

pub(crate) fn built_by(set: InstructionSet, scene: &Scene) -> Box<dyn SceneAccelerator> {
    let backend = CpuBackend::with_instruction_set(set);
    backend.build_scene(scene, &BuildOptions::default()).expect("a scene")
}

pub(crate) fn bits(hits: &[Hit]) -> Vec<[u32; 4]> {
    hits.iter().map(|h| [h.t.to_bits(), h.triangle, h.u.to_bits(), h.v.to_bits()]).collect()
}

pub(crate) fn scene_bits(hits: &[SceneHit]) -> Vec<[u32; 6]> {
    bytemuck::cast_slice(hits).to_vec()
}

pub(crate) fn ask(
    tree: &dyn Accelerator,
    points: &[[f32; 3]],
    options: &ClosestPointOptions<'_>,
) -> Vec<ClosestPoint> {
    let mut closest = vec![ClosestPoint { triangle: 7, ..ClosestPoint::NONE }; points.len()];
    tree.closest_points(points, &mut closest, options).expect("equal lengths");
    closest
}

/// Triangles with corners on a small grid, some of them without area: they touch at corners, edges
/// and in planes.
pub(crate) fn lattice(count: usize, size: f32, seed: u64) -> Vec<Triangle> {
    let mut random = Random::new(seed);
    let mut at = || (random.below(7) as f32 - 3.0) * size;
    (0..count).map(|_| [(); 3].map(|()| [at(), at(), at()])).collect()
}

/// Triangles whose coordinates are whole multiples of 2^-8: moved by powers of two they stay exact.
/// Closed, so that points can be inside.
pub(crate) fn coarse() -> Vec<[[f32; 3]; 3]> {
    let coarse = |x: f32| (x * 256.0).round() / 256.0;
    let ball = scenes::sphere(7, [0.0; 3], 1.0).triangles();
    ball.iter().map(|corners| corners.map(|p| p.map(coarse))).collect()
}

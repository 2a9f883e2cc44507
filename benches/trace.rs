//! Closest hit and any hit on the built-in scenes, by batch and one by one, and through a scene of one instance in place, on one
//! thread and two: `cargo bench --bench trace`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use splitplane::scene::builtin;
use splitplane_core::backend::scene::SceneAccelerator;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::scene::{Instance, Scene, SceneHit, SceneOptions};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};

/// Rays of each set.
const RAYS: usize = 1 << 16;

fn traces(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("trace");
    group.sample_size(10);
    group.throughput(Throughput::Elements(RAYS as u64));
    for name in ["cornell", "spheres", "stadium", "city:100000", "city:1000000"] {
        let scene = builtin::open(name).expect("a built-in scene");
        let mesh = scene.mesh().expect("a valid mesh");
        let accelerator = CpuBackend::new()
            .build_accelerator(&mesh, &BuildOptions::default())
            .expect("a tree of a built-in scene");
        let rays: Vec<Ray> = aim::rays(&mesh, Kind::ALL[0], RAYS, 1);
        let options = QueryOptions::default();
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut any = vec![false; rays.len()];
        let mut own = Scene::new();
        let geometry = own.add_mesh(&mesh).expect("a mesh");
        own.add_instance(Instance::in_place(geometry)).expect("an instance");
        let own = CpuBackend::new()
            .build_scene(&own, &BuildOptions::default())
            .expect("a scene of one instance");
        let mut scene_hits = vec![SceneHit::MISS; rays.len()];
        let scene_options = SceneOptions::default();
        for threads in [1, 2] {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            group.bench_function(BenchmarkId::new(format!("{name}/closest"), threads), |bench| {
                bench
                    .iter(|| pool.install(|| accelerator.closest_hits(&rays, &mut hits, &options)));
            });
            group.bench_function(BenchmarkId::new(format!("{name}/singly"), threads), |bench| {
                bench.iter(|| {
                    pool.install(|| accelerator.closest_hits_singly(&rays, &mut hits, &options))
                });
            });
            group.bench_function(BenchmarkId::new(format!("{name}/any"), threads), |bench| {
                bench.iter(|| pool.install(|| accelerator.any_hits(&rays, &mut any, &options)));
            });
            group.bench_function(BenchmarkId::new(format!("{name}/scene"), threads), |bench| {
                bench.iter(|| {
                    pool.install(|| own.closest_hits(&rays, &mut scene_hits, &scene_options))
                });
            });
            group.bench_function(BenchmarkId::new(format!("{name}/scene any"), threads), |bench| {
                bench.iter(|| pool.install(|| own.any_hits(&rays, &mut any, &scene_options)));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, traces);
criterion_main!(benches);

//! Closest hit and any hit of coherent and incoherent rays on procedural scenes.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::aim::{self, Kind};
use splitplane_test_support::scenes;
use std::hint::black_box;

/// Rays of a pinhole camera that looks at the middle of the unit cube.
fn camera(side: usize) -> Vec<Ray> {
    let at = |i: usize| (i as f32 + 0.5) / side as f32 - 0.5;
    (0..side * side)
        .map(|i| Ray::new([0.5, 0.5, 3.0], [at(i % side), at(i / side), -1.5]))
        .collect()
}

fn traces(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("trace");
    group.sample_size(20);
    let all = [
        scenes::sphere(36, [0.5; 3], 0.5).named("sphere 5k"),
        scenes::sphere(scenes::LARGE_SPHERE, [0.5; 3], 0.5).named("sphere 80k"),
        scenes::soup(80_000, 0.01, 1).named("soup 80k"),
    ];
    let most = std::thread::available_parallelism().map_or(1, |n| n.get());
    let options = QueryOptions::default();
    for scene in &all {
        let mesh = scene.mesh();
        let accelerator = CpuBackend::new().build(&mesh, &BuildOptions::default()).expect("a tree");
        let kinds =
            [("camera", camera(256)), ("random", aim::rays(&mesh, Kind::Random, 65_536, 1))];
        for (kind, rays) in &kinds {
            group.throughput(Throughput::Elements(rays.len() as u64));
            for threads in [1, most] {
                let pool =
                    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                let name = |query: &str| {
                    BenchmarkId::new(
                        format!("{query}/{}", scene.name),
                        format!("{kind}, {threads} threads"),
                    )
                };
                let mut hits = vec![Hit::MISS; rays.len()];
                group.bench_function(name("closest"), |bencher| {
                    pool.install(|| {
                        bencher.iter(|| {
                            accelerator.closest_hits(rays, &mut hits, &options).expect("hits");
                            black_box(&hits);
                        });
                    });
                });
                let mut occluded = vec![false; rays.len()];
                group.bench_function(name("any"), |bencher| {
                    pool.install(|| {
                        bencher.iter(|| {
                            accelerator.any_hits(rays, &mut occluded, &options).expect("hits");
                            black_box(&occluded);
                        });
                    });
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, traces);
criterion_main!(benches);

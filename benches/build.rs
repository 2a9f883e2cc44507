//! Builds of procedural scenes at several sizes and thread counts.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_cpu::CpuBackend;
use splitplane_test_support::scenes;
use std::hint::black_box;

fn builds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(20);
    let all = [
        scenes::sphere(36, [0.0; 3], 2.0).named("sphere 5k"),
        scenes::sphere(scenes::LARGE_SPHERE, [0.0; 3], 2.0).named("sphere 80k"),
        scenes::soup(5_000, 0.02, 1).named("soup 5k"),
        scenes::soup(80_000, 0.01, 1).named("soup 80k"),
    ];
    let most = std::thread::available_parallelism().map_or(1, |n| n.get());
    for scene in &all {
        let mesh = scene.mesh();
        group.throughput(Throughput::Elements(mesh.len() as u64));
        for threads in [1, most] {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let id = BenchmarkId::new(&scene.name, format!("{threads} threads"));
            // One backend for all rounds: its buffers are used again, as in an animation.
            let backend = CpuBackend::new();
            group.bench_function(id, |bencher| {
                pool.install(|| {
                    bencher.iter(|| {
                        black_box(backend.build(&mesh, &BuildOptions::default()).expect("a tree"))
                    });
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, builds);
criterion_main!(benches);

//! Build times on the built-in scenes, by size, preset and threads: `cargo bench --bench build`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use splitplane::scene::builtin;
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::Preset;
use splitplane_cpu::CpuBackend;

/// What is built for every frame; the offline builder is another matter.
const PRESETS: [Preset; 2] = [Preset::Fast, Preset::Balanced];

fn builds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    for name in ["cornell", "spheres", "stadium", "city:10000", "city:100000", "city:1000000"] {
        let scene = builtin::open(name).expect("a built-in scene");
        let mesh = scene.mesh().expect("a valid mesh");
        group.throughput(Throughput::Elements(mesh.len() as u64));
        for threads in [1, 2, 4] {
            let pool =
                rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            // One backend for all repeats: a rebuild reuses its buffers.
            let backend = CpuBackend::new();
            for preset in PRESETS {
                let options = BuildOptions::from(preset.config());
                let row = BenchmarkId::new(format!("{name}/{}", preset.name()), threads);
                group.bench_function(row, |bench| {
                    bench.iter(|| pool.install(|| backend.build_accelerator(&mesh, &options)));
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, builds);
criterion_main!(benches);

//! What it takes to move one of many objects: `cargo bench --bench update`.
//!
//! Moving one must not depend on how many triangles the objects have, and hardly on how many objects there are.

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use splitplane::scene::builtin;
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::scene::{Instance, Scene, Transform, translation};
use splitplane_cpu::CpuBackend;

/// Objects on a square grid, each 2 in diameter or so, moved up by `height`.
fn place(index: usize, side: usize, height: f32) -> Transform {
    translation([3.0 * (index % side) as f32, height, 3.0 * (index / side) as f32])
}

fn updates(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("update");
    for name in ["cornell", "city:10000", "city:100000"] {
        let opened = builtin::open(name).expect("a built-in scene");
        let mesh = opened.mesh().expect("a valid mesh");
        for count in [100_usize, 1_000, 10_000, 100_000] {
            let side = (count as f64).sqrt().ceil() as usize;
            let mut scene = Scene::new();
            let geometry = scene.add_mesh(&mesh).expect("a mesh");
            let names: Vec<_> = (0..count)
                .map(|i| scene.add_instance(Instance::new(geometry, place(i, side, 0.0))))
                .collect::<Result<_, _>>()
                .expect("instances");
            let backend = CpuBackend::new();
            let options = BuildOptions::default();
            let mut built = backend.build_scene(&scene, &options).expect("a scene");
            let mut moved = 0;
            group.bench_function(BenchmarkId::new(format!("move one/{name}"), count), |bench| {
                bench.iter_batched(
                    || {
                        moved += 1;
                        // Seven and `count` have no common factor: an object is at another height each time.
                        let (index, height) = (moved * 7919 % count, (moved % 7) as f32);
                        (index, place(index, side, height))
                    },
                    |(index, to)| {
                        scene.move_instance(names[index], to).expect("a place");
                        backend.update_scene(&mut built, &scene, &options).expect("an update")
                    },
                    BatchSize::SmallInput,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, updates);
criterion_main!(benches);

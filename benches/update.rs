//! What it takes to move one of many objects, and to change many small meshes at once: `cargo bench --bench update`.
//!
//! Moving one must not depend on how many triangles the objects have, and hardly on how many objects there are. What many meshes take
//! must grow with their number, and not with its square.

use std::time::{Duration, Instant};

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use splitplane::scene::builtin;
use splitplane_core::backend::scene::{PendingUpdate, SceneUpdater};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
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

/// A mesh of two triangles, which differs by its number.
fn small(number: usize) -> [[[f32; 3]; 3]; 2] {
    let x = 1.0 + (number % 100) as f32;
    [
        [[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[x, 0.0, 0.0], [x, 1.0, 0.0], [0.0, 1.0, 0.0]],
    ]
}

/// All meshes of a scene change in each update, by either way that builds them beside the scene.
fn many_meshes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("update");
    let (backend, options) = (CpuBackend::new(), BuildOptions::default());
    for count in [1_000_usize, 10_000, 30_000] {
        let mut scene = Scene::new();
        let names: Vec<_> = (0..count)
            .map(|number| scene.add_mesh(&Mesh::soup(&small(number)).expect("a mesh")))
            .collect::<Result<_, _>>()
            .expect("meshes");
        for (number, name) in names.iter().enumerate() {
            let place = translation([number as f32, 0.0, 0.0]);
            scene.add_instance(Instance::new(*name, place)).expect("an instance");
        }
        let mut built = backend.build_scene(&scene, &options).expect("a scene");
        let mut frame = 0;
        let mut change = |scene: &mut Scene| {
            frame += 1;
            for (number, name) in names.iter().enumerate() {
                let mesh = small(number + frame);
                scene.replace_mesh(*name, &Mesh::soup(&mesh).expect("a mesh")).expect("a name");
            }
        };
        group.bench_function(BenchmarkId::new("pending, small meshes", count), |bench| {
            bench.iter_custom(|times| {
                let mut took = Duration::ZERO;
                for _ in 0..times {
                    change(&mut scene);
                    let start = Instant::now();
                    let pending = PendingUpdate::begin(&backend, built.scene(), &scene);
                    let mut pending = pending.expect("an update");
                    pending.build(&backend, &options).expect("trees");
                    pending.finish(&backend, &mut built, &scene, &options).expect("an update");
                    took += start.elapsed();
                }
                took
            });
        });
        let mut updater = SceneUpdater::new(u64::MAX);
        group.bench_function(BenchmarkId::new("with spares, small meshes", count), |bench| {
            bench.iter_custom(|times| {
                let mut took = Duration::ZERO;
                for _ in 0..times {
                    change(&mut scene);
                    let start = Instant::now();
                    updater.update(&backend, &mut built, &scene, &options).expect("an update");
                    took += start.elapsed();
                }
                took
            });
        });
    }
    group.finish();
}

criterion_group!(benches, updates, many_meshes);
criterion_main!(benches);

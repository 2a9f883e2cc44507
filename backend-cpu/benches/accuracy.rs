//! What each accuracy costs: `cargo bench -p splitplane-cpu --bench accuracy -- DIR [REPEATS] [RAYS]`.
//!
//! DIR holds `verts.f32`, `index.u32` and any of `SET.rays`, as `splitplane-peer` takes them. Of each set about
//! RAYS rays, or all, are traced on one thread as one batch, by each accuracy in turn, REPEATS times;
//! of each the least time counts, in ns a ray. It is CPU time where the system tells it.
//!
//! As many closest points, at most 65,536, are asked of points anywhere in the mesh's box (`box`) and of points within a hundredth of its diagonal of a triangle (`skin`); of
//! these accuracies `fast` and `watertight` are the same.

use std::path::Path;
use std::time::Instant;

use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::query::closest_point::{ClosestPoint, ClosestPointOptions};
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::random::Random;

const SETS: [&str; 4] = ["primary", "shadow", "bounce", "chords"];

/// CPU time of this thread (Linux), or the clock, in nanoseconds.
fn now(start: Instant) -> f64 {
    #[cfg(all(target_os = "linux", target_pointer_width = "64"))]
    {
        unsafe extern "C" {
            fn clock_gettime(clock: i32, time: *mut [i64; 2]) -> i32;
        }
        const THREAD_CPU: i32 = 3;
        let mut time = [0; 2];
        // SAFETY: POSIX; `timespec` is two words of 64 bits there.
        if unsafe { clock_gettime(THREAD_CPU, &raw mut time) } == 0 {
            return time[0] as f64 * 1e9 + time[1] as f64;
        }
    }
    start.elapsed().as_secs_f64() * 1e9
}

/// About `most` of the rays, in 32 runs of neighbours from all over.
fn some(rays: &[Ray], most: usize) -> Vec<Ray> {
    if rays.len() <= most {
        return rays.to_vec();
    }
    rays.chunks(rays.len() / 32).flat_map(|run| &run[..run.len().min(most / 32)]).copied().collect()
}

fn read<T: bytemuck::Pod>(path: &Path) -> Vec<T> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

/// The least time of each accuracy, in ns a ray.
fn times(repeats: usize, rays: usize, mut run: impl FnMut(&QueryOptions<'_>)) -> [f64; 3] {
    let start = Instant::now();
    let mut least = [f64::INFINITY; 3];
    for _ in 0..=repeats {
        for (least, accuracy) in least.iter_mut().zip(Accuracy::ALL) {
            let options = QueryOptions { accuracy, ..QueryOptions::default() };
            let before = now(start);
            run(&options);
            *least = least.min((now(start) - before) / rays as f64);
        }
    }
    least
}

fn measure(tree: &CpuAccelerator, dir: &Path, repeats: usize, most: usize) {
    println!("| set | query | fast | watertight | exact | watertight : fast | exact : fast |");
    println!("|---|---|---:|---:|---:|---:|---:|");
    for set in SETS.into_iter().filter(|set| dir.join(format!("{set}.rays")).exists()) {
        let raw: Vec<[f32; 8]> = read(&dir.join(format!("{set}.rays")));
        let rays: Vec<Ray> = raw
            .iter()
            .map(|&[ox, oy, oz, dx, dy, dz, t_min, t_max]| {
                Ray::new([ox, oy, oz], [dx, dy, dz]).with_limits(t_min, t_max)
            })
            .collect();
        let rays = some(&rays, most);
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut any = vec![false; rays.len()];
        let closest = times(repeats, rays.len(), |options| {
            tree.closest_hits(&rays, &mut hits, options).expect("equal lengths");
        });
        let occluded = times(repeats, rays.len(), |options| {
            tree.any_hits(&rays, &mut any, options).expect("equal lengths");
        });
        for (query, [fast, watertight, exact]) in [("closest", closest), ("any", occluded)] {
            println!(
                "| {set} | {query} | {fast:.1} | {watertight:.1} | {exact:.1} | {:.2} | {:.2} |",
                watertight / fast,
                exact / fast
            );
        }
    }
}

fn measure_points(tree: &CpuAccelerator, mesh: &Mesh<'_>, repeats: usize, most: usize) {
    let bounds = tree.tree().bounds;
    let mut random = Random::new(1);
    for set in ["box", "skin"] {
        let points: Vec<[f32; 3]> = (0..most.min(1 << 16))
            .map(|_| match set {
                "box" => [0, 1, 2].map(|axis| {
                    random.between(f64::from(bounds.lo[axis]), f64::from(bounds.hi[axis])) as f32
                }),
                _ => {
                    let corners = mesh.triangle(random.below(mesh.len()));
                    let (weights, away) = (random.barycentric(), random.direction());
                    let far = 0.01 * bounds.diagonal() * random.unit();
                    [0, 1, 2].map(|axis| {
                        let on = (0..3).map(|k| weights[k] * f64::from(corners[k][axis]));
                        (on.sum::<f64>() + far * away[axis]) as f32
                    })
                }
            })
            .collect();
        let mut closest = vec![ClosestPoint::NONE; points.len()];
        let [fast, watertight, exact] = times(repeats, points.len(), |options| {
            let options = ClosestPointOptions { accuracy: options.accuracy, ..Default::default() };
            tree.closest_points(&points, &mut closest, &options).expect("equal lengths");
        });
        println!(
            "| {set} | closest point | {fast:.1} | {watertight:.1} | {exact:.1} | {:.2} | {:.2} |",
            watertight / fast,
            exact / fast
        );
    }
}

fn main() {
    // Cargo adds `--bench`.
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let Some(dir) = arguments.first().map(Path::new) else {
        // As when all benchmarks are run.
        eprintln!("usage: cargo bench -p splitplane-cpu --bench accuracy -- DIR [REPEATS] [RAYS]");
        return;
    };
    let number = |place: usize, default: usize| {
        arguments.get(place).map_or(default, |text| text.parse().expect("a number"))
    };
    let vertices: Vec<[f32; 3]> = read(&dir.join("verts.f32"));
    let indices: Vec<[u32; 3]> = read(&dir.join("index.u32"));
    let mesh = Mesh::indexed(&vertices, &indices).expect("a mesh");
    let tree =
        CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let (repeats, most) = (number(1, 9), number(2, usize::MAX));
    pool.install(|| {
        measure(&tree, dir, repeats, most);
        measure_points(&tree, &mesh, repeats, most);
    });
}

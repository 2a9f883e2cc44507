//! What a ray costs where sizes in a scene differ: `cargo bench -p splitplane-cpu --bench scales`.
//!
//! A soup of 30,000 unit triangles is the base. Its variants have the same triangles and one thing more or
//! changed that rounding depends on: a large triangle below, a coordinate next to 0, a triangle without size,
//! another scale, rays from far away. All variants take turns, in one thread, and the least time of each
//! counts. Printed are ratios to the base. With part of a variant's name behind `--`, only that one and its base.

use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::aimed;
use splitplane_test_support::random::Random;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Rays of a batch.
const RAYS: usize = 4096;
/// How often all variants take their turn.
const ROUNDS: usize = 15;
/// What no variant should cost more than, in times of the base.
const MOST: f64 = 1.5;
/// Half the extent of the soup.
const HALF: f64 = 40.0;

/// The base: triangles of about unit size, and rays between random points around them.
fn soup(random: &mut Random) -> Vec<Triangle> {
    (0..30_000)
        .map(|_| {
            let at = [(); 3].map(|()| random.between(-HALF, HALF));
            [(); 3].map(|()| [0, 1, 2].map(|k| (at[k] + random.between(-0.5, 0.5)) as f32))
        })
        .collect()
}

fn rays(random: &mut Random) -> Vec<([f64; 3], [f64; 3])> {
    (0..RAYS)
        .map(|_| {
            let mut point = |half: f64| [(); 3].map(|()| random.between(-half, half));
            (point(1.5 * HALF), point(HALF))
        })
        .collect()
}

/// A scene and rays to compare with the base.
struct Variant {
    name: String,
    triangles: Vec<Triangle>,
    rays: Vec<Ray>,
    /// Index of the variant whose rays do the same without what is measured.
    base: usize,
}

fn ray((from, to): &([f64; 3], [f64; 3]), scale: f64) -> Ray {
    aimed(from.map(|x| (x * scale) as f32), to.map(|x| x * scale))
}

/// The same line from farther away.
fn from_afar((from, to): &([f64; 3], [f64; 3]), extents: f64) -> Ray {
    let way = [0, 1, 2].map(|k| from[k] - to[k]);
    let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
    let far = [0, 1, 2].map(|k| (to[k] + way[k] / length * extents * 2.0 * HALF) as f32);
    aimed(far, *to)
}

fn variants() -> Vec<Variant> {
    let mut random = Random::new(9);
    let (base, lines) = (soup(&mut random), rays(&mut random));
    let near: Vec<Ray> = lines.iter().map(|line| ray(line, 1.0)).collect();
    let mut all = Vec::new();
    let mut add = |name: String, triangles: Vec<Triangle>, rays: &[Ray], base: usize| {
        all.push(Variant { name, triangles, rays: rays.to_vec(), base });
    };
    add("base".into(), base.clone(), &near, 0);
    for power in [3, 4, 5, 6] {
        let size = 10f32.powi(power);
        let y = -1.01 * HALF as f32;
        let quad = [[-size, y, -size], [size, y, -size], [size, y, size], [-size, y, size]];
        let mut with = base.clone();
        with.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
        add(format!("quad of {size:e} below"), with, &near, 0);
    }
    // As many as leaves are not widened for, and more.
    for (rows, size) in [(3, 1e6f32), (5, 1e6), (10, 1e6), (30, 1e6)] {
        let mut with = base.clone();
        let at = |i: i32| size * (2.0 * i as f32 / rows as f32 - 1.0);
        let corner = |i: i32, j: i32| [at(i), -1.01 * HALF as f32, at(j)];
        for (i, j) in (0..rows).flat_map(|i| (0..rows).map(move |j| (i, j))) {
            let [a, b, c, d] =
                [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            with.extend([[a, b, c], [a, c, d]]);
        }
        add(format!("{} triangles below", 2 * rows * rows), with, &near, 0);
    }
    for least in [1e-10, 1e-20, 1e-30] {
        let mut with = base.clone();
        with[7][1][2] = least;
        add(format!("a coordinate of {least:e}"), with, &near, 0);
    }
    for size in [1e-6, 1e-13, 1e-20] {
        let mut with = base.clone();
        with[7] = [[1.0, 1.0, 0.0], [1.0, 1.0, size], [1.0, 1.0, 0.5 * size]];
        add(format!("a sliver of {size:e}"), with, &near, 0);
    }
    for scale in [1e-9, 1e-6, 1e6, 1e9] {
        let of = |x: f32| (f64::from(x) * scale) as f32;
        let with = base.iter().map(|corners| corners.map(|corner| corner.map(of))).collect();
        let rays: Vec<Ray> = lines.iter().map(|line| ray(line, scale)).collect();
        add(format!("all times {scale:e}"), with, &rays, 0);
    }
    // All from outside: the base starts within reach.
    let outside: Vec<Ray> = lines.iter().map(|line| from_afar(line, 3.0)).collect();
    let base_outside = all.len();
    all.push(Variant {
        name: "from 3 extents away".into(),
        triangles: base.clone(),
        rays: outside,
        base: base_outside,
    });
    for extents in [90.0, 110.0, 450.0, 4500.0, 1e6] {
        let rays = lines.iter().map(|line| from_afar(line, extents)).collect();
        let name = format!("from {extents:e} extents away");
        all.push(Variant { name, triangles: base.clone(), rays, base: base_outside });
    }
    all
}

/// The ways to ask.
const WAYS: [&str; 3] = ["closest", "any", "closest singly"];

fn time(accelerator: &CpuAccelerator, rays: &[Ray], accuracy: Accuracy, way: usize) -> Duration {
    let options = QueryOptions { accuracy, ..QueryOptions::default() };
    let mut hits = vec![Hit::MISS; rays.len()];
    let mut any = vec![false; rays.len()];
    let start = Instant::now();
    match way {
        0 => accelerator.closest_hits(rays, &mut hits, &options).map(drop),
        1 => accelerator.any_hits(rays, &mut any, &options).map(drop),
        _ => accelerator.closest_hits_singly(rays, &mut hits, &options).map(drop),
    }
    .expect("equal lengths");
    let taken = start.elapsed();
    black_box((hits, any));
    taken
}

/// Whether a variant is asked for, or the base of one that is.
fn is_wanted(variant: &Variant, all: &[Variant], only: Option<&str>) -> bool {
    let Some(only) = only else { return true };
    let is_base = |of: &Variant| of.name.contains(only) && all[of.base].name == variant.name;
    variant.name.contains(only) || all.iter().any(is_base)
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let only = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    let mut worst = 0.0f64;
    for preset in [Preset::Fast, Preset::Best] {
        let variants = variants();
        let options = BuildOptions::from(preset.config());
        let trees: Vec<CpuAccelerator> = variants
            .iter()
            .map(|variant| {
                let mesh = Mesh::soup(&variant.triangles).expect("a mesh");
                CpuBackend::new().build_accelerator(&mesh, &options).expect("a tree")
            })
            .collect();
        for accuracy in [Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact] {
            let mut least = vec![[Duration::MAX; WAYS.len()]; variants.len()];
            pool.install(|| {
                for _ in 0..ROUNDS {
                    for ((variant, tree), least) in variants.iter().zip(&trees).zip(&mut least) {
                        if !is_wanted(variant, &variants, only.as_deref()) {
                            continue;
                        }
                        for (way, least) in least.iter_mut().enumerate() {
                            *least = (*least).min(time(tree, &variant.rays, accuracy, way));
                        }
                    }
                }
            });
            println!(
                "preset {}, accuracy {}",
                preset.name(),
                format!("{accuracy:?}").to_lowercase()
            );
            println!("  {:<26}{:>16}{:>16}{:>16}", "", WAYS[0], WAYS[1], WAYS[2]);
            for (variant, times) in variants.iter().zip(&least) {
                if !is_wanted(variant, &variants, only.as_deref()) {
                    continue;
                }
                print!("  {:<26}", variant.name);
                for (way, time) in times.iter().enumerate() {
                    let nanoseconds = time.as_nanos() as f64 / RAYS as f64;
                    let ratio = time.as_secs_f64() / least[variant.base][way].as_secs_f64();
                    worst = worst.max(ratio);
                    print!("{nanoseconds:>8.0} {ratio:>7.2}");
                }
                println!();
            }
        }
    }
    println!("greatest ratio {worst:.2}; {MOST} is the most there should be");
}

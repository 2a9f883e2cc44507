//! What odd rays cost beside normal ones: `cargo bench -p splitplane-cpu --bench odd_rays`, with part
//! of a set's name behind `--` for that set only.
//!
//! Each kind of odd ray is made from the normal rays by one change. Batches of all kinds take turns,
//! in one thread, and the least time of each kind counts: what else the machine does only ever adds.
//! Printed are ratios to the normal rays, all odd and every other one odd, for closest hit and any
//! hit, by batch and one by one.

use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_test_support::aim::aimed;
use splitplane_test_support::random::Random;
use splitplane_test_support::scenes;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Rays of a batch: a fraction of a millisecond, so that some batches are not interrupted however busy
/// the machine is.
const RAYS: usize = 1024;
/// How often all kinds take their turn.
const ROUNDS: usize = 200;
/// What no kind should cost more than, in times of a normal ray.
const MOST: f64 = 1.5;

type Change = fn(&mut Ray);

/// Every kind of odd ray, and whether it can hit anything at all.
const KINDS: [(&str, bool, Change); 21] = [
    ("NaN in origin", false, |r| r.origin[1] = f32::NAN),
    ("NaN in direction", false, |r| r.direction[2] = f32::NAN),
    ("NaN everywhere", false, |r| {
        *r = Ray::new([f32::NAN; 3], [f32::NAN; 3]).with_limits(f32::NAN, f32::NAN);
    }),
    ("NaN t_min", false, |r| r.t_min = f32::NAN),
    ("NaN t_max", false, |r| r.t_max = f32::NAN),
    ("infinite origin", false, |r| r.origin[0] = f32::INFINITY),
    ("infinite direction", false, |r| r.direction[0] = f32::NEG_INFINITY),
    ("zero direction", false, |r| r.direction = [0.0, -0.0, 0.0]),
    ("subnormal direction", false, |r| r.direction = r.direction.map(|d| d.signum() * 1e-40)),
    ("t_min above t_max", false, |r| (r.t_min, r.t_max) = (2.0, 1.0)),
    ("infinite t_min", false, |r| r.t_min = f32::INFINITY),
    ("t_min -infinite", true, |r| r.t_min = f32::NEG_INFINITY),
    ("t_min -0", true, |r| r.t_min = -0.0),
    ("t_min subnormal", true, |r| r.t_min = 1e-40),
    ("t_max subnormal", true, |r| r.t_max = 1e-40),
    ("origin part -0", true, |r| r.origin[2] = -0.0),
    ("origin part subnormal", true, |r| r.origin[2] = -1e-41),
    ("direction part +0", true, |r| r.direction[0] = 0.0),
    ("direction part -0", true, |r| r.direction[0] = -0.0),
    ("direction part subnormal", true, |r| r.direction[0] = -1e-41),
    ("direction least normal", true, |r| {
        let largest = r.direction.iter().fold(0.0f32, |m, d| m.max(d.abs()));
        r.direction = r.direction.map(|d| d / largest * 1e-37);
    }),
];

/// From random points around towards random points within the bounds, without order.
fn random_rays(mesh: &Mesh<'_>, accelerator: &CpuAccelerator) -> Vec<Ray> {
    let bounds = accelerator.tree().bounds;
    let mut random = Random::new(5);
    let mut point = |pad: f64| {
        [0, 1, 2].map(|k| {
            let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
            random.between(lo - pad * (hi - lo), hi + pad * (hi - lo))
        })
    };
    assert!(!mesh.is_empty());
    (0..RAYS).map(|_| aimed(point(0.3).map(|x| x as f32), point(0.0))).collect()
}

/// Through the pixels of a square, from one eye.
fn primary_rays(accelerator: &CpuAccelerator) -> Vec<Ray> {
    let bounds = accelerator.tree().bounds;
    let side = (RAYS as f64).sqrt() as usize;
    let at = |k: usize, part: f64| {
        let (lo, hi) = (f64::from(bounds.lo[k]), f64::from(bounds.hi[k]));
        lo + part * (hi - lo)
    };
    let eye = [at(0, 0.4) as f32, at(1, 0.6) as f32, at(2, 1.4) as f32];
    (0..RAYS)
        .map(|i| {
            let [x, y] = [i % side, i / side].map(|x| (x as f64 + 0.5) / side as f64);
            aimed(eye, [at(0, x), at(1, y), at(2, 0.5)])
        })
        .collect()
}

/// The four ways to ask.
const WAYS: [&str; 4] = ["closest", "any", "closest singly", "any singly"];

fn time(accelerator: &CpuAccelerator, rays: &[Ray], way: usize) -> Duration {
    let options = QueryOptions::default();
    let mut hits = vec![Hit::MISS; rays.len()];
    let mut any = vec![false; rays.len()];
    let start = Instant::now();
    match way {
        0 => accelerator.closest_hits(rays, &mut hits, &options).map(drop),
        1 => accelerator.any_hits(rays, &mut any, &options).map(drop),
        2 => accelerator.closest_hits_singly(rays, &mut hits, &options).map(drop),
        _ => accelerator.any_hits_singly(rays, &mut any, &options).map(drop),
    }
    .expect("equal lengths");
    let taken = start.elapsed();
    black_box((hits, any));
    taken
}

fn measure(name: &str, accelerator: &CpuAccelerator, normal: &[Ray]) -> f64 {
    // The normal rays, then for each kind all odd and every other one odd.
    let mut sets = vec![normal.to_vec()];
    for (_, _, change) in KINDS {
        for step in [1, 2] {
            let mut rays = normal.to_vec();
            rays.iter_mut().step_by(step).for_each(change);
            sets.push(rays);
        }
    }
    let mut least = vec![[Duration::MAX; WAYS.len()]; sets.len()];
    for _ in 0..ROUNDS {
        for (rays, least) in sets.iter().zip(&mut least) {
            for (way, least) in least.iter_mut().enumerate() {
                *least = (*least).min(time(accelerator, rays, way));
            }
        }
    }
    let nanoseconds = |set: usize, way: usize| least[set][way].as_nanos() as f64 / RAYS as f64;
    println!("{name}: normal rays, ns a ray");
    for (way, title) in WAYS.iter().enumerate() {
        println!("  {title:<16}{:8.1}", nanoseconds(0, way));
    }
    println!("times of a normal ray: all odd / every other one odd");
    println!("  {:<26}{:>16}{:>16}{:>16}{:>16}", "", WAYS[0], WAYS[1], WAYS[2], WAYS[3]);
    let mut worst = 0.0f64;
    for (kind, (title, ..)) in KINDS.iter().enumerate() {
        print!("  {title:<26}");
        for way in 0..WAYS.len() {
            let ratio = |half: usize| nanoseconds(1 + 2 * kind + half, way) / nanoseconds(0, way);
            worst = worst.max(ratio(0)).max(ratio(1));
            print!("{:>9.2} / {:4.2}", ratio(0), ratio(1));
        }
        println!();
    }
    worst
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let only = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    let mut worst = 0.0f64;
    for scene in [scenes::soup(100_000, 0.02, 3), scenes::sphere(128, [0.0; 3], 1.0)] {
        let (name, mesh) = (&scene.name, scene.mesh());
        let accelerator =
            CpuBackend::new().build_accelerator(&mesh, &BuildOptions::default()).expect("a tree");
        for (kind, rays) in
            [("random", random_rays(&mesh, &accelerator)), ("primary", primary_rays(&accelerator))]
        {
            let title = format!("{name}, {kind}");
            if only.as_ref().is_none_or(|only| title.contains(only)) {
                let measured = pool.install(|| measure(&title, &accelerator, &rays));
                worst = worst.max(measured);
            }
        }
    }
    println!("greatest ratio {worst:.2}; {MOST} is the most there should be");
}

//! `splitplane-peer NAME DIR THREADS REPS PREFIX`: one measurement, in the form that a comparison
//! harness for ray tracing libraries expects of a program it starts.
//!
//! Reads `DIR/verts.f32`, `DIR/index.u32` and `DIR/SET.rays` (8 `f32` a ray: origin, direction,
//! t_min, t_max); writes `PREFIX.SET.hits` (`f32` t, infinity for a miss, and `u32` triangle) and
//! `PREFIX.SET.any` (a byte a ray); prints one JSON object. NAME is `splitplane-PRESET`, then any of
//! `-watertight|-leaky` (accuracy), `-K_T:K_I:W` (costs) and `-single|-batch` (path): `splitplane-fast`,
//! `splitplane-fast-single`, `splitplane-fast-leaky`. A name that asks for what this version does
//! not have is an error.

use std::path::Path;
use std::time::Instant;

use serde_json::{Map, Value, json};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};

const SETS: [&str; 4] = ["primary", "shadow", "bounce", "chords"];
/// Repeats stop once this much time has gone into one figure.
const ENOUGH_SECONDS: f64 = 4.0;

/// What NAME asks for.
struct Plan {
    config: BuildConfig,
    options: QueryOptions,
    single: bool,
}

impl Plan {
    fn parse(name: &str) -> Result<Plan, String> {
        let mut words = name.split('-');
        if words.next() != Some("splitplane") {
            return Err(format!("{name}: names begin with splitplane-"));
        }
        let preset = match words.next() {
            Some("fast") => Preset::Fast,
            Some(other) => return Err(format!("{name}: there is no preset {other}")),
            None => return Err(format!("{name}: name a preset, as in splitplane-fast")),
        };
        let mut plan = Plan {
            config: BuildConfig { preset, ..BuildConfig::default() },
            options: QueryOptions::default(),
            single: false,
        };
        for word in words {
            match word {
                "watertight" => plan.options.accuracy = Accuracy::Watertight,
                "leaky" => plan.options.accuracy = Accuracy::Fast,
                "single" => plan.single = true,
                "batch" => plan.single = false,
                // K_T:K_I:W, for tuning.
                word if word.contains(':') => {
                    let numbers: Vec<u32> =
                        word.split(':').filter_map(|number| number.parse().ok()).collect();
                    let [traversal, intersection, width] = numbers[..] else {
                        return Err(format!("{name}: costs are K_T:K_I:W"));
                    };
                    plan.config.traversal_cost = traversal;
                    plan.config.intersection_cost = intersection;
                    plan.config.block_width = width;
                }
                _ => return Err(format!("{name}: this version does not know {word}")),
            }
        }
        Ok(plan)
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, dir, threads, reps, prefix] = &arguments[..] else {
        eprintln!("usage: splitplane-peer NAME DIR THREADS REPS PREFIX");
        std::process::exit(2);
    };
    match measure(name, Path::new(dir), threads, reps, prefix) {
        Ok(report) => println!("{report}"),
        Err(error) => {
            eprintln!("splitplane-peer: {error}");
            std::process::exit(1);
        }
    }
}

fn measure(
    name: &str,
    dir: &Path,
    threads: &str,
    reps: &str,
    prefix: &str,
) -> Result<Value, String> {
    let number = |text: &str| text.parse::<usize>().map_err(|_| format!("{text}: not a number"));
    let (threads, reps) = (number(threads)?, number(reps)?);
    let plan = Plan::parse(name)?;
    let vertices: Vec<[f32; 3]> = read(&dir.join("verts.f32"))?;
    let indices: Vec<[u32; 3]> = read(&dir.join("index.u32"))?;
    let mesh = Mesh::indexed(&vertices, &indices).map_err(|error| error.to_string())?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| error.to_string())?;
    let backend = CpuBackend::new();
    let options = BuildOptions::from(plan.config);
    let build = || pool.install(|| backend.build_accelerator(&mesh, &options));

    // The first build warms up and is not counted.
    let mut accelerator = build().map_err(|error| error.to_string())?;
    let peak = accelerator.summary().peak_bytes + accelerator.query_bytes();
    let mut build_ms = Vec::new();
    for _ in 0..reps {
        drop(accelerator);
        let start = Instant::now();
        accelerator = build().map_err(|error| error.to_string())?;
        build_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let mut sets = Map::new();
    for set in SETS {
        let raw: Vec<[f32; 8]> = read(&dir.join(format!("{set}.rays")))?;
        let rays: Vec<Ray> = raw
            .iter()
            .map(|&[ox, oy, oz, dx, dy, dz, t_min, t_max]| {
                Ray::new([ox, oy, oz], [dx, dy, dz]).with_limits(t_min, t_max)
            })
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut any = vec![false; rays.len()];
        closest(&pool, &accelerator, &plan, &rays, &mut hits);
        let closest_s = repeat(reps, || closest(&pool, &accelerator, &plan, &rays, &mut hits));
        occluded(&pool, &accelerator, &plan, &rays, &mut any);
        let any_s = repeat(reps, || occluded(&pool, &accelerator, &plan, &rays, &mut any));
        let records: Vec<[u32; 2]> =
            hits.iter().map(|hit| [hit.t.to_bits(), hit.triangle]).collect();
        write(&format!("{prefix}.{set}.hits"), bytemuck::cast_slice(&records))?;
        let bytes: Vec<u8> = any.iter().map(|&hit| u8::from(hit)).collect();
        write(&format!("{prefix}.{set}.any"), &bytes)?;
        let figures =
            json!({"rays": rays.len(), "stride": 1, "closest_s": closest_s, "any_s": any_s});
        sets.insert(set.into(), figures);
    }
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "build_ms": build_ms,
        "struct_bytes": accelerator.query_bytes(),
        "build_peak_bytes": peak,
        "sets": sets,
    }))
}

fn closest(
    pool: &rayon::ThreadPool,
    accelerator: &CpuAccelerator,
    plan: &Plan,
    rays: &[Ray],
    hits: &mut [Hit],
) {
    let result = pool.install(|| {
        if plan.single {
            accelerator.closest_hits_singly(rays, hits, &plan.options)
        } else {
            accelerator.closest_hits(rays, hits, &plan.options)
        }
    });
    result.expect("rays and hits are of equal length");
}

fn occluded(
    pool: &rayon::ThreadPool,
    accelerator: &CpuAccelerator,
    plan: &Plan,
    rays: &[Ray],
    any: &mut [bool],
) {
    let result = pool.install(|| {
        if plan.single {
            accelerator.any_hits_singly(rays, any, &plan.options)
        } else {
            accelerator.any_hits(rays, any, &plan.options)
        }
    });
    result.expect("rays and answers are of equal length");
}

fn repeat(reps: usize, mut run: impl FnMut()) -> Vec<f64> {
    let (mut seconds, whole) = (Vec::new(), Instant::now());
    loop {
        let start = Instant::now();
        run();
        seconds.push(start.elapsed().as_secs_f64());
        if seconds.len() >= reps || whole.elapsed().as_secs_f64() > ENOUGH_SECONDS {
            return seconds;
        }
    }
}

fn read<T: bytemuck::Pod>(path: &Path) -> Result<Vec<T>, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let whole = bytes.len() / size_of::<T>() * size_of::<T>();
    Ok(bytemuck::allocation::pod_collect_to_vec(&bytes[..whole]))
}

fn write(path: &str, bytes: &[u8]) -> Result<(), String> {
    std::fs::write(path, bytes).map_err(|error| format!("{path}: {error}"))
}

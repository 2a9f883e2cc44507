//! `splitplane-peer NAME DIR THREADS REPS PREFIX`: one measurement, in the form that a comparison
//! harness for ray tracing libraries expects of a program it starts.
//!
//! Reads `DIR/verts.f32`, `DIR/index.u32` and `DIR/SET.rays` (8 `f32` a ray: origin, direction,
//! t_min, t_max); writes `PREFIX.SET.hits` (`f32` t, infinity for a miss, and `u32` triangle) and
//! `PREFIX.SET.any` (a byte a ray); prints one JSON object. NAME is `splitplane-PRESET` or
//! `splitplane-wgpu-PRESET` (the GPU that `WGPU_ADAPTER_NAME` names, or the best one; `splitplane-wgpu`
//! alone is preset `fast`), then any of `-watertight|-leaky|-exact` (accuracy), `-single|-batch` (path), `-compact` (layout on the CPU) and the
//! knobs of the build: `-K_T:K_I:W` (costs), `-bN` (bins), `-tN` (T), `-eN` (C_e in percent), `-noclip`,
//! `-nN` (empty bonus in percent), `-rN` (bad splits). So `splitplane-fast`, `splitplane-fast-single`,
//! `splitplane-wgpu-fast-leaky`, `splitplane-balanced-1:4:16-b64-t32-e10-noclip`. Percentages become
//! the nearest 256th. A name that asks for what this version does not have is an error, and so is a
//! knob that the preset does not have or a value out of its range.
//!
//! On both backends a batch is handed over whole, since chunks of some thousand rays fill no GPU. The
//! GPU's times are from host memory to host memory; its builds end with a copy of the tree on the host.
//! A sixth argument, `instances`, `near` or `knn`, asks for the harness's task of that name: see the file of that name.
//! `PEERS_CLOCK=cpu` in the environment asks for CPU time in place of the time that passes.

mod clock;
mod instances;
mod knn;
mod near;

use clock::Clock;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuAccelerator, CpuBackend};
use splitplane_wgpu::{Gpu, OpenOptions, WgpuAccelerator, WgpuBackend};

const SETS: [&str; 4] = ["primary", "shadow", "bounce", "chords"];
/// Repeats stop once this much time has gone into one figure.
const ENOUGH_SECONDS: f64 = 4.0;

/// What NAME asks for.
struct Plan {
    gpu: bool,
    config: BuildConfig,
    options: QueryOptions<'static>,
    layout: QueryLayout,
    single: bool,
}

impl Plan {
    fn parse(name: &str) -> Result<Plan, String> {
        let mut words = name.split('-').peekable();
        if words.next() != Some("splitplane") {
            return Err(format!("{name}: names begin with splitplane-"));
        }
        let gpu = words.next_if_eq(&"wgpu").is_some();
        let preset = match words.next() {
            Some("fast") => Preset::Fast,
            Some("narrow") => Preset::Narrow,
            Some("balanced") => Preset::Balanced,
            Some("best") => Preset::Best,
            None if gpu => Preset::Fast,
            Some(other) => return Err(format!("{name}: there is no preset {other}")),
            None => return Err(format!("{name}: name a preset, as in splitplane-fast")),
        };
        let mut plan = Plan {
            gpu,
            config: preset.config(),
            options: QueryOptions::default(),
            layout: QueryLayout::Fast,
            single: false,
        };
        for word in words {
            match word {
                "watertight" => plan.options.accuracy = Accuracy::Watertight,
                "leaky" => plan.options.accuracy = Accuracy::Fast,
                "exact" => plan.options.accuracy = Accuracy::Exact,
                "single" => plan.single = true,
                "batch" => plan.single = false,
                "compact" => plan.layout = QueryLayout::Compact,
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
                "noclip" => plan.config.clip = false,
                word => {
                    let Some((knob, value)) = knob(word) else {
                        return Err(format!("{name}: this version does not know {word}"));
                    };
                    let Some(field) = knob(&mut plan.config) else {
                        let preset = preset.name();
                        return Err(format!("{name}: a knob that preset {preset} does not have"));
                    };
                    *field = value;
                }
            }
        }
        let config = &plan.config;
        config.validate().map_err(|error| format!("{name}: {error}"))?;
        if plan.gpu && plan.layout == QueryLayout::Compact {
            return Err(format!("{name}: a GPU has one layout"));
        }
        if plan.gpu && plan.single {
            return Err(format!("{name}: single rays are answered on the CPU"));
        }
        Ok(plan)
    }
}

/// The knob that a word such as `b64` names, and its value; `None` for another word.
fn knob(word: &str) -> Option<(Knob, u32)> {
    let (letter, digits) = word.split_at_checked(1)?;
    let number = digits.parse::<u32>().ok()?;
    let of_256 = u32::try_from((u64::from(number) * 256 + 50) / 100).unwrap_or(u32::MAX);
    Some(match letter {
        "b" => (BuildConfig::bins_mut, number),
        "t" => (|config| Some(&mut config.stages_mut()?.small_node_limit), number),
        "e" => (|config| Some(&mut config.stages_mut()?.empty_cutoff), of_256),
        "n" => (|config| Some(&mut config.sweep_mut()?.empty_bonus), of_256),
        "r" => (|config| Some(&mut config.sweep_mut()?.bad_splits), number),
        _ => return None,
    })
}

/// A field of a configuration; `None` where its builder does not have it.
type Knob = fn(&mut BuildConfig) -> Option<&mut u32>;

/// Who builds.
enum Side {
    Cpu(CpuBackend),
    Gpu(WgpuBackend),
}

/// A tree that answers rays.
enum Built {
    Cpu(Box<CpuAccelerator>),
    Gpu(Box<WgpuAccelerator>),
}

impl Side {
    fn open(plan: &Plan) -> Result<Side, String> {
        if !plan.gpu {
            return Ok(Side::Cpu(CpuBackend::new()));
        }
        // Software takes its time.
        let options =
            OpenOptions { timeout: Some(Duration::from_secs(600)), ..OpenOptions::default() };
        let gpu = Gpu::open(&options).map_err(|error| error.to_string())?;
        let backend = WgpuBackend::new(gpu).map_err(|error| error.to_string())?;
        let parity = backend.parity().map_or("not tested", splitplane_wgpu::Parity::name);
        eprintln!("{}: parity {parity}", backend.gpu().info().name);
        Ok(Side::Gpu(backend))
    }

    fn build(&self, mesh: &Mesh<'_>, options: &BuildOptions<'_>) -> Result<Built, BuildError> {
        Ok(match self {
            Side::Cpu(backend) => Built::Cpu(Box::new(backend.build_accelerator(mesh, options)?)),
            Side::Gpu(backend) => Built::Gpu(Box::new(backend.build_accelerator(mesh, options)?)),
        })
    }
}

impl Built {
    fn accelerator(&self) -> &dyn Accelerator {
        match self {
            Built::Cpu(tree) => &**tree,
            Built::Gpu(tree) => &**tree,
        }
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (arguments, task) = match &arguments[..] {
        [five @ .., task] if five.len() == 5 => (five, Some(task.as_str())),
        all => (all, None),
    };
    let ([name, dir, threads, reps, prefix], None | Some("instances" | "near" | "knn")) =
        (arguments, task)
    else {
        eprintln!("usage: splitplane-peer NAME DIR THREADS REPS PREFIX [instances|near|knn]");
        std::process::exit(2);
    };
    match measure(name, Path::new(dir), threads, reps, (prefix, task)) {
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
    (prefix, task): (&str, Option<&str>),
) -> Result<Value, String> {
    let number = |text: &str| text.parse::<usize>().map_err(|_| format!("{text}: not a number"));
    let (threads, reps) = (number(threads)?, number(reps)?);
    if task == Some("knn") {
        return knn::measure(name, dir, (threads, reps), prefix);
    }
    let (plan, clock) = (Plan::parse(name)?, Clock::asked()?);
    let vertices: Vec<[f32; 3]> = read(&dir.join("verts.f32"))?;
    let indices: Vec<[u32; 3]> = read(&dir.join("index.u32"))?;
    let mesh = Mesh::indexed(&vertices, &indices).map_err(|error| error.to_string())?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| error.to_string())?;
    let backend = Side::open(&plan)?;
    let options = BuildOptions { layout: plan.layout, ..BuildOptions::from(plan.config) };
    if task == Some("near") {
        return near::measure((&plan, &backend, clock), &pool, &mesh, dir, (reps, prefix));
    }
    if task.is_some() {
        let (plan, pool) = (&plan, &pool);
        let backend: &dyn Backend = match &backend {
            Side::Cpu(backend) => backend,
            Side::Gpu(backend) => backend,
        };
        let task = instances::Task { plan, clock, pool, backend, mesh, options, reps, prefix };
        return task.measure(dir);
    }
    let build = || pool.install(|| backend.build(&mesh, &options));

    let (built, build_ms) = builds(clock, reps, build)?;
    let peak = built.accelerator().summary().peak_bytes + built.accelerator().query_bytes();
    let mut sets = Map::new();
    for set in SETS {
        let rays = rays_of(dir, set)?;
        let mut hits = vec![Hit::MISS; rays.len()];
        let mut any = vec![false; rays.len()];
        closest(&pool, &built, &plan, &rays, &mut hits);
        let closest_s = repeat(clock, reps, || closest(&pool, &built, &plan, &rays, &mut hits));
        occluded(&pool, &built, &plan, &rays, &mut any);
        let any_s = repeat(clock, reps, || occluded(&pool, &built, &plan, &rays, &mut any));
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
        "clock": clock.name(),
        "build_ms": build_ms,
        "struct_bytes": built.accelerator().query_bytes(),
        "build_peak_bytes": peak,
        "sets": sets,
    }))
}

fn closest(pool: &rayon::ThreadPool, built: &Built, plan: &Plan, rays: &[Ray], hits: &mut [Hit]) {
    let result = pool.install(|| match built {
        Built::Cpu(tree) if plan.single => tree.closest_hits_singly(rays, hits, &plan.options),
        _ => built.accelerator().closest_hits(rays, hits, &plan.options),
    });
    result.expect("rays and hits of equal length, a device that works");
}

fn occluded(pool: &rayon::ThreadPool, built: &Built, plan: &Plan, rays: &[Ray], any: &mut [bool]) {
    let result = pool.install(|| match built {
        Built::Cpu(tree) if plan.single => tree.any_hits_singly(rays, any, &plan.options),
        _ => built.accelerator().any_hits(rays, any, &plan.options),
    });
    result.expect("rays and answers of equal length, a device that works");
}

fn repeat(clock: Clock, reps: usize, mut run: impl FnMut()) -> Vec<f64> {
    let (mut seconds, whole) = (Vec::new(), Instant::now());
    loop {
        seconds.push(clock.seconds(&mut run));
        if seconds.len() >= reps || whole.elapsed().as_secs_f64() > ENOUGH_SECONDS {
            return seconds;
        }
    }
}

/// The rays of a set.
fn rays_of(dir: &Path, set: &str) -> Result<Vec<Ray>, String> {
    let raw: Vec<[f32; 8]> = read(&dir.join(format!("{set}.rays")))?;
    let ray = |&[ox, oy, oz, dx, dy, dz, t_min, t_max]: &[f32; 8]| {
        Ray::new([ox, oy, oz], [dx, dy, dz]).with_limits(t_min, t_max)
    };
    Ok(raw.iter().map(ray).collect())
}

fn read<T: bytemuck::Pod>(path: &Path) -> Result<Vec<T>, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let whole = bytes.len() / size_of::<T>() * size_of::<T>();
    Ok(bytemuck::allocation::pod_collect_to_vec(&bytes[..whole]))
}

fn write(path: &str, bytes: &[u8]) -> Result<(), String> {
    std::fs::write(path, bytes).map_err(|error| format!("{path}: {error}"))
}

/// Builds as often as asked, each time without the one before: the last one, and milliseconds. The first warms up and is not counted.
fn builds<T, E: std::fmt::Display>(
    clock: Clock,
    reps: usize,
    build: impl Fn() -> Result<T, E>,
) -> Result<(T, Vec<f64>), String> {
    let mut built = build().map_err(|error| error.to_string())?;
    let mut build_ms = Vec::new();
    for _ in 0..reps {
        drop(built);
        let mut next = None;
        let seconds = clock.seconds(|| next = Some(build()));
        built = next.expect("it was built").map_err(|error| error.to_string())?;
        build_ms.push(seconds * 1e3);
    }
    Ok((built, build_ms))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_built() {
        let config = |name| Plan::parse(name).map(|plan| plan.config);
        assert_eq!(config("splitplane-fast"), Ok(Preset::Fast.config()));
        let tuned = BuildConfig {
            traversal_cost: 3,
            intersection_cost: 2,
            block_width: 8,
            clip: false,
            ..Preset::Balanced.config()
        }
        .with_stages(|stages| {
            stages.small_node_limit = 32;
            stages.empty_cutoff = 26;
        })
        .with_bins(64);
        assert_eq!(config("splitplane-balanced-3:2:8-b64-t32-e10-noclip"), Ok(tuned));
        let best = Preset::Best.config().with_sweep(|sweep| {
            sweep.empty_bonus = 51;
            sweep.bad_splits = 5;
        });
        assert_eq!(config("splitplane-best-n20-r5"), Ok(best));
        let single = Plan::parse("splitplane-fast-t48-single").unwrap();
        assert!(single.single && single.config.small_node_limit() == 48);
        let exact = Plan::parse("splitplane-balanced-exact").unwrap();
        assert_eq!(exact.options.accuracy, Accuracy::Exact);
        assert_eq!(exact.layout, QueryLayout::Fast);
        let compact = Plan::parse("splitplane-fast-compact-single").unwrap();
        assert!(compact.single && compact.layout == QueryLayout::Compact);
    }

    #[test]
    fn names_that_ask_for_too_much_are_refused() {
        for (name, why) in [
            ("splitplane-fast-b64", "preset fast does not have"),
            ("splitplane-balanced-n20", "preset balanced does not have"),
            ("splitplane-balanced-b1", "bins is 1"),
            ("splitplane-fast-t65", "small_node_limit is 65"),
            ("splitplane-fast-e100", "empty_cutoff is 256"),
            ("splitplane-fast-x3", "does not know x3"),
            ("splitplane-fast-b", "does not know b"),
            ("splitplane-fast-1:2", "costs are"),
            ("splitplane-wgpu-fast-compact", "a GPU has one layout"),
            ("splitplane-slow", "no preset slow"),
        ] {
            let error = Plan::parse(name).err().unwrap_or_default();
            assert!(error.contains(why), "{name}: {error}");
        }
    }
}

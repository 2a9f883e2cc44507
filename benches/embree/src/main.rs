//! `splitplane-embree`: splitplane and Embree 4 in turns within one process, on the same rays.
//!
//!     cargo run --release -p splitplane-embree -- --library libembree4.so.4 SCENE.obj...
//!
//! One thread, one ray a call for Embree and whole batches for ours, CPU time. In a round everyone answers a set
//! once, Embree first and last; a round's ratio is the mean of Embree's two times over ours, and the median of the rounds
//! is printed. So what else the machine does disturbs both alike.
//!
//! What it cannot disturb at all is what callgrind counts, for each scene, set, query and contestant in a file of its own:
//!
//! ```text
//! valgrind --tool=callgrind --instr-atstart=no --collect-atstart=no --branch-sim=yes --cache-sim=yes \
//!     splitplane-embree --count --avx2 --rays 4096 SCENE.obj...
//! ```

mod callgrind;
mod embree;
mod rays;
mod turns;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;
use embree::Embree;
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_scene::Scene;
use turns::{Answers, Contestant, contest};

/// Measures splitplane and Embree 4 in turns: ns a ray, and Embree's time over ours.
#[derive(Parser)]
struct Options {
    /// Embree's library
    #[arg(long, env = "EMBREE4_LIB", default_value = "libembree4.so.4")]
    library: PathBuf,
    /// About as many rays of each set, in runs of neighbours from all over it
    #[arg(long, default_value_t = 1 << 17, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(16..))]
    rays: usize,
    /// Rounds, of which the median counts
    #[arg(long, default_value_t = 7)]
    rounds: usize,
    /// Sets of rays, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "primary,shadow,bounce,chords", value_parser = rays::SETS)]
    sets: Vec<String>,
    /// Presets, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "fast,balanced,best")]
    presets: Vec<Preset>,
    /// Hold both to AVX2
    #[arg(long)]
    avx2: bool,
    /// One ray a call for ours, too
    #[arg(long)]
    single: bool,
    /// Count instead of measuring; for callgrind
    #[arg(long)]
    count: bool,
    /// The camera stands within the scene; otherwise the file's name decides
    #[arg(long)]
    interior: bool,
    /// Scenes: .obj files or `builtin:NAME`
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
}

type Problem = Box<dyn std::error::Error>;

/// Files whose name has one of these show a room.
const ROOMS: [&str; 8] =
    ["sponza", "sibenik", "conference", "room", "interior", "kitchen", "hall", "office"];

fn main() -> ExitCode {
    let options = Options::parse();
    // This thread alone: callgrind counts what the thread does that asks it to.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let pool = match pool {
        Ok(pool) => pool,
        Err(problem) => {
            eprintln!("splitplane-embree: {problem}");
            return ExitCode::FAILURE;
        }
    };
    for scene in &options.scenes {
        if let Err(problem) = measure(scene, &options, &pool) {
            eprintln!("splitplane-embree: {}: {problem}", scene.display());
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}

fn measure(path: &Path, options: &Options, pool: &rayon::ThreadPool) -> Result<(), Problem> {
    if options.count && !callgrind::is_here() {
        return Err("only callgrind counts: start this with valgrind --tool=callgrind".into());
    }
    let scene = Scene::open(path)?;
    let mesh = Mesh::indexed(&scene.positions, &scene.indices)?;
    let backend = CpuBackend::new();
    let set = if options.avx2 { InstructionSet::Avx2 } else { InstructionSet::detect() };
    if !InstructionSet::available().contains(&set) {
        return Err(format!("this processor has no {}", set.name()).into());
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let interior = options.interior || ROOMS.iter().any(|room| name.contains(room));
    let first = backend.build_accelerator(&mesh, &BuildOptions::from(Preset::Fast.config()))?;
    let sets = rays::sets(&mesh, &scene.bounds(), &first, interior)?;
    drop(first);
    let isa = options.avx2.then_some("avx2");
    let embree = Embree::build(&options.library, isa, &scene.positions, &scene.indices)?;
    println!(
        "{}: {} triangles, {}, Embree {}{}",
        scene.name,
        mesh.len(),
        set.name(),
        embree.version,
        isa.map_or(String::new(), |isa| format!(" with isa={isa}"))
    );
    let mut contestants = vec![Contestant {
        name: "Embree".into(),
        closest: Box::new(|rays, hits| embree.closest(rays, hits)),
        any: Box::new(|rays, hits| embree.any(rays, hits)),
    }];
    for preset in &options.presets {
        let backend = CpuBackend::with_instruction_set(set);
        let tree = pool
            .install(|| backend.build_accelerator(&mesh, &BuildOptions::from(preset.config())))?;
        contestants.push(if options.single {
            one_by_one(preset.name().into(), tree)
        } else {
            ours(preset.name().into(), tree, pool)
        });
    }
    for (name, rays) in rays::SETS.into_iter().zip(&sets) {
        if options.sets.iter().any(|asked| asked == name) {
            let rays = some(rays, options.rays);
            if options.count {
                turns::count(&scene.name, name, &rays, &contestants);
                continue;
            }
            let tolerance = 1e-4 * diagonal(&scene);
            contest(name, &rays, &contestants, options.rounds, tolerance)?;
        }
    }
    Ok(())
}

/// A tree of ours.
fn ours(
    name: String,
    tree: splitplane_cpu::CpuAccelerator,
    pool: &rayon::ThreadPool,
) -> Contestant<'_> {
    let tree = std::sync::Arc::new(tree);
    let same = tree.clone();
    let closest = move |rays: &[Ray], found: &mut Answers| {
        let mut hits = vec![Hit::MISS; rays.len()];
        pool.install(|| tree.closest_hits(rays, &mut hits, &QueryOptions::default()))
            .expect("as many hits as rays");
        for (found, hit) in found.iter_mut().zip(&hits) {
            *found = (hit.t, hit.triangle);
        }
    };
    let any = move |rays: &[Ray], found: &mut [bool]| {
        pool.install(|| same.any_hits(rays, found, &QueryOptions::default()))
            .expect("as many answers as rays");
    };
    Contestant { name, closest: Box::new(closest), any: Box::new(any) }
}

/// A tree of ours that gets one ray a call.
fn one_by_one(name: String, tree: splitplane_cpu::CpuAccelerator) -> Contestant<'static> {
    let tree = std::sync::Arc::new(tree);
    let same = tree.clone();
    let closest = move |rays: &[Ray], found: &mut Answers| {
        let options = QueryOptions::default();
        for (found, ray) in found.iter_mut().zip(rays) {
            let hit = tree.closest_hit(ray, &options).unwrap_or(Hit::MISS);
            *found = (hit.t, hit.triangle);
        }
    };
    let any = move |rays: &[Ray], found: &mut [bool]| {
        let options = QueryOptions::default();
        for (found, ray) in found.iter_mut().zip(rays) {
            *found = same.any_hit(ray, &options);
        }
    };
    Contestant { name, closest: Box::new(closest), any: Box::new(any) }
}

/// About so many of the rays, in runs of neighbours.
fn some(rays: &[Ray], most: usize) -> Vec<Ray> {
    const RUNS: usize = 16;
    if rays.len() <= most || most < RUNS {
        return rays.to_vec();
    }
    let runs = rays.chunks(rays.len() / RUNS).take(RUNS);
    runs.flat_map(|run| &run[..run.len().min(most / RUNS)]).copied().collect()
}

fn diagonal(scene: &Scene) -> f32 {
    let bounds = scene.bounds();
    (0..3).map(|axis| (bounds.hi[axis] - bounds.lo[axis]).powi(2)).sum::<f32>().sqrt()
}

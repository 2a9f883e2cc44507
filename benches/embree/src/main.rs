//! `splitplane-embree`: splitplane and Embree 4 in turns within one process, on the same rays.
//!
//!     cargo run --release -p splitplane-embree -- --library libembree4.so.4 SCENE.obj...
//!
//! One thread, one ray a call for Embree and whole batches for ours, CPU time. In a round everyone answers a set
//! once, Embree first and last; a round's ratio is the mean of Embree's two times over ours, and the median of the rounds
//! is printed. So what else the machine does disturbs both alike. `--packets` has Embree answer packets too, `--accuracies` ours at other
//! accuracies, `--batches` in calls of few rays; sets `paths` and `path-shadows` are a path tracer's rays. `--builds` measures builds in
//! place of rays, and `--frames` a frame. `--table` measures presets without Embree and writes the
//! table that preset `auto` decides by, and `--critical-path 64` how builds would scale to 64 threads.
//!
//! With `--instances grid:N` both answer rays through N copies of the mesh, and build the tree over them in turns.
//!
//! What it cannot disturb at all is what callgrind counts, for each scene, set, query and contestant in a file of its own:
//!
//! ```text
//! valgrind --tool=callgrind --instr-atstart=no --collect-atstart=no --branch-sim=yes --cache-sim=yes \
//!     splitplane-embree --count --avx2 --rays 4096 SCENE.obj...
//! ```

mod builds;
mod callgrind;
mod critical_path;
mod embree;
mod frames;
mod instances;
mod rays;
mod table;
mod turns;

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::Arc;

use clap::Parser;
use embree::{Embree, Of, Packets};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions, QueryLayout};
use splitplane_core::config::Preset;
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::scene::{GeometryId, InstanceId, SceneHit, SceneOptions, Transform};
use splitplane_cpu::{CpuBackend, InstructionSet};
use splitplane_scene::Scene;
use turns::{Answers, Contestant, contest, cpu_time, median};

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
    /// Sets of rays, separated by commas; `paths` and `path-shadows`, not asked for by default, are those of a path tracer
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
    /// Accuracies of ours, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "watertight")]
    accuracies: Vec<Accuracy>,
    /// Layouts of ours, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "fast", value_parser = layout)]
    layouts: Vec<QueryLayout>,
    /// Embree with packets of 16 rays too, of 8 where it is held to AVX2: formed before the clock runs
    #[arg(long)]
    packets: bool,
    /// Ours one ray a call beside whole sets, and in calls of so many rays, separated by commas
    #[arg(long, value_name = "RAYS", value_delimiter = ',', value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..), conflicts_with_all = ["single", "instances"])]
    batches: Vec<usize>,
    /// Builds in place of rays, without callgrind: ours for the first time, again, over the one before, and over that with all lists kept; AVX2 beside AVX-512
    #[arg(long, conflicts_with = "count")]
    builds: bool,
    /// Of builds: threads of both; on several, the time that passes is measured beside CPU time
    #[arg(long, default_value_t = 1, requires = "builds", value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=64))]
    threads: usize,
    /// A frame of 1024x1024 in place of rays, by preset fast
    #[arg(long, conflicts_with = "builds")]
    frames: bool,
    /// Presets without Embree: builds and rays of each, as the table that preset auto decides by
    #[arg(long, conflicts_with_all = ["builds", "frames", "count", "single", "packets", "instances"])]
    table: bool,
    /// Builds without Embree: work, the longest chain, and what that allows so many threads
    #[arg(long, value_name = "THREADS", value_parser = clap::value_parser!(u32).range(1..=4096), conflicts_with_all = ["builds", "frames", "table", "count", "single", "packets", "instances"])]
    critical_path: Option<u32>,
    /// Of the frame: eye and the point looked at, six numbers; placed by rule when left out
    #[arg(long, num_args = 6, allow_hyphen_values = true, requires = "frames")]
    camera: Vec<f32>,
    /// Of the frame: degrees from the bottom to the top
    #[arg(long, default_value_t = 40.0)]
    fov: f32,
    /// Of the frame: lights that are placed by rule
    #[arg(long, default_value_t = 3)]
    lights: usize,
    /// Of the frame: places of lights, three numbers each, in place of those
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true)]
    light: Vec<f32>,
    /// Of the frame: most bounces
    #[arg(long, default_value_t = 0)]
    depth: u32,
    /// Count instead of measuring; for callgrind
    #[arg(long)]
    count: bool,
    /// The camera stands within the scene; otherwise the file's name decides
    #[arg(long)]
    interior: bool,
    /// Copies of each scene's mesh on a grid: `grid:N`; the camera stands outside
    #[arg(long, value_parser = instances::recipe)]
    instances: Option<usize>,
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
    // This thread alone, but for builds on several: callgrind counts what the thread does that asks it to.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads);
    let pool = pool.use_current_thread().build();
    let pool = match pool {
        Ok(pool) => pool,
        Err(problem) => {
            eprintln!("splitplane-embree: {problem}");
            return ExitCode::FAILURE;
        }
    };
    if options.table {
        println!("{}", splitplane_cpu::auto_preset::COLUMNS);
    }
    if let Some(threads) = options.critical_path {
        critical_path::print_head(threads);
    }
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
    let mut scene = Scene::open(path)?;
    let mesh = Mesh::indexed(&scene.positions, &scene.indices)?;
    let set = if options.avx2 { InstructionSet::Avx2 } else { InstructionSet::detect() };
    if !InstructionSet::available().contains(&set) {
        return Err(format!("this processor has no {}", set.name()).into());
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let interior = options.interior || ROOMS.iter().any(|room| name.contains(room));
    let isa = options.avx2.then_some("avx2");
    if options.frames {
        println!("{}: {} triangles, {}", scene.name, mesh.len(), set.name());
        return frames::measure(&mut scene, options, (set, isa), pool);
    }
    if let Some(threads) = options.critical_path {
        return critical_path::measure(&scene.name, &mesh, (set, threads), options, pool);
    }
    let print_head = |version: &str, places: Option<&[Transform]>| {
        println!(
            "{}: {} triangles{}, {}, Embree {version}{}",
            scene.name,
            mesh.len(),
            places.map_or(String::new(), |places| format!(", {} instances", places.len())),
            set.name(),
            isa.map_or(String::new(), |isa| format!(" with isa={isa}"))
        );
    };
    if options.builds {
        // No other of its devices may hold it to fewer threads meanwhile.
        let how = (isa, options.threads);
        let other = Embree::build(&options.library, how, &scene.positions, &scene.indices)?;
        print_head(&other.version, None);
        drop(other);
        let task = builds::Task {
            library: &options.library,
            isa,
            threads: options.threads,
            set,
            pool,
            mesh,
            positions: &scene.positions,
            indices: &scene.indices,
            rounds: options.rounds,
        };
        return options.presets.iter().try_for_each(|preset| task.measure(*preset));
    }
    let places = options.instances.map(|count| instances::grid(&scene.bounds(), count));
    // A path has up to four bounces.
    let paths = options.sets.iter().any(|set| set.starts_with("path"));
    let paths = if paths { options.rays / 4 } else { 0 };
    let rays::Sets { harness: sets, paths } =
        rays_through(&mesh, &scene.bounds(), places.as_deref(), (interior, paths))?;
    if options.table {
        // As given, with the size of a scene that is built in.
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        return table::measure(&name, &mesh, &sets, set, options, pool);
    }
    let mut embree = Embree::build(&options.library, (isa, 1), &scene.positions, &scene.indices)?;
    print_head(&embree.version, places.as_deref());
    let backend = CpuBackend::with_instruction_set(set);
    if places.is_none() {
        // Its copies of vertices and indices included, as ours includes corners.
        let bytes = embree::bytes_held() as f64;
        println!("  Embree: {:.1} bytes a triangle", bytes / mesh.len() as f64);
    }
    if let Some(places) = &places {
        let of_mesh = embree::bytes_held();
        place_in_turns(&mut embree, &backend, &mesh, places, (options, pool))?;
        let all = embree::bytes_held();
        let copies = size_of_val(&scene.positions[..]) + size_of_val(&scene.indices[..]);
        println!(
            "  Embree: {all} bytes, {} of them beside the mesh, {copies} vertices and indices",
            all - of_mesh
        );
    }
    let mut contestants = vec![Contestant {
        name: "Embree".into(),
        ready: Box::new(|_| ()),
        closest: Box::new(|rays, hits| embree.closest(rays, hits)),
        any: Box::new(|rays, hits| embree.any(rays, hits)),
    }];
    if options.packets {
        contestants.push(if options.avx2 { packets::<8>(&embree) } else { packets::<16>(&embree) });
    }
    for preset in &options.presets {
        let (name, build) = (preset.name().to_owned(), BuildOptions::from(preset.config()));
        if let Some(places) = &places {
            let own = instances::scene(&mesh, places)?;
            let how = (&build, options.single);
            let (contestant, built) = instances::ours(name, &backend, &own, how, pool)?;
            let bytes = built.scene().bytes_beside_geometries();
            println!(
                "  {}: {} bytes, {bytes} of them beside the mesh",
                preset.name(),
                built.scene().bytes()
            );
            contestants.push(contestant);
            continue;
        }
        for (layout, accuracy) in variants(options) {
            let build = BuildOptions { layout, ..build };
            let tree = Arc::new(pool.install(|| backend.build_accelerator(&mesh, &build))?);
            let mut name = name.clone();
            if options.layouts.len() > 1 {
                name = format!("{name} {}", layout.name());
            }
            if options.accuracies.len() > 1 {
                name = format!("{name} {}", accuracy.name());
            }
            println!(
                "  {name}: {:.1} bytes a triangle",
                bytes_of(&*tree) as f64 / mesh.len() as f64
            );
            if !options.batches.is_empty() {
                contestants.push(one_by_one(format!("{name} single"), tree.clone(), accuracy));
            }
            for &most in &options.batches {
                let name = format!("{name} by {most}");
                contestants.push(ours(name, tree.clone(), (accuracy, most), pool));
            }
            contestants.push(if options.single {
                one_by_one(name, tree.clone(), accuracy)
            } else {
                ours(name, tree.clone(), (accuracy, usize::MAX), pool)
            });
        }
    }
    for (name, rays) in rays::SETS.into_iter().zip(sets.iter().chain(&paths)) {
        if options.sets.iter().any(|asked| asked == name) {
            // Paths are as many as asked for: to leave some out would tear waves apart.
            let rays =
                if name.starts_with("path") { rays.clone() } else { some(rays, options.rays) };
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

/// A layout by its name.
fn layout(name: &str) -> Result<QueryLayout, String> {
    let found = QueryLayout::ALL.into_iter().find(|layout| layout.name() == name);
    found.ok_or_else(|| format!("there is no layout {name}: fast or compact"))
}

/// Each layout with each accuracy.
fn variants(options: &Options) -> impl Iterator<Item = (QueryLayout, Accuracy)> {
    let with = |&layout| options.accuracies.iter().map(move |&accuracy| (layout, accuracy));
    options.layouts.iter().flat_map(with)
}

/// Bytes of a finished structure.
fn bytes_of(accelerator: &dyn Accelerator) -> u64 {
    let tree = accelerator.tree();
    let held = size_of_val(&tree.nodes[..]) + size_of_val(&tree.references[..]);
    held as u64 + accelerator.query_bytes()
}

/// Embree with packets of `N` rays.
fn packets<const N: usize>(embree: &Embree) -> Contestant<'_>
where
    Embree: Of<N>,
{
    let packets = Rc::new(RefCell::new(Packets::<N>::new(&[])));
    let [formed, same] = [packets.clone(), packets.clone()];
    Contestant {
        name: format!("Embree by {N}"),
        ready: Box::new(move |rays| *formed.borrow_mut() = Packets::new(rays)),
        closest: Box::new(move |_, hits| packets.borrow_mut().closest(embree, hits)),
        any: Box::new(move |_, hits| same.borrow_mut().any(embree, hits)),
    }
}

/// The sets of rays through the mesh, or through its copies, with so many paths.
fn rays_through(
    mesh: &Mesh<'_>,
    bounds: &Aabb,
    places: Option<&[Transform]>,
    (interior, paths): (bool, usize),
) -> Result<rays::Sets, Problem> {
    let chosen = |camera: &[Ray]| if paths == 0 { Vec::new() } else { some(camera, paths) };
    let (backend, options) = (CpuBackend::new(), BuildOptions::from(Preset::Fast.config()));
    let triangle =
        |hit: &SceneHit| mesh.triangle(hit.triangle as usize).map(|corner| corner.map(f64::from));
    let Some(places) = places else {
        let tree = backend.build_accelerator(mesh, &options)?;
        let seen = |rays: &[Ray]| {
            let mut hits = vec![Hit::MISS; rays.len()];
            tree.closest_hits(rays, &mut hits, &QueryOptions::default())?;
            let of = |hit| SceneHit::of(hit, GeometryId(0), InstanceId(0));
            Ok(hits.iter().map(of).collect())
        };
        return Ok(rays::sets(bounds, interior, chosen, seen, triangle)?);
    };
    let tree = backend.build_scene(&instances::scene(mesh, places)?, &options)?;
    let seen = |rays: &[Ray]| {
        let mut hits = vec![SceneHit::MISS; rays.len()];
        tree.closest_hits(rays, &mut hits, &SceneOptions::default()).map(|_| hits)
    };
    let face = |hit: &SceneHit| {
        let place = &places[hit.instance as usize];
        triangle(hit).map(|corner| instances::in_world(place, corner))
    };
    Ok(rays::sets(&instances::bounds(bounds, places), false, chosen, seen, face)?)
}

/// Prints what it takes to place all instances and to build the tree over them, for both in turns.
fn place_in_turns(
    embree: &mut Embree,
    backend: &CpuBackend,
    mesh: &Mesh<'_>,
    places: &[Transform],
    (options, pool): (&Options, &rayon::ThreadPool),
) -> Result<(), Problem> {
    let build = BuildOptions::from(Preset::Fast.config());
    let mut rounds = Vec::new();
    if options.count {
        // Without a clock, which does not run under Valgrind.
        return Ok(embree.place(places, |commit| commit())?);
    }
    for round in 0..=options.rounds {
        let theirs = embree.place(places, |commit| {
            let before = cpu_time();
            commit();
            cpu_time() - before
        })?;
        let ours = instances::placing(backend, mesh, places, &build, pool)?;
        // The first warms up.
        if round > 0 {
            rounds.push([theirs, ours].map(|time| time.as_secs_f64() * 1e3));
        }
    }
    let [theirs, ours] = [0, 1].map(|one| median(rounds.iter().map(|round| round[one])));
    let ratio = median(rounds.iter().map(|[theirs, ours]| theirs / ours));
    println!("  top tree          Embree {theirs:.2} ms  ours {ours:.2} ms, {ratio:.2}");
    Ok(())
}

/// A tree of ours that gets at most so many rays a call.
fn ours(
    name: String,
    tree: Arc<splitplane_cpu::CpuAccelerator>,
    (accuracy, most): (Accuracy, usize),
    pool: &rayon::ThreadPool,
) -> Contestant<'_> {
    let (same, options) = (tree.clone(), QueryOptions { accuracy, ..QueryOptions::default() });
    let closest = move |rays: &[Ray], found: &mut Answers| {
        let mut hits = vec![Hit::MISS; rays.len()];
        pool.install(|| {
            for (rays, hits) in rays.chunks(most).zip(hits.chunks_mut(most)) {
                tree.closest_hits(rays, hits, &options).expect("as many hits as rays");
            }
        });
        for (found, hit) in found.iter_mut().zip(&hits) {
            *found = (hit.t, hit.triangle);
        }
    };
    let any = move |rays: &[Ray], found: &mut [bool]| {
        pool.install(|| {
            for (rays, found) in rays.chunks(most).zip(found.chunks_mut(most)) {
                same.any_hits(rays, found, &options).expect("as many answers as rays");
            }
        });
    };
    let ready = Box::new(|_: &[Ray]| ());
    Contestant { name, ready, closest: Box::new(closest), any: Box::new(any) }
}

/// A tree of ours that gets one ray a call.
fn one_by_one(
    name: String,
    tree: Arc<splitplane_cpu::CpuAccelerator>,
    accuracy: Accuracy,
) -> Contestant<'static> {
    let (same, options) = (tree.clone(), QueryOptions { accuracy, ..QueryOptions::default() });
    let closest = move |rays: &[Ray], found: &mut Answers| {
        for (found, ray) in found.iter_mut().zip(rays) {
            let hit = tree.closest_hit(ray, &options).unwrap_or(Hit::MISS);
            *found = (hit.t, hit.triangle);
        }
    };
    let any = move |rays: &[Ray], found: &mut [bool]| {
        for (found, ray) in found.iter_mut().zip(rays) {
            *found = same.any_hit(ray, &options);
        }
    };
    let ready = Box::new(|_: &[Ray]| ());
    Contestant { name, ready, closest: Box::new(closest), any: Box::new(any) }
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

//! `splitplane-measure-gpu`: builds and queries on a GPU beside the CPU's, in one run, and whether
//! they agree bit for bit. Raw figures go to `OUT/gpu.jsonl`, tables to `OUT/gpu.md`.

mod accuracy;
mod build;
mod device;
mod floor;
mod options;
mod rays;
mod report;
mod stats;
mod trace;

use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use splitplane::gpu::{Gpu, OpenOptions, WgpuBackend};
use splitplane::scene::{Placement, Scene};
use splitplane::{BuildOptions, Preset};

use crate::device::Costs;
use crate::options::Options;
use crate::report::Report;
use crate::stats::milliseconds;

type Failure = Box<dyn Error>;

/// Exit code when something differs or a scene failed.
const DIFFERS: u8 = 1;
/// Exit code when there is no GPU, or nothing can be written.
const NOTHING_MEASURED: u8 = 5;

fn main() -> ExitCode {
    let options = Options::parse();
    match run(&options) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(DIFFERS),
        Err(error) => {
            eprintln!("splitplane-measure-gpu: {error}");
            ExitCode::from(NOTHING_MEASURED)
        }
    }
}

/// Software may take minutes for what hardware does in milliseconds.
const PATIENCE: Duration = Duration::from_secs(600);

/// True when all scenes were measured and nothing differed.
fn run(options: &Options) -> Result<bool, Failure> {
    let mut report = Report::new(&options.out)?;
    let (backend, open_ms) = open(options)?;
    report.adapter(&device::describe(&backend, open_ms))?;
    let costs = Costs::measure(backend.gpu(), options)?;
    report.costs(&costs)?;
    drop(backend);
    for scene in &options.scenes() {
        for &preset in &options.preset {
            eprintln!("{scene}, {}", preset.name());
            report.begin(preset, options.compressed);
            if let Err(error) = measure_scene(scene, preset, &costs, options, &mut report) {
                report.failure(scene, &error.to_string())?;
            }
        }
    }
    report.finish(options.check)
}

/// A backend of its own for every scene: nothing is left over from the one before.
fn open(options: &Options) -> Result<(WgpuBackend, f64), Failure> {
    let asked = OpenOptions {
        adapter: options.adapter.clone(),
        timeout: Some(PATIENCE),
        ..OpenOptions::default()
    };
    let (opened, open_ms) =
        milliseconds(|| WgpuBackend::new(Gpu::open(&asked)?).map_err(Failure::from));
    Ok((opened?, open_ms))
}

fn measure_scene(
    name: &str,
    preset: Preset,
    costs: &Costs,
    options: &Options,
    report: &mut Report,
) -> Result<(), Failure> {
    let mut scene = Scene::open(name)?;
    // Shadow rays go to one point light in every scene, also in one with shining surfaces.
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    let mesh = scene.mesh()?;
    let (backend, _) = open(options)?;
    let build = BuildOptions::from(preset.config());
    let built = build::measure(&backend, &mesh, &build, options)?;
    let floor = if options.check { None } else { Some(floor::moved(&mesh, preset, &built.times)?) };
    // Built-in scenes with their size, files without their folder.
    let name = if name.starts_with("builtin:") { name } else { &scene.name };
    report.build(name, &built.figures, floor.as_deref(), costs)?;
    if options.no_rays {
        return Ok(());
    }
    let sets = match &options.rays_from {
        Some(folder) => rays::from_folder(folder)?,
        None => {
            let [width, height] = options.picture();
            let aspect = f64::from(width) / f64::from(height);
            let placement = Placement::of(&scene, &built.cpu, aspect)?;
            rays::made(&scene, &built.cpu, &placement, [width, height])?
        }
    };
    for set in &sets {
        for query in trace::Query::ALL {
            let figures = trace::measure(&built, set, query, options)?;
            report.trace(name, &figures)?;
        }
        for figures in accuracy::measure(&built, set, options)? {
            report.accuracy(name, &figures)?;
        }
    }
    Ok(())
}

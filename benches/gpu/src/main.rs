//! `splitplane-measure-gpu`: builds and queries on a GPU beside the CPU's, in one run, and whether
//! they agree bit for bit. Raw figures go to `OUT/gpu.jsonl`, tables to `OUT/gpu.md`.

mod accuracy;
mod build;
mod count;
mod device;
mod floor;
mod micro;
mod model;
mod moved;
mod options;
mod predicting;
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

use crate::count::device::Counter;
use crate::device::Costs;
use crate::micro::Micro;
use crate::model::devices::Device;
use crate::options::Options;
use crate::predicting::Measured;
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
    let predictor = Predictor::new(backend.gpu(), options, &mut report)?;
    if options.predict {
        drop(backend);
        predictor.assumptions(&[], &mut report);
        for scene in &options.scenes() {
            for &preset in &options.preset {
                predictor.scene(scene, preset, options, Measured::default(), &mut report)?;
                report.write(true)?;
            }
        }
        return report.finish(true);
    }
    let costs = Costs::measure(backend.gpu(), options)?;
    report.costs(&costs)?;
    predictor.measure(backend.gpu(), &costs, options, &mut report)?;
    drop(backend);
    for scene in &options.scenes() {
        for &preset in &options.preset {
            eprintln!("{scene}, {}", options.label(preset));
            report.begin(options.label(preset));
            if let Err(error) =
                measure_scene(scene, preset, &costs, options, &predictor, &mut report)
            {
                report.failure(scene, &error.to_string())?;
            }
            // A later scene may take the machine down.
            report.write(options.check)?;
        }
    }
    report.finish(options.check)
}

/// A backend of its own for every scene: nothing is left over from the one before.
fn open(options: &Options) -> Result<(WgpuBackend, f64), Failure> {
    let asked = OpenOptions {
        adapter: options.adapter.clone(),
        timeout: Some(PATIENCE),
        ray_stack: options.ray_stack,
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
    predictor: &Predictor,
    report: &mut Report,
) -> Result<(), Failure> {
    let mut scene = Scene::open(name)?;
    // Shadow rays go to one point light in every scene, also in one with shining surfaces.
    scene.materials.iter_mut().for_each(|material| material.emission = [0.0; 3]);
    let mesh = scene.mesh()?;
    let (backend, _) = open(options)?;
    let build = BuildOptions::from(options.config(preset));
    let built = build::measure(&backend, &mesh, &build, options)?;
    let floor = if options.check { None } else { Some(floor::moved(&mesh, preset, &built.times)?) };
    let asked = name;
    // Built-in scenes with their size, files without their folder.
    let name = if name.starts_with("builtin:") { name } else { &scene.name };
    report.build(name, &built.figures, floor.as_deref(), costs)?;
    // Whatever comes may be stopped by somebody who has no more time.
    report.write(options.check)?;
    let mut measured = Measured { times: &built.times, primary: None };
    if options.no_rays {
        return predictor.scene(asked, preset, options, measured, report);
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
    // Predictions are about tiles; rays from a folder are in the order that they have there.
    let predicted = if options.rays_from.is_some() { "primary" } else { rays::TILES };
    for set in &sets {
        for query in trace::Query::ALL {
            let figures = trace::measure(&built, set, query, options)?;
            if (set.name, query) == (predicted, trace::Query::Closest) && !options.check {
                measured.primary = Some(figures.resident_mrays());
            }
            report.trace(name, &figures)?;
        }
        for figures in accuracy::measure(&built, set, options)? {
            report.accuracy(name, &figures)?;
        }
        report.write(options.check)?;
    }
    if options.check {
        return Ok(());
    }
    predictor.scene(asked, preset, options, measured, report)
}

/// What predicts: the device that counts, if there is one, and those that are predicted. Nothing measured is lost where
/// counting fails.
struct Predictor {
    counter: Option<Counter>,
    devices: Vec<&'static Device>,
}

impl Predictor {
    fn new(gpu: &Gpu, options: &Options, report: &mut Report) -> Result<Predictor, Failure> {
        let devices = predicting::devices(options, gpu)?;
        if options.check || options.no_predict {
            return Ok(Predictor { counter: None, devices });
        }
        let counter = Counter::like(gpu);
        if let Err(error) = &counter {
            report.failure("counting", &error.to_string())?;
        }
        Ok(Predictor { counter: counter.ok(), devices })
    }

    /// What the device does, beside what is assumed.
    fn measure(
        &self,
        gpu: &Gpu,
        costs: &Costs,
        options: &Options,
        report: &mut Report,
    ) -> Result<(), Failure> {
        if self.counter.is_none() {
            return Ok(());
        }
        let measured = match Micro::measure(gpu, options) {
            Ok(micro) => report.micro(&micro).map(|()| Some(micro))?,
            Err(error) => report.failure("chains", &error.to_string()).map(|()| None)?,
        };
        let mut found = vec![
            ("copies, GB/s", costs.kernel_gb_per_s),
            ("a dispatch that waits for the one before, us", costs.dispatch_us),
        ];
        let ghz = self.devices.first().map_or(1.0, |device| device.clock.number);
        found.extend(measured.iter().flat_map(|micro| micro.beside(ghz)));
        self.assumptions(&found, report);
        Ok(())
    }

    fn assumptions(&self, measured: &[(&str, f64)], report: &mut Report) {
        for device in &self.devices {
            report.predicted(&format!("\n{}", model::table::assumptions(device, measured)));
        }
    }

    fn scene(
        &self,
        name: &str,
        preset: Preset,
        options: &Options,
        measured: Measured<'_>,
        report: &mut Report,
    ) -> Result<(), Failure> {
        let Some(counter) = &self.counter else { return Ok(()) };
        match predicting::scene(counter, name, preset, &self.devices, options, measured) {
            Ok(text) => report.predicted(&text),
            Err(error) => report.failure(name, &format!("not counted: {error}"))?,
        }
        Ok(())
    }
}

//! `splitplane paper`: what the survey of Zhou et al. 2008 reports, measured here.

mod figures;
mod report;

use super::ending::{self, TimeLimit};
use super::failure::Failure;
use super::options::{bytes, size};
use super::prepared::command;
use super::{files, output, progress};
use clap::builder::{OsStringValueParser, TypedValueParser};
use clap::{Args, ValueEnum};
use figures::{Drawn, scalings};
use indicatif::ProgressBar;
use splitplane::backend::Engine;
use splitplane::render::Size;
use splitplane::{Backend, BackendInfo, BackendKind, CpuBackend, OpenOptions, Preset};
use splitplane_measure::paper::asked::{Asked, BadLights, STAND_INS};
use splitplane_measure::paper::document::Report;
use splitplane_measure::paper::machine::Machine;
use splitplane_measure::paper::motion;
use splitplane_measure::paper::scene::{self, Placed, Settings};
use splitplane_measure::paper::worked::Worked;
use splitplane_measure::paper::{Builder, claims};
use splitplane_scene::from_file::{printable, quoted};
use std::path::PathBuf;

/// To see that all of it works.
const QUICK_SCENES: [&str; 2] = ["builtin:carousel:4000@1", "builtin:city:3000@2"];
/// Letters of pictures end at z.
const MOST_SCENES: usize = 26;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// A scene to measure, an .obj, .ply, .stl, .gltf or .glb file or builtin:NAME[:SIZE]; may be given many times. @LIGHTS behind
    /// it, 1 to 8, gives it that many lights, placed unless it brings as many; built-in scenes of the
    /// paper's sizes and numbers of lights when left out
    #[arg(long, value_name = "SCENE[@LIGHTS]", value_parser = asked())]
    scene: Vec<Asked>,
    /// What is measured besides the CPU, which always is: `wgpu` a GPU, `cpu` nothing, `auto` a GPU if
    /// there is one fit for it
    #[arg(long, value_name = "auto|cpu|wgpu", default_value = "auto")]
    backend: BackendKind,
    /// Folder for the report; made when it is not there
    #[arg(long, value_name = "DIR", default_value = "paper")]
    out: PathBuf,
    /// How the scene of Table 4 moves: a folder of .obj files in the order of their names, or
    /// NAME.frames.bin with NAME.frames.json beside it; needs exactly one --scene. Scenes without frames
    /// are twisted, and built-in ones that move, move
    #[arg(long, value_name = "FILE|DIR")]
    frames: Option<PathBuf>,
    /// How many frames Table 4 has, each with a tree of its own; 9 when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=999))]
    count: Option<u16>,
    /// Small scenes and pictures, one run, no GPU unless asked for: shows that it works and measures
    /// nothing
    #[arg(long)]
    quick: bool,
    /// The builder that the others are compared with, on one thread
    #[arg(long, value_enum, default_value_t = Offline::Best)]
    offline: Offline,
    /// Width and height of frames in pixels; 1024x1024, as the paper's, when left out
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<Size>,
    /// Runs of each measure, of which the median counts; an odd number, 5 when left out
    #[arg(long, value_name = "N", value_parser = odd)]
    repeat: Option<usize>,
    /// The GPU, by part of its name or by its number in the list of `splitplane adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
    /// Allow --backend wgpu a GPU whose results differ from the CPU's in some bits
    #[arg(long)]
    allow_structural: bool,
    /// Threads that share the work; all cores when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Most bytes a build may hold besides the mesh; k, M and G stand for powers of 1024
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    max_memory: Option<u64>,
    #[command(flatten)]
    time: TimeLimit,
    /// Report as one JSON object
    #[arg(long)]
    json: bool,
    /// Print nothing but errors and what --json asks for
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Offline {
    /// Binned SAH above, SAH on masks below
    Balanced,
    /// SAH over all planes, with clipping
    Best,
}

fn asked() -> impl TypedValueParser<Value = Asked> {
    OsStringValueParser::new().try_map(|text| Asked::of(&text))
}

fn odd(text: &str) -> Result<usize, String> {
    let number: Option<usize> = text.parse().ok().filter(|n| n % 2 == 1 && *n < 1000);
    number.ok_or_else(|| "give an odd number from 1 to 999, so that there is a middle".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.scene.len() > MOST_SCENES {
        return Err(Failure::usage(format!(
            "{} scenes are more than the {MOST_SCENES} that a report can name by letter",
            arguments.scene.len()
        )));
    }
    if arguments.frames.is_some() && arguments.scene.len() != 1 {
        return Err(Failure::usage(format!(
            "--frames: needs exactly one --scene, whose frames they are, not {}",
            arguments.scene.len()
        )));
    }
    arguments.time.begin();
    ending::check()?;
    let gpu = arguments.gpu()?;
    let settings = arguments.settings(gpu.info.is_some())?;
    let _folder = files::Folder::make(&arguments.out)?;
    arguments.report(&settings, &gpu)
}

/// The GPU that is measured, if one is, and why.
struct Gpu {
    info: Option<BackendInfo>,
    reason: String,
}

/// The work of the report, with its progress.
struct Progress {
    bar: ProgressBar,
}

impl Progress {
    fn step(&self, what: &str) {
        self.bar.set_message(printable(what).into_owned());
        self.bar.inc(1);
    }
}

impl Arguments {
    fn gpu(&self) -> Result<Gpu, Failure> {
        if self.quick && self.backend == BackendKind::Auto && self.adapter.is_none() {
            return Ok(Gpu { info: None, reason: "auto: none, since --quick was given".into() });
        }
        let opened = self.backend.open_engine(&self.open_options())?;
        let info = match &opened.engine {
            Engine::Cpu(_) => None,
            other => Some(other.as_backend().describe()),
        };
        Ok(Gpu { info, reason: opened.reason })
    }

    fn open_options(&self) -> OpenOptions {
        super::probe::limited(OpenOptions {
            adapter: self.adapter.clone(),
            allow_structural: self.allow_structural,
            ..OpenOptions::default()
        })
    }

    fn settings(&self, gpu: bool) -> Result<Settings, Failure> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let usual = if self.quick { (96, 96) } else { (1024, 1024) };
        let size = match self.size {
            Some(size) => size,
            None => {
                Size::new(usual.0, usual.1).map_err(|error| Failure::usage(error.to_string()))?
            }
        };
        let offline = match self.offline {
            Offline::Balanced => Preset::Balanced,
            Offline::Best => Preset::Best,
        };
        Ok(Settings {
            size,
            repeat: self.repeat.unwrap_or(if self.quick { 1 } else { 5 }),
            frames: self.count.map_or(if self.quick { 3 } else { 9 }, usize::from),
            threads: self.threads.map_or(cores, usize::from),
            builders: Builder::all(offline, gpu),
            open: self.open_options(),
            max_memory: self.max_memory,
        })
    }

    fn scenes(&self) -> Result<Vec<Asked>, Failure> {
        if !self.scene.is_empty() {
            return Ok(self.scene.clone());
        }
        let usual: &[&str] = if self.quick { &QUICK_SCENES } else { &STAND_INS };
        let asked = |text: &&str| text.parse().map_err(|error: BadLights| error.to_string());
        usual.iter().map(|text| asked(text).map_err(Failure::usage)).collect()
    }

    fn report(&self, settings: &Settings, gpu: &Gpu) -> Result<(), Failure> {
        let asked = self.scenes()?;
        let devices = if gpu.info.is_some() { 2 } else { 1 };
        // A scene is opened, measured, built for figures and drawn.
        let steps = asked.len() as u64 * (scene::steps(settings) + motion::steps(settings) + 3)
            + 2
            + devices;
        let progress = Progress { bar: progress::bar(self.quiet, "measuring", steps) };
        if !self.quiet {
            output::note(&format!("GPU: {}", gpu.reason));
        }
        let placed = self.open(&asked, settings, &progress)?;
        let mut scenes = Vec::new();
        for (letter, placed) in ('a'..='z').zip(&placed) {
            let scene = scene::measure(letter, placed, settings, &mut |what| progress.step(what))?;
            for preset in scene.differing().into_iter().filter(|_| !self.quiet) {
                output::note(&format!(
                    "note: {}: the GPU's tree by preset {preset} is not the CPU's; `splitplane parity` \
                     finds out where they part",
                    quoted(&scene.name)
                ));
            }
            scenes.push(scene);
        }
        let mut motions = Vec::new();
        for ((letter, placed), asked) in ('a'..='z').zip(&placed).zip(&asked) {
            let step = &mut |what: &str| progress.step(what);
            let moving = (&*asked.spec, self.frames.as_deref());
            motions.push(motion::measure(letter, placed, moving, settings, step)?);
        }
        let scalings = scalings(&placed, settings, gpu.info.is_some(), &progress)?;
        let Drawn { mut figures, areas, objects } =
            self.figures(&placed, settings, &scalings, &progress)?;
        figures.motion(&motions)?;
        let largest = placed.iter().max_by_key(|placed| placed.scene.indices.len());
        let largest = largest.unwrap_or(&placed[0]);
        let claims = claims::measure(largest, settings, &claims::Amounts::of(self.quick))?;
        progress.step("claims");
        progress.bar.finish_and_clear();
        let command = command();
        let report = Report {
            format: 2,
            machine: Machine::of(
                command,
                settings.threads,
                &CpuBackend::new().describe(),
                gpu.info.as_ref(),
                gpu.reason.clone(),
            ),
            size: [settings.size.width(), settings.size.height()],
            repeat: settings.repeat,
            presets: scene::knobs(&settings.builders),
            worked: Worked::compute(),
            scenes,
            motions,
            objects,
            areas_scene: placed.first().map_or(String::new(), |first| first.scene.name.clone()),
            areas,
            scaling: scalings,
            claims,
            figures: figures.list,
        };
        let files = self.write(&report, figures.files)?;
        self.tell(&report, &files)
    }

    fn open(
        &self,
        asked: &[Asked],
        settings: &Settings,
        progress: &Progress,
    ) -> Result<Vec<Placed>, Failure> {
        let mut scenes = Vec::new();
        for Asked { spec, lights } in asked {
            let placed = Placed::open(spec, *lights, settings)?;
            let scene = &placed.scene;
            if !self.quiet {
                for sentence in scene.notes.sentences() {
                    let name = quoted(&scene.name);
                    output::note(&format!("note: {name}: {sentence}"));
                }
                if let Some(lights) = lights.filter(|lights| *lights != scene.lights.len()) {
                    let count = scene.lights.len();
                    let name = quoted(&scene.name);
                    output::note(&format!("note: {name}: {count} of {lights} lights"));
                }
            }
            progress.step(&format!("{}: opened", scene.name));
            scenes.push(placed);
        }
        Ok(scenes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_are_odd() {
        assert_eq!((odd("1"), odd("7")), (Ok(1), Ok(7)));
        for bad in ["0", "2", "-1", "1001", "x"] {
            assert!(odd(bad).is_err(), "{bad}");
        }
    }
}

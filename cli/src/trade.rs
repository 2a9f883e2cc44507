//! `splitplane trade`: what each setting costs on a scene, what it gets wrong, and which to take.

mod report;
mod sweep;

use super::ending::{self, TimeLimit};
use super::failure::Failure;
use super::options::{AccuracyName, PresetName, bytes};
use super::prepared::command;
use super::{files, output, progress};
use clap::{Args, ValueEnum};
use report::{failed, left_out, write};
use splitplane::render::Size;
use splitplane::scene::SceneOptions;
use splitplane::{BackendKind, OpenOptions};
use splitplane_measure::paper::machine::Machine;
use splitplane_measure::paper::scene::{Placed, Settings as SceneSettings};
use splitplane_measure::trade::budget::{Fixed, FixedRays};
use splitplane_measure::trade::compare::{Old, Thresholds};
use splitplane_measure::trade::held::Held;
use splitplane_measure::trade::measure::{Event, Settings};
use splitplane_measure::trade::recommend::Wish;
use splitplane_measure::trade::{Trade, measure, rays};
use splitplane_scene::from_file::{printable, quoted};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Seconds that the rounds of a sweep take.
const SECONDS: u32 = 150;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// Path of an .obj, .ply, .stl, .gltf or .glb file, or builtin:NAME[:SIZE]
    #[arg(required_unless_present = "compare")]
    scene: Option<OsString>,
    /// Folder for the report; made when it is not there. `trade` when left out; with --compare nothing
    /// is written unless it is given
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Rays of a frame, for the recommendation
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..=1 << 50))]
    rays: u64,
    /// How many frames, for the recommendation; each has a build of its own
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    count: u64,
    /// Nothing moves: one build serves all frames
    #[arg(long)]
    still: bool,
    /// Recommend no setting with more missing, wrong and phantom hits a million judged rays
    #[arg(long, value_name = "PER_MILLION", value_parser = at_least_zero)]
    max_error: Option<f64>,
    /// Recommend no accuracy that promises less
    #[arg(long, value_enum, default_value_t = AccuracyName::Watertight)]
    min_accuracy: AccuracyName,
    /// Presets to measure
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = PresetName::value_variants().to_vec())]
    presets: Vec<PresetName>,
    /// Accuracies to measure; all when left out
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = AccuracyName::value_variants().to_vec())]
    accuracies: Vec<AccuracyName>,
    /// Measure presets as they are only, not each knob by itself
    #[arg(long)]
    no_knobs: bool,
    /// Draw no pictures to see what their settings cost and lose
    #[arg(long)]
    no_picture: bool,
    /// What to measure on: `cpu`, `wgpu` or both; `auto` is the CPU, and a GPU if there is one fit for
    /// it
    #[arg(
        long = "backend",
        alias = "backends",
        value_name = "auto|cpu|wgpu",
        value_delimiter = ',',
        default_value = "auto"
    )]
    backends: Vec<BackendKind>,
    /// The GPU, by part of its name or by its number in the list of `splitplane adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
    /// Allow --backend wgpu a GPU whose results differ from the CPU's in some bits
    #[arg(long)]
    allow_structural: bool,
    /// Most threads; all cores when left out. Presets are also measured on one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Seconds that measuring is to take, about; opening the scene and drawing come on top
    #[arg(long, value_name = "SECONDS", default_value_t = SECONDS, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    seconds: u32,
    /// Rounds that count; 21, 15, 9, 5, 3 or 1, as many as fit, when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=999))]
    repeat: Option<u16>,
    /// Rays of each timed set; as many as fit when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 26))]
    sample_rays: Option<u32>,
    /// Rays of each kind whose answers are judged; as many as fit when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 26))]
    error_rays: Option<u32>,
    /// Few rays, no GPU unless asked for: shows that it works and measures nothing
    #[arg(long)]
    quick: bool,
    /// Measure again what this file says was measured, and end with exit code 1 where a figure got worse
    /// past the threshold; the scene is the file's when left out
    #[arg(long, value_name = "OLD.json", conflicts_with_all = ["presets", "accuracies", "no_knobs", "no_picture", "backends", "threads", "repeat", "sample_rays", "error_rays", "quick"])]
    compare: Option<PathBuf>,
    /// How much worse times, memory and costs may be: the least of the rounds, against the file's
    #[arg(long, value_name = "PERCENT", default_value_t = 25.0, value_parser = at_least_zero)]
    threshold: f64,
    /// How many more errors a million rays there may be
    #[arg(long, value_name = "PER_MILLION", default_value_t = 0.0, value_parser = at_least_zero)]
    error_threshold: f64,
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

fn at_least_zero(text: &str) -> Result<f64, String> {
    let number: Option<f64> = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
    number.ok_or_else(|| "give a number of 0 or more".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.time.begin();
    ending::check()?;
    let old = arguments.compare.as_deref().map(Old::read).transpose()?;
    let folder = match (&arguments.out, &old) {
        (Some(folder), _) => Some(folder.clone()),
        (None, None) => Some(PathBuf::from("trade")),
        (None, Some(_)) => None,
    };
    // That nothing can be written is said before anything is measured.
    let _made = folder.as_deref().map(files::Folder::make).transpose()?;
    arguments.work(old.as_ref(), folder.as_deref())
}

impl Arguments {
    fn work(&self, old: Option<&Old>, folder: Option<&Path>) -> Result<(), Failure> {
        let sweep = match old {
            Some(old) => self.sweep_again(old)?,
            None => self.sweep()?,
        };
        if !self.quiet {
            output::note(&format!("GPU: {}", sweep.gpu.reason));
        }
        let threads = sweep.stations.iter().map(|station| station.threads).max().unwrap_or(1);
        let spec = self.scene.clone().or_else(|| old.map(|old| old.scene.spec.clone().into()));
        let spec = spec.unwrap_or_default();
        let placed = self.open(&spec, threads)?;
        let scene = &placed.scene;
        if let Some(old) = old {
            old.check_scene(&scene.name, scene.indices.len())?;
        }
        if !self.quiet {
            for sentence in scene.notes.sentences() {
                output::note(&format!("note: {}: {sentence}", quoted(&scene.name)));
            }
        }
        let settings = Settings {
            seconds: if self.quick { 1.0 } else { f64::from(self.seconds) },
            fixed: old.map_or_else(|| self.fixed(), Old::fixed),
            gpu: sweep.gpu.backend.as_deref(),
            max_memory: self.max_memory,
            merge: old.is_none(),
            hierarchy: old.is_none(),
            picture: if self.no_picture || old.is_some() {
                None
            } else {
                Some(self.picture_size()?)
            },
            watch: &progress::Unseen,
        };
        let bar = progress::bar(self.quiet, "measuring", 0);
        let measured = measure(&placed, &sweep.stations, &settings, &mut |event| match event {
            Event::Steps(steps) => bar.set_length(steps),
            Event::Step(what) => {
                bar.set_message(printable(what).into_owned());
                bar.inc(1);
            }
        })?;
        bar.finish_and_clear();
        let command = command();
        let machine = Machine::of(
            command,
            threads,
            &measured.cpu,
            measured.gpu.as_ref(),
            sweep.gpu.reason.clone(),
        );
        let about = (scene.name.clone(), scene.indices.len());
        let left_out = left_out(&sweep.stations);
        let spec = spec.to_string_lossy().into_owned();
        let trade = Trade::of(spec, about, machine, measured, &self.wish(), left_out);
        let comparison = match old {
            Some(old) => Some(old.compare(&trade, self.thresholds())?),
            None => None,
        };
        let paths = match folder {
            Some(folder) => write(folder, &trade)?,
            None => Vec::new(),
        };
        self.tell(&trade, comparison.as_ref(), paths)?;
        trustworthy(&trade.held)?;
        match comparison {
            Some(comparison) if !comparison.passed() => {
                Err(Failure::failed_check(failed(&comparison)))
            }
            _ => Ok(()),
        }
    }

    fn open(&self, spec: &OsStr, threads: usize) -> Result<Placed, Failure> {
        let spinner = progress::spinner(self.quiet, "opening the scene");
        // Only the aspect matters, and the room a build may take.
        let size = Size::new(4, 3).map_err(|error| Failure::usage(error.to_string()))?;
        debug_assert!((size.aspect() - rays::ASPECT).abs() < 1e-9);
        let settings = SceneSettings {
            size,
            repeat: 1,
            frames: 1,
            threads,
            builders: Vec::new(),
            open: OpenOptions::default(),
            max_memory: self.max_memory,
        };
        let textures = !self.no_picture && self.compare.is_none();
        let options = SceneOptions { textures, ..SceneOptions::default() };
        let placed = Placed::open_with(spec, None, &settings, &options)?;
        spinner.finish_and_clear();
        Ok(placed)
    }

    fn fixed(&self) -> Fixed {
        let quick = |given: Option<u32>, few: u32| given.or(self.quick.then_some(few));
        let rays = FixedRays {
            sample: quick(self.sample_rays, 1024).map(|rays| rays as usize),
            error: quick(self.error_rays, 1000).map(u64::from),
        };
        let repeat = self.repeat.map(usize::from).or(self.quick.then_some(3));
        Fixed { repeat, cpu: rays, gpu: rays }
    }

    fn picture_size(&self) -> Result<Size, Failure> {
        let (width, height) = if self.quick { (64, 48) } else { (320, 240) };
        Size::new(width, height).map_err(|error| Failure::usage(error.to_string()))
    }

    fn wish(&self) -> Wish {
        Wish {
            rays: self.rays,
            frames: self.count,
            still: self.still,
            least_accuracy: self.min_accuracy.accuracy().name().to_owned(),
            max_error: self.max_error,
        }
    }

    fn thresholds(&self) -> Thresholds {
        Thresholds { ratio: self.threshold / 100.0, errors: self.error_threshold }
    }
}

/// Whether the exact answers, by which all others were judged, hold.
fn trustworthy(held: &Held) -> Result<(), Failure> {
    if held.disagreements == 0 {
        return Ok(());
    }
    Err(Failure::failed_check(format!(
        "the exact answers cannot be trusted, and no figure of errors either: {}",
        held.words()
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_answers_that_do_not_hold_fail_the_run() {
        assert!(trustworthy(&Held { checked: 9, rounded: 2, ..Held::default() }).is_ok());
        let wrong = Held { checked: 9, disagreements: 1, ..Held::default() };
        let failure = trustworthy(&wrong).unwrap_err();
        assert_eq!(failure.number(), 1);
        assert!(failure.message().contains("1 disagreements"), "{}", failure.message());
    }
}

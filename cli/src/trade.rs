//! `splitplane trade`: what each setting costs on a scene, what it gets wrong, and which to take.

use super::ending::{self, TimeLimit};
use super::failure::Failure;
use super::options::{AccuracyName, PresetName, bytes};
use super::prepared::{command, print_json};
use super::{files, output, progress};
use clap::{Args, ValueEnum};
use splitplane::render::Size;
use splitplane::scene::SceneOptions;
use splitplane::{Accuracy, Backend, BackendKind, OpenOptions, Preset};
use splitplane_measure::paper::file::File;
use splitplane_measure::paper::machine::Machine;
use splitplane_measure::paper::scene::{Placed, Settings as SceneSettings};
use splitplane_measure::trade::budget::{Fixed, FixedRays};
use splitplane_measure::trade::compare::{Comparison, Old, Thresholds};
use splitplane_measure::trade::held::Held;
use splitplane_measure::trade::measure::{Event, Settings};
use splitplane_measure::trade::pareto::Standing;
use splitplane_measure::trade::plan::{Device, Scope, Station, stations};
use splitplane_measure::trade::recommend::Wish;
use splitplane_measure::trade::{Trade, measure, plot, rays};
use splitplane_scene::from_file::{printable, quoted};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// Seconds that the rounds of a sweep take.
const SECONDS: u32 = 150;

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// Path of an .obj file, or builtin:NAME[:SIZE]
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

/// What is measured, on which GPU if on one, and why.
struct Sweep {
    stations: Vec<Station>,
    gpu: Gpu,
}

/// The GPU that is measured, if one is, and why.
struct Gpu {
    backend: Option<Box<dyn Backend>>,
    reason: String,
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

    fn sweep(&self) -> Result<Sweep, Failure> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let most = self.threads.map_or(cores, usize::from);
        let threads = if most > 1 { vec![1, most] } else { vec![1] };
        let on_cpu = self.backends.iter().any(|kind| *kind != BackendKind::Wgpu);
        if !on_cpu && self.presets.iter().all(|builder| *builder == PresetName::Best) {
            return Err(Failure::usage(
                "preset best is built on the CPU only; add cpu to --backend",
            ));
        }
        let gpu = self.gpu()?;
        let mut devices = Vec::new();
        if on_cpu {
            devices.push(Device::Cpu);
        }
        if gpu.backend.is_some() {
            devices.push(Device::Gpu);
        }
        let mut presets: Vec<Preset> = self.presets.iter().map(|name| name.preset()).collect();
        presets.sort_by_key(|preset| *preset as u32);
        presets.dedup();
        let mut accuracies: Vec<Accuracy> =
            self.accuracies.iter().map(|level| level.accuracy()).collect();
        let rank = |accuracy: &Accuracy| Accuracy::ALL.iter().position(|own| own == accuracy);
        accuracies.sort_by_key(rank);
        accuracies.dedup();
        let scope = Scope { presets, knobs: !self.no_knobs, accuracies, devices, threads };
        Ok(Sweep { stations: stations(&scope), gpu })
    }

    /// What a file says was measured.
    fn sweep_again(&self, old: &Old) -> Result<Sweep, Failure> {
        let stations = old.stations();
        let gpu = match stations.iter().any(|station| station.device == Device::Gpu) {
            true => self.open_gpu(BackendKind::Wgpu)?,
            false => Gpu { backend: None, reason: "none, as in the file".into() },
        };
        Ok(Sweep { stations, gpu })
    }

    /// The GPU to measure. It is opened before the scene is: that there is none is said first.
    fn gpu(&self) -> Result<Gpu, Failure> {
        let kinds = &self.backends;
        if kinds.contains(&BackendKind::Wgpu) {
            return self.open_gpu(BackendKind::Wgpu);
        }
        let none = |reason: &str| Ok(Gpu { backend: None, reason: reason.to_owned() });
        if !kinds.contains(&BackendKind::Auto) {
            return none("none, since only the CPU was asked for");
        }
        if self.quick && self.adapter.is_none() {
            return none("auto: none, since --quick was given");
        }
        self.open_gpu(BackendKind::Auto)
    }

    fn open_gpu(&self, kind: BackendKind) -> Result<Gpu, Failure> {
        let opened = kind.open_with(&self.open_options())?;
        let is_gpu = opened.backend.describe().name != "cpu";
        Ok(Gpu { backend: is_gpu.then_some(opened.backend), reason: opened.reason })
    }

    fn open_options(&self) -> OpenOptions {
        super::probe::limited(OpenOptions {
            adapter: self.adapter.clone(),
            allow_structural: self.allow_structural,
            ..OpenOptions::default()
        })
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

    fn tell(
        &self,
        trade: &Trade,
        comparison: Option<&Comparison>,
        output: Vec<String>,
    ) -> Result<(), Failure> {
        if self.json {
            #[derive(serde::Serialize)]
            struct Told<'a> {
                #[serde(flatten)]
                trade: &'a Trade,
                comparison: Option<&'a Comparison>,
                output: Vec<String>,
            }
            return print_json(&Told { trade, comparison, output });
        }
        if self.quiet {
            return Ok(());
        }
        let mut text = described(trade);
        if let Some(comparison) = comparison {
            text += &comparison.words();
        }
        if let Some(last) = output.last() {
            text += &format!("written  {last} and {} files beside it\n", output.len() - 1);
        }
        output::data(&text)
    }
}

/// What a reader may look for and not find.
fn left_out(stations: &[Station]) -> Vec<String> {
    let on = |device| stations.iter().filter(move |station| station.device == device);
    let best = on(Device::Cpu).any(|station| station.config.preset == Preset::Best);
    let mut out = Vec::new();
    if best && on(Device::Gpu).next().is_some() {
        out.push("preset best on the GPU, since it is built on the CPU only".to_owned());
    }
    out
}

/// What failed a comparison, in one line.
fn failed(comparison: &Comparison) -> String {
    let named = comparison
        .worse
        .iter()
        .take(5)
        .map(|worse| format!("row {} ({}): {}", worse.row, worse.setting, worse.figure));
    let more = comparison.worse.len().saturating_sub(5);
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    format!(
        "{} of {} figures got worse past the threshold: {}{more}",
        comparison.worse.len(),
        comparison.figures,
        named.collect::<Vec<_>>().join("; ")
    )
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

/// Writes all files and gives their paths.
fn write(folder: &Path, trade: &Trade) -> Result<Vec<String>, Failure> {
    let json = serde_json::to_vec_pretty(trade)
        .map_err(|error| Failure::file(format!("cannot write the report as JSON: {error}")))?;
    let figures = plot::figures(trade)?;
    let shown: Vec<(&str, &str)> = figures
        .iter()
        .map(|figure| (figure.files[0].name.as_str(), figure.caption.as_str()))
        .collect();
    let text = trade.markdown(&shown);
    let mut files: Vec<File> = figures.into_iter().flat_map(|figure| figure.files).collect();
    files.push(File { name: "trade.csv".into(), bytes: trade.table().csv().into_bytes() });
    files.push(File { name: "trade.json".into(), bytes: json });
    // The text comes last: where it is, all that it shows is there.
    files.push(File { name: "trade.md".into(), bytes: text.into_bytes() });
    files::write_together(
        files.iter().map(|file| (folder.join(&file.name), file.bytes.as_slice())),
    )?;
    Ok(files.iter().map(|file| folder.join(&file.name).display().to_string()).collect())
}

/// The rows in a line each, and what to take.
fn described(trade: &Trade) -> String {
    let mut text = format!(
        "scene    {}: {} triangles\n\
         rays     {} of each kind timed, {} of each kind judged, {} rounds\n\
         exact    {}\n",
        quoted(&trade.scene.name),
        trade.scene.triangles,
        trade.amounts.sample_rays.max(trade.amounts.gpu_sample_rays),
        trade.amounts.error_rays.max(trade.amounts.gpu_error_rays),
        trade.amounts.repeat,
        trade.held.words()
    );
    for row in &trade.rows {
        text += &format!(
            "row {:>3}{} {:<44} build {:>9.2} ms  {:>7.0} ns a ray  {:>8.2} MB  SAH {:>7.2}  {:>8.1} errors/M  {:>8.1} rounded/M  pays {}\n",
            row.number,
            match row.pareto {
                Standing::Optimal => "*",
                Standing::Perhaps => "?",
                Standing::Beaten => " ",
            },
            row.title(),
            row.build_ms,
            row.ns_per_ray,
            row.query_bytes as f64 / 1e6,
            row.sah_cost,
            row.errors_per_million,
            row.rounded_per_million,
            row.payback.words()
        );
    }
    text += &format!("take     {}\n", trade.recommendation.words);
    if let Some(bvh) = &trade.bvh {
        text += &format!("bvh      {}\n", bvh.words);
    }
    text
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

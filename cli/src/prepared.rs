//! What every verb starts with: threads, a scene, a backend, and a tree over it.

use super::failure::Failure;
use super::options::{Announced, Common, Settled};
use super::tree::{TreeStats, tree_stats};
use super::{knobs, output, progress};
use serde::Serialize;
use serde_json::{Map, Value};
use splitplane::scene::Scene;
use splitplane::{Accelerator, BackendInfo, BuildOptions, QueryLayout};
use splitplane_scene::from_file::quoted;
use std::ffi::OsStr;
use std::time::Instant;

/// A scene with its tree, built.
pub(super) struct Prepared {
    pub(super) scene: Scene,
    pub(super) info: BackendInfo,
    pub(super) accelerator: Box<dyn Accelerator>,
    pub(super) build_ms: f64,
    preset: &'static str,
    preset_reason: Option<String>,
    reason: String,
}

/// Runs the work in a pool of as many threads as asked for.
pub(super) fn in_pool<R: Send>(
    common: &Common,
    work: impl FnOnce() -> Result<R, Failure> + Send,
) -> Result<R, Failure> {
    pool(common)?.install(work)
}

/// A pool of as many threads as asked for.
pub(super) fn pool(common: &Common) -> Result<rayon::ThreadPool, Failure> {
    common.time.begin();
    super::ending::check()?;
    pool_of(common.threads)
}

/// A pool of so many threads, of as many as there are cores when nothing is said.
pub(super) fn pool_of(threads: Option<u16>) -> Result<rayon::ThreadPool, Failure> {
    let threads = threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| Failure::usage(format!("cannot start the threads: {error}; try fewer")))
}

impl Prepared {
    /// Opens the scene and the backend and builds the tree, which is to answer so many rays. To be called inside [`in_pool`].
    pub(super) fn open(
        spec: &OsStr,
        common: &Common,
        rays: Announced,
    ) -> Result<Prepared, Failure> {
        // What is asked for and cannot be had is said before a large file is read.
        common.check_for(rays)?;
        let opened = common.open()?;
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let scene = Scene::open_with(spec, &common.bare_scene())?;
        spinner.finish_and_clear();
        note_scene(common, &scene);
        let info = opened.backend.describe();
        if !common.quiet {
            output::note(&format!("backend: {} ({})", info.name, opened.reason));
        }
        let mesh = scene.mesh()?;
        let Settled { options, reason: preset_reason } = common.settle(&mesh, rays)?;
        if options.layout == QueryLayout::Compact && info.name != "cpu" && !common.quiet {
            output::note("--compact: a tree on a GPU has one layout, which is what it gets");
        }
        let watch = progress::watch(common.quiet);
        let start = Instant::now();
        let accelerator =
            opened.backend.build(&mesh, &BuildOptions { watch: Some(&watch), ..options })?;
        let build_ms = milliseconds(start);
        drop(watch);
        note_dropped(common, &scene, accelerator.summary().dropped);
        let preset = options.config.preset().name();
        let reason = opened.reason;
        Ok(Prepared { scene, info, accelerator, build_ms, preset, preset_reason, reason })
    }

    /// What there is to report of the build.
    pub(super) fn built(&self) -> Built<'_> {
        Built {
            scene: &self.scene,
            info: &self.info,
            accelerator: self.accelerator.as_ref(),
            build_ms: self.build_ms,
            preset: self.preset,
            preset_reason: self.preset_reason.as_deref(),
            reason: &self.reason,
        }
    }
}

/// A tree that was built, for reports.
pub(super) struct Built<'a> {
    pub(super) scene: &'a Scene,
    pub(super) info: &'a BackendInfo,
    pub(super) accelerator: &'a dyn Accelerator,
    pub(super) build_ms: f64,
    pub(super) preset: &'static str,
    /// Why `auto` chose it.
    pub(super) preset_reason: Option<&'a str>,
    pub(super) reason: &'a str,
}

impl Built<'_> {
    pub(super) fn report(&self) -> BuildReport {
        let summary = self.accelerator.summary();
        BuildReport {
            scene: self.scene.name.clone(),
            triangles: summary.triangles,
            dropped: summary.dropped,
            snapped: summary.snapped,
            backend: self.info.name.clone(),
            adapter: self.info.adapter.clone(),
            preset: self.preset,
            preset_reason: self.preset_reason.map(str::to_owned),
            config: knobs::report(&self.accelerator.tree().config),
            threads: self.info.threads,
            build_ms: self.build_ms,
            stats: tree_stats(self.accelerator),
            bytes: self.accelerator.query_bytes(),
            digest: self.accelerator.tree().digest().to_string(),
        }
    }

    /// The build in a few readable lines.
    pub(super) fn describe(&self) -> String {
        let report = self.report();
        let by = match (&report.adapter, report.threads) {
            (Some(adapter), _) => adapter.clone(),
            (None, Some(threads)) => counted(threads as u64, "thread"),
            (None, None) => self.info.detail.clone(),
        };
        let stats = &report.stats;
        format!(
            "scene    {}: {} triangles, {} dropped\n\
             backend  {} ({by}; {})\n\
             knobs    {}\n\
             tree     {} nodes, {} leaves ({} empty), {} references, depth {}, SAH cost {:.2}\n\
             built    in {:.1} ms by preset {}, {} bytes, digest {}\n",
            quoted(&report.scene),
            report.triangles,
            report.dropped,
            report.backend,
            self.reason,
            knobs::describe(&self.accelerator.tree().config),
            stats.nodes,
            stats.leaves,
            stats.empty_leaves,
            stats.references,
            stats.max_depth,
            stats.sah_cost,
            report.build_ms,
            report.preset,
            report.bytes,
            report.digest
        )
    }
}

/// What `--json` says about a build.
#[derive(Serialize)]
pub(super) struct BuildReport {
    scene: String,
    triangles: u32,
    dropped: u32,
    snapped: u32,
    backend: String,
    adapter: Option<String>,
    preset: &'static str,
    /// Only where `auto` chose it.
    #[serde(skip_serializing_if = "Option::is_none")]
    preset_reason: Option<String>,
    config: Map<String, Value>,
    threads: Option<usize>,
    build_ms: f64,
    #[serde(flatten)]
    stats: TreeStats,
    bytes: u64,
    pub(super) digest: String,
}

pub(super) fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// `1 ray`, `2 rays`.
pub(super) fn counted(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// The command as it was given, for reports.
pub(super) fn command() -> String {
    let words: Vec<String> =
        std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    words.join(" ")
}

/// Says what a reader left out or found odd.
pub(super) fn note_scene(common: &Common, scene: &Scene) {
    if !common.quiet {
        for sentence in scene.notes.sentences() {
            output::note(&format!("note: {}: {sentence}", quoted(&scene.name)));
        }
        if scene.notes.textures_over_limit > 0 {
            output::note("note: --max-texture allows larger textures");
        }
    }
}

/// Says how many triangles a build left out.
pub(super) fn note_dropped(common: &Common, scene: &Scene, dropped: u32) {
    if !common.quiet && dropped > 0 {
        output::note(&format!(
            "note: {}: {dropped} triangles left out: a corner is not finite, or two are equal",
            quoted(&scene.name)
        ));
    }
}

/// One JSON object on a line of its own.
pub(super) fn print_json(report: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string(report)
        .map_err(|error| Failure::file(format!("cannot write the report as JSON: {error}")))?;
    output::data(&format!("{}\n", tame(text)))
}

/// The same JSON where what commands a terminal, which may stand in strings as it is, is written by its
/// number.
fn tame(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    let one = |letter: char| match letter.is_control() {
        true => format!("\\u{:04x}", u32::from(letter)),
        false => letter.to_string(),
    };
    text.chars().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_stays_json_and_commands_no_terminal() {
        let text = serde_json::to_string("a\u{9b}31m\u{7f}\u{1b}\"\n").unwrap();
        let tamed = tame(text);
        assert!(!tamed.contains(char::is_control), "{tamed:?}");
        assert_eq!(serde_json::from_str::<String>(&tamed).unwrap(), "a\u{9b}31m\u{7f}\u{1b}\"\n");
    }
}

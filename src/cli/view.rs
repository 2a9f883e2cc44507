//! `splitplane view`: an interactive window on a scene.

use super::failure::Failure;
use super::options::{Common, size};
use super::prepared::{pool, print_json};
use super::{output, progress};
use clap::Args;
use clap::builder::PossibleValuesParser;
use image::RgbaImage;
use serde::Serialize;
use splitplane::render::Size;
use splitplane::scene::Scene;
use splitplane::viewer::{DebugView, Ended, FrameReport, HostSource, Settings, run as open};
use std::io::Cursor;
use std::path::PathBuf;

/// Shown without arguments.
const DEFAULT_SCENE: &str = "builtin:city";

const NOTES: &str = "\
The window lists its keys on F1. Left drag turns, right drag pans, the wheel zooms, F changes \
between orbit and flight.

Exit codes are those of all verbs; 5 also where there is no display to open a window on, or no \
adapter that can draw in it, and 6 when the window's device is lost.";

#[derive(Args, Debug)]
#[command(after_help = NOTES)]
pub(super) struct Arguments {
    /// An .obj file or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: String,
    /// Width and height of the window in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: Size,
    /// What to show first
    #[arg(long, value_name = "VIEW", default_value = "shaded", value_parser = views())]
    view: String,
    /// Show the boxes of the tree's nodes at this depth
    #[arg(long, value_name = "DEPTH")]
    boxes: Option<u32>,
    /// End after so many frames that show a finished picture
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Write what the window shows to a .png file after --frames (1 when left out), and end
    #[arg(long, value_name = "FILE.png")]
    screenshot: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

fn views() -> PossibleValuesParser {
    PossibleValuesParser::new(DebugView::ALL.map(DebugView::name))
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    if let Some(path) = &arguments.screenshot {
        output::check_ending(path)?;
    }
    let build = common.build_options();
    build.config.validate().map_err(|error| Failure::usage(error.to_string()))?;
    let pool = pool(common)?;
    let spinner = progress::spinner(common.quiet, "reading the scene");
    let scene = Scene::open(&arguments.scene)?;
    spinner.finish_and_clear();
    if !common.quiet {
        for sentence in scene.notes.sentences() {
            output::note(&format!("note: {}: {sentence}", scene.name));
        }
    }
    let name = scene.name.clone();
    let options = common.open_options();
    let settings = Settings {
        size: [arguments.size.width(), arguments.size.height()],
        adapter: options.adapter.clone(),
        backend: common.backend,
        preset: build.config.preset,
        accuracy: common.query_options().accuracy,
        view: arguments.view(),
        level: arguments.boxes,
        depth: 8,
        samples: 1,
        frames: arguments.frames.or(arguments.screenshot.as_ref().map(|_| 1)),
        screenshot: arguments.screenshot.is_some(),
    };
    let source = HostSource::new(scene, options, build, pool);
    let ended = open(Box::new(source), settings)?;
    if let (Some(path), Some(image)) = (&arguments.screenshot, &ended.screenshot) {
        output::file(path, &png(image)?)?;
    }
    match &ended {
        Ended { report: Some(report), .. } if common.json => {
            print_json(&ViewReport::new(&name, report))
        }
        _ => Ok(()),
    }
}

impl Arguments {
    fn view(&self) -> DebugView {
        let view = DebugView::ALL.into_iter().find(|view| view.name() == self.view);
        view.unwrap_or_default()
    }
}

fn png(image: &RgbaImage) -> Result<Vec<u8>, Failure> {
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|error| Failure::file(format!("cannot encode the screenshot: {error}")))?;
    Ok(bytes.into_inner())
}

/// What `--json` says about the last frame.
#[derive(Serialize)]
struct ViewReport<'a> {
    scene: &'a str,
    backend: &'a str,
    triangles: u32,
    nodes: usize,
    leaves: usize,
    empty_leaves: usize,
    references: usize,
    max_depth: u32,
    sah_cost: f64,
    bytes: u64,
    rays: u64,
    build_ms: Option<f64>,
    trace_ms: f64,
    total_ms: f64,
}

impl<'a> ViewReport<'a> {
    fn new(scene: &'a str, report: &'a FrameReport) -> ViewReport<'a> {
        let tree = &report.tree;
        ViewReport {
            scene,
            backend: &report.backend,
            triangles: report.triangles,
            nodes: tree.nodes,
            leaves: tree.leaves,
            empty_leaves: tree.empty_leaves,
            references: tree.references,
            max_depth: tree.max_depth,
            sah_cost: tree.sah_cost,
            bytes: tree.bytes,
            rays: report.rays,
            build_ms: report.build_ms,
            trace_ms: report.trace_ms,
            total_ms: report.total_ms,
        }
    }
}

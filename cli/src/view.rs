//! `splitplane view`: an interactive window on a scene.

use super::failure::Failure;
use super::look::{MAX_TEXTURE, MaterialsName};
use super::options::{Common, bytes, size};
use super::prepared::{note_scene, pool, print_json};
use super::{files, progress};
use clap::Args;
use clap::builder::PossibleValuesParser;
use image::RgbaImage;
use serde::Serialize;
use splitplane::render::{RenderSettings, Size};
use splitplane::scene::{
    Animation, AnimationError, InstancedScene, Placement, Scene, SceneOptions,
};
use splitplane_viewer::{
    DebugView, Ended, FrameReport, FrameSource, ObjectsSource, Settings, TracedSource, run as open,
};
use std::ffi::OsString;
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
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: OsString,
    /// Width and height of the window in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = size)]
    size: Size,
    /// What to show first
    #[arg(long, value_name = "VIEW", default_value = "shaded", value_parser = views())]
    view: String,
    /// Show the boxes of the tree's nodes at this depth; many objects have no one tree
    #[arg(long, value_name = "DEPTH")]
    boxes: Option<u32>,
    /// How the scene moves: a folder of .obj files, NAME.frames.bin or NAME.npy; a built-in scene moves by itself
    #[arg(long, value_name = "FILE|DIR")]
    frames: Option<PathBuf>,
    /// How many lights to place in a scene that has none of its own, 1 to 8
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u8).range(1..=Placement::MAX_LIGHTS as i64))]
    lights: u8,
    /// Which surfaces of .mtl files are mirrors
    #[arg(long, value_enum, default_value_t = MaterialsName::Illum)]
    materials: MaterialsName,
    /// Most bytes that decoding one texture may take; all together may take sixteen times as many, one
    /// after the other. Textures past it are left out
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = MAX_TEXTURE)]
    max_texture: u64,
    /// Most reflections and refractions along a path, 0 to 16
    #[arg(long, value_name = "N", default_value_t = RenderSettings::default().depth)]
    #[arg(value_parser = clap::value_parser!(u32).range(0..=16))]
    depth: u32,
    /// End after so many frames that show a finished picture
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    stop_after: Option<u32>,
    /// Write what the window shows to a .png file after --stop-after frames (1 when left out), and end
    #[arg(long, value_name = "FILE.png")]
    screenshot: Option<PathBuf>,
    #[command(flatten)]
    pub(super) common: Common,
}

/// What is looked at.
enum Opened {
    One(Box<Scene>, Option<Animation>),
    Many(Box<InstancedScene>),
}

fn views() -> PossibleValuesParser {
    PossibleValuesParser::new(DebugView::ALL.map(DebugView::name))
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let common = &arguments.common;
    if let Some(path) = &arguments.screenshot {
        files::check_ending(path)?;
    }
    let build = common.build_options()?;
    let pool = pool(common)?;
    let spinner = progress::spinner(common.quiet, "reading the scene");
    let scene_options = SceneOptions {
        materials: arguments.materials.rule(),
        decode_limit: arguments.max_texture,
        file_limit: common.max_file,
        memory_limit: common.max_memory,
        ..SceneOptions::default()
    };
    let many = InstancedScene::is_named_by(&arguments.scene);
    let opened = match many {
        true => Opened::Many(Box::new(arguments.open_objects(&scene_options)?)),
        false => arguments.open_scene(&scene_options)?,
    };
    spinner.finish_and_clear();
    let parts = match &opened {
        Opened::One(scene, _) => scene,
        Opened::Many(scene) => &scene.parts,
    };
    let name = match &opened {
        Opened::One(scene, _) => scene.name.clone(),
        Opened::Many(scene) => scene.name.clone(),
    };
    note_scene(common, parts);
    let options = common.open_options();
    let settings = Settings {
        size: [arguments.size.width(), arguments.size.height()],
        adapter: options.adapter.clone(),
        backend: common.backend,
        preset: build.config.preset(),
        accuracy: common.query_options().accuracy,
        view: arguments.view(),
        level: arguments.boxes,
        depth: arguments.depth,
        samples: 1,
        frames: arguments.stop_after.or(arguments.screenshot.as_ref().map(|_| 1)),
        screenshot: arguments.screenshot.is_some(),
    };
    let lights = usize::from(arguments.lights);
    let defaults = RenderSettings::default();
    let source: Box<dyn FrameSource> = match opened {
        Opened::One(scene, moves) => {
            Box::new(TracedSource::new(*scene, moves, options, build, lights, defaults, pool))
        }
        Opened::Many(scene) => {
            Box::new(ObjectsSource::new(*scene, options, build, lights, defaults, pool))
        }
    };
    let ended = open(source, settings)?;
    if let (Some(path), Some(image)) = (&arguments.screenshot, &ended.screenshot) {
        files::write(path, &png(image)?)?;
    }
    match &ended {
        Ended { report: Some(report), .. } if common.json => {
            print_json(&ViewReport::new(&name, report))
        }
        _ => Ok(()),
    }
}

impl Arguments {
    /// The scene, and its frames if it has any.
    fn open_scene(&self, options: &SceneOptions) -> Result<Opened, Failure> {
        match Animation::open(&self.scene, self.frames.as_deref(), options) {
            Ok((scene, animation)) => Ok(Opened::One(Box::new(scene), Some(animation))),
            Err(AnimationError::NoFrames(_)) => {
                Ok(Opened::One(Box::new(Scene::open_with(&self.scene, options)?), None))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// A scene of many objects.
    fn open_objects(&self, options: &SceneOptions) -> Result<InstancedScene, Failure> {
        let wrong = match (&self.frames, self.boxes) {
            (Some(_), _) => "a scene of many objects moves by its own keys; leave --frames out",
            (_, Some(_)) => "a scene of many objects has no one tree; leave --boxes out",
            (None, None) => return Ok(InstancedScene::open_with(&self.scene, options)?),
        };
        Err(Failure::usage(wrong))
    }

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
    /// Null where the tree stayed on the device, as those that follow.
    leaves: Option<usize>,
    empty_leaves: Option<usize>,
    references: usize,
    max_depth: Option<u32>,
    sah_cost: Option<f64>,
    bytes: u64,
    /// Bytes that came back from the device for this frame.
    bytes_down: u64,
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
            leaves: tree.shape.map(|shape| shape.leaves),
            empty_leaves: tree.shape.map(|shape| shape.empty_leaves),
            references: tree.references,
            max_depth: tree.shape.map(|shape| shape.max_depth),
            sah_cost: tree.shape.map(|shape| shape.sah_cost),
            bytes: tree.bytes,
            bytes_down: report.bytes_down,
            rays: report.rays,
            build_ms: report.build_ms,
            trace_ms: report.trace_ms,
            total_ms: report.total_ms,
        }
    }
}

//! `splitplane render`, which is also what happens without a verb.

use super::failure::Failure;
use super::files::{self, ends_in};
use super::look::{Look, Placed, of_photons};
use super::objects::ObjectStage;
use super::options::Common;
use super::prepared::{BuildReport, in_pool, milliseconds, print_json};
use super::stage::{Stage, open_for_pictures};
use super::{output, progress};
use clap::{Args, ValueEnum};
use serde::Serialize;
use splitplane::picture::{self, Aov, HeatMap, Quantity};
use splitplane::picture::{FirstCost, FirstHit};
use splitplane::render::{FrameStats, Outputs, Size};
use splitplane::scene::{InstancedScene, Scene, SceneOptions};
use splitplane::tracer::{Frame, FrameRequest};
use std::borrow::Cow;
use std::ffi::OsString;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Shown without arguments: enough to see what the tree is for, quick to build.
const DEFAULT_SCENE: &str = "builtin:city";
/// Camera rays a pixel of a still picture, without and with surfaces that shine.
const SAMPLES: [u32; 2] = [4, 16];

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: OsString,
    /// The picture: .png for screens, or .exr for linear light; splitplane-SCENE.png in the current
    /// folder when left out
    #[arg(long, short, value_name = "FILE.png|.exr")]
    output: Option<PathBuf>,
    /// What else to write of the first ray of every pixel: beside a .png as pictures of their own, into
    /// an .exr as further channels
    #[arg(long, value_name = "LIST", value_enum, value_delimiter = ',')]
    aov: Vec<AovName>,
    /// In place of the picture, what the first ray of every pixel costs, with a scale
    #[arg(long, value_name = "WHAT", value_enum, conflicts_with = "aov")]
    heatmap: Option<QuantityName>,
    /// The value at the top of the scale; chosen to suit the picture when left out
    #[arg(long, value_name = "COUNT", requires = "heatmap")]
    heatmap_top: Option<NonZeroU32>,
    /// Print how the frame would be made, and the bytes of every buffer, and make none
    #[arg(long)]
    explain: bool,
    #[command(flatten)]
    look: Look,
    #[command(flatten)]
    pub(super) common: Common,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum AovName {
    /// Distance from the eye
    Depth,
    /// Unit normal of the triangle
    Normal,
    /// Index of the triangle; of many objects within its geometry
    Triangle,
    /// Which of many objects it is
    Instance,
    /// Nodes visited
    Nodes,
    /// Triangles tested
    Tests,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum QuantityName {
    /// Nodes visited
    Nodes,
    /// Triangles tested
    Triangles,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(path) = &arguments.output {
        arguments.check_ending(path)?;
    }
    in_pool(&arguments.common, || arguments.render())
}

impl Arguments {
    fn check_ending(&self, path: &Path) -> Result<(), Failure> {
        let shown = path.display();
        match (ends_in(path, "png"), ends_in(path, "exr"), self.heatmap) {
            (true, ..) | (_, true, None) => Ok(()),
            (_, true, Some(_)) => {
                Err(Failure::usage(format!("`{shown}`: heat maps are written as .png")))
            }
            _ => Err(Failure::usage(format!(
                "`{shown}` does not end in .png or .exr; these are the formats of pictures"
            ))),
        }
    }

    fn render(&self) -> Result<(), Failure> {
        self.look.check_transport()?;
        if InstancedScene::is_named_by(&self.scene) {
            return self.render_objects();
        }
        let Arguments { look, common, .. } = self;
        let opened = open_for_pictures(common, look)?;
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let scene = Scene::open_with(&self.scene, &self.scene_options())?;
        spinner.finish_and_clear();
        let mut stage = Stage::set(scene, opened, look, common)?;
        let path = self.output.clone().unwrap_or_else(|| default_name(&stage.scene.name));
        let shines = stage.tracer.appearance().needs().emitters > 0;
        let request = self.request(&stage.placed, shines, &path)?;
        if self.explain {
            let plan = stage.tracer.plan(&request)?;
            return output::data(&plan.explain());
        }
        let spinner = progress::spinner(common.quiet, "rendering");
        let start = Instant::now();
        let frame = stage.tracer.frame(&stage.scene.mesh()?, &request)?;
        let render_ms = milliseconds(start);
        spinner.finish_and_clear();
        let written = self.write(&frame, &path)?;
        let stats = *frame.stats();
        self.report(&stage, &stats, render_ms, &written)
    }

    /// What is asked of the tracer.
    fn request(
        &self,
        placed: &Placed,
        shines: bool,
        path: &Path,
    ) -> Result<FrameRequest<'static>, Failure> {
        let Arguments { look, common, .. } = self;
        Ok(FrameRequest {
            camera: placed.camera.pinhole(look.size),
            size: look.size,
            settings: look.settings(SAMPLES[usize::from(shines)], placed)?,
            outputs: self.outputs(path),
            query: common.query_options(),
        })
    }

    /// Renders a scene of many objects.
    fn render_objects(&self) -> Result<(), Failure> {
        let Arguments { look, common, .. } = self;
        let mut stage = ObjectStage::set(&self.scene, look, common)?;
        let path = self.output.clone().unwrap_or_else(|| default_name(&stage.scene.name));
        let shines = stage.tracer.appearance().needs().emitters > 0;
        let request = self.request(&stage.placed, shines, &path)?;
        if self.explain {
            let plan = stage.tracer.plan(&request)?;
            return output::data(&plan.explain());
        }
        let spinner = progress::spinner(common.quiet, "rendering");
        let start = Instant::now();
        let stats = stage.tracer.frame(&stage.scene.parts.mesh()?, &request)?;
        let render_ms = milliseconds(start);
        spinner.finish_and_clear();
        let size = look.size;
        let (hits, costs) = (stage.tracer.first_hits(), stage.tracer.first_costs());
        let (radiance, pixels) = (stage.tracer.radiance(), stage.tracer.pixels());
        let written = self.write_made(&path, &Made { size, hits, costs, radiance, pixels })?;
        stage.report_picture(look, common, &stats, render_ms, &written)
    }

    /// Heat maps show no surfaces.
    fn scene_options(&self) -> SceneOptions {
        let options = self.look.scene_options(&self.common);
        SceneOptions { textures: options.textures && self.heatmap.is_none(), ..options }
    }

    fn wants(&self, name: AovName) -> bool {
        self.aov.contains(&name)
    }

    fn outputs(&self, path: &Path) -> Outputs {
        let exr = ends_in(path, "exr");
        let hits = [AovName::Depth, AovName::Normal, AovName::Triangle, AovName::Instance];
        Outputs {
            pixels: self.heatmap.is_none() && !exr,
            radiance: exr,
            first_hits: hits.into_iter().any(|name| self.wants(name)),
            first_costs: self.heatmap.is_some()
                || self.wants(AovName::Nodes)
                || self.wants(AovName::Tests),
        }
    }

    /// Writes what was asked for and gives the files.
    fn write(&self, frame: &Frame<'_>, path: &Path) -> Result<Written, Failure> {
        let outputs = self.outputs(path);
        let hits = if outputs.first_hits { frame.first_hits()? } else { Cow::default() };
        let costs = if outputs.first_costs { frame.first_costs()? } else { Cow::default() };
        let radiance = if outputs.radiance { frame.radiance()? } else { Cow::default() };
        let pixels = if outputs.pixels { frame.pixels()? } else { Cow::default() };
        let (hits, costs, radiance, pixels) = (&*hits, &*costs, &*radiance, &*pixels);
        let size = self.look.size;
        self.write_made(path, &Made { size, hits, costs, radiance, pixels })
    }

    /// The same of what any tracer made.
    fn write_made(&self, path: &Path, made: &Made<'_>) -> Result<Written, Failure> {
        let Made { size, hits, costs, radiance, pixels } = *made;
        let mut written = Written { files: vec![path.to_owned()], heat: None };
        if let Some(quantity) = self.heatmap {
            let quantity = match quantity {
                QuantityName::Nodes => Quantity::Nodes,
                QuantityName::Triangles => Quantity::Tests,
            };
            let map = HeatMap::new(size, costs, quantity, self.heatmap_top)?;
            files::write(path, &picture::encode_png(&map.image)?)?;
            let of = &map.statistics;
            written.heat = Some(format!(
                "cost     {} a ray, first rays of pixels: mean {:.1}, median {}, 95 % at most {}, greatest {}\n",
                if quantity == Quantity::Nodes { "nodes visited" } else { "triangles tested" },
                of.mean,
                of.p50,
                of.p95,
                of.max
            ));
            return Ok(written);
        }
        let aovs: Vec<Aov<'_>> = [
            (AovName::Depth, Aov::Depth(hits)),
            (AovName::Normal, Aov::Normal(hits)),
            (AovName::Triangle, Aov::Triangle(hits)),
            (AovName::Instance, Aov::Instance(hits)),
            (AovName::Nodes, Aov::Nodes(costs)),
            (AovName::Tests, Aov::Tests(costs)),
        ]
        .into_iter()
        .filter_map(|(name, aov)| self.wants(name).then_some(aov))
        .collect();
        if self.outputs(path).radiance {
            files::write(path, &picture::encode_exr(size, radiance, &aovs)?)?;
            return Ok(written);
        }
        let screen = picture::screen(size, pixels)?;
        files::write(path, &picture::encode_png(&screen)?)?;
        for aov in aovs {
            let beside = path.with_extension(format!("{}.png", aov.name()));
            files::write(&beside, &picture::encode_png(&aov.picture(size)?)?)?;
            written.files.push(beside);
        }
        Ok(written)
    }

    fn report(
        &self,
        stage: &Stage,
        stats: &FrameStats,
        render_ms: f64,
        written: &Written,
    ) -> Result<(), Failure> {
        let (width, height) = (self.look.size.width(), self.look.size.height());
        let built = stage.built()?;
        let trace_ms = stats.tracing.map(|time| time.as_secs_f64() * 1e3);
        let names = written.names();
        if self.common.json {
            return print_json(&RenderReport {
                build: built.report(),
                width,
                height,
                samples: stats.plan.settings().samples,
                lights: stage.placed.lights.len(),
                lights_asked: stage.placed.asked(),
                emitters: stage.tracer.appearance().needs().emitters,
                paths: stats.paths,
                shadow_rays: stats.shadow_rays,
                photon_rays: stats.photon_rays,
                redone: stats.redone,
                trace_ms,
                render_ms,
                output: names,
            });
        }
        if self.common.quiet {
            return Ok(());
        }
        let tracing = trace_ms.map_or(String::new(), |ms| format!(", {ms:.1} ms of it tracing"));
        output::data(&format!(
            "{}{}traced   {} rays: {} camera, mirrored and refracted, {} shadow{}{}\n\
             rendered in {render_ms:.1} ms{tracing} ({:.1} million rays a second)\n{}\
             written  {} ({width}x{height})\n",
            built.describe(),
            stage.describe_placed(),
            stats.rays(),
            stats.paths,
            stats.shadow_rays,
            of_photons(stats),
            redone(stats),
            stats.rays() as f64 / render_ms.max(1e-6) / 1e3,
            written.heat.as_deref().unwrap_or(""),
            names.join(", ")
        ))
    }
}

/// How many rays of an exact frame a GPU left to the CPU.
fn redone(stats: &FrameStats) -> String {
    match stats.redone {
        0 => String::new(),
        rays => format!(", {rays} of them left by the GPU to the CPU"),
    }
}

/// What a tracer made; empty where it was not asked for.
struct Made<'a> {
    size: Size,
    hits: &'a [FirstHit],
    costs: &'a [FirstCost],
    radiance: &'a [[f32; 4]],
    pixels: &'a [u32],
}

/// What came of a frame.
pub(super) struct Written {
    files: Vec<PathBuf>,
    /// What a heat map says in numbers.
    pub(super) heat: Option<String>,
}

impl Written {
    /// The names of the files.
    pub(super) fn names(&self) -> Vec<String> {
        self.files.iter().map(|file| file.display().to_string()).collect()
    }
}

/// What `--json` says about a picture.
#[derive(Serialize)]
struct RenderReport {
    #[serde(flatten)]
    build: BuildReport,
    width: u32,
    height: u32,
    samples: u32,
    lights: usize,
    /// Lights to be placed, had there been places for all.
    lights_asked: Option<usize>,
    emitters: u32,
    paths: u64,
    shadow_rays: u64,
    /// Rays of photons, one for each bounce.
    photon_rays: u64,
    /// Rays that a GPU left undecided, and the CPU traced again: accuracy exact only.
    redone: u64,
    /// Time in queries; null where it is not measured.
    trace_ms: Option<f64>,
    render_ms: f64,
    output: Vec<String>,
}

/// A name in the current folder that no scene file has.
fn default_name(scene: &str) -> PathBuf {
    let bare = scene.strip_prefix("builtin:").unwrap_or(scene);
    let endings = [".obj", ".json", ".ply", ".stl", ".gltf", ".glb"];
    let bare = endings.iter().find_map(|ending| bare.strip_suffix(ending)).unwrap_or(bare);
    PathBuf::from(format!("splitplane-{}.png", bare.replace([':', '/', '\\'], "-")))
}

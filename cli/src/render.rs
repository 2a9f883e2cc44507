//! `splitplane render`, which is also what happens without a verb.

use super::failure::Failure;
use super::files::{self, ends_in};
use super::look::{Look, Placed, of_photons};
use super::made::{Made, Wanted, Written};
use super::objects::ObjectStage;
use super::options::Common;
use super::part_settings::{self, Settings};
use super::prepared::{BuildReport, in_pool, milliseconds, print_json};
use super::stage::{Stage, open_backend, shaded};
use super::{output, part_file, progress};
use clap::Args;
use serde::Serialize;
use splitplane::render::{FrameStats, Outputs, Part, RenderSettings, SceneData};
use splitplane::scene::{InstancedScene, Scene, SceneOptions};
use splitplane::tracer::{Frame, FrameRequest};
use splitplane_scene::from_file::quoted_path;
use std::borrow::Cow;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Shown without arguments: enough to see what the tree is for, quick to build.
const DEFAULT_SCENE: &str = "builtin:city";
/// Camera rays a pixel of a still picture, without and with light that is sampled: of surfaces that shine, or of an environment map.
const SAMPLES: [u32; 2] = [4, 16];

#[derive(Args, Debug)]
pub(super) struct Arguments {
    /// An .obj, .ply, .stl, .gltf or .glb file, a .json or .scene file of many objects, or builtin:NAME[:SIZE]
    #[arg(value_name = "SCENE", default_value = DEFAULT_SCENE)]
    scene: OsString,
    /// The picture: .png for screens, or .exr for linear light, or .picpart for a part of one; splitplane-SCENE.png in
    /// the current folder when left out, and splitplane-SCENE-I-of-N.picpart
    #[arg(long, short, value_name = "FILE.png|.exr|.picpart")]
    output: Option<PathBuf>,
    #[command(flatten)]
    wanted: Wanted,
    /// Render only part I of N, and write it as a .picpart; `merge` makes the picture of all parts
    #[arg(long, value_name = "I/N")]
    part: Option<Part>,
    /// Print how the frame would be made, and the bytes of every buffer, and make none
    #[arg(long)]
    explain: bool,
    #[command(flatten)]
    look: Look,
    #[command(flatten)]
    pub(super) common: Common,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(path) = &arguments.output {
        if arguments.part.is_none() {
            arguments.wanted.check_ending(path)?;
        } else if !ends_in(path, "picpart") {
            let shown = quoted_path(path);
            return Err(Failure::usage(format!(
                "`{shown}` does not end in .picpart, as parts of pictures do; `splitplane merge` makes the picture"
            )));
        }
    }
    in_pool(&arguments.common, || arguments.render())
}

impl Arguments {
    fn render(&self) -> Result<(), Failure> {
        self.look.check_transport()?;
        if InstancedScene::is_named_by(&self.scene) {
            return self.render_objects();
        }
        let Arguments { look, common, .. } = self;
        let opened = open_backend(common)?;
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let mut scene = Scene::open_with(&self.scene, &self.scene_options())?;
        look.surround(&mut scene, common)?;
        spinner.finish_and_clear();
        // Whether light is sampled is known later of triangles that shine beside other lights.
        let samples = SAMPLES[usize::from(scene.is_lit() && scene.lights.is_empty())];
        let parts = u64::from(self.part.unwrap_or_default().count());
        let rays = look.announced_rays(&scene, samples) / parts;
        if !scene.cutouts.is_empty() {
            return self.render_stage(ObjectStage::cut_out(scene, opened, look, rays, common)?);
        }
        let mut stage = Stage::set(scene, opened, look, rays, common)?;
        let path = self.path(&stage.scene.name);
        let shines = shines(stage.tracer.appearance());
        let request = self.request(&stage.placed, shines, &path)?;
        stage.choose(&request, common)?;
        let shading = stage.tracer.shading(&request.settings);
        if self.explain {
            let plan = stage.tracer.plan(&request)?;
            return output::data(&(shaded(shading, &stage.info) + &plan.explain()));
        }
        let of_part = |_| part_settings::of_mesh(&stage, &request);
        let settings = self.part.map(of_part).transpose()?;
        let spinner = progress::spinner(common.quiet, "rendering");
        let start = Instant::now();
        let frame = stage.tracer.frame(&stage.scene.mesh()?, &request)?;
        let render_ms = milliseconds(start);
        spinner.finish_and_clear();
        let written = self.write(&path, &frame, settings.as_ref())?;
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
            settings: RenderSettings {
                part: self.part.unwrap_or_default(),
                ..look.settings(SAMPLES[usize::from(shines)], placed)?
            },
            outputs: self.outputs(path),
            query: common.query_options(),
        })
    }

    /// Renders a scene of many objects.
    fn render_objects(&self) -> Result<(), Failure> {
        self.render_stage(ObjectStage::set(&self.scene, &self.look, &self.common)?)
    }

    fn render_stage(&self, mut stage: ObjectStage) -> Result<(), Failure> {
        let Arguments { look, common, .. } = self;
        let path = self.path(&stage.scene.name);
        let shines = shines(stage.tracer.appearance());
        let request = self.request(&stage.placed, shines, &path)?;
        if self.explain {
            let plan = stage.tracer.plan(&request)?;
            return output::data(&(shaded(stage.tracer.shading(), &stage.info) + &plan.explain()));
        }
        let of_part = |_| part_settings::of_objects(&stage, &request);
        let settings = self.part.map(of_part).transpose()?;
        let spinner = progress::spinner(common.quiet, "rendering");
        let start = Instant::now();
        let stats = stage.tracer.frame(&stage.scene.parts.mesh()?, &request)?;
        let render_ms = milliseconds(start);
        spinner.finish_and_clear();
        let size = look.size;
        let hits = stage.scene.baked.original_hits(stage.tracer.first_hits());
        let (hits, costs) = (&*hits, stage.tracer.first_costs());
        let (radiance, pixels) = (stage.tracer.radiance(), stage.tracer.pixels());
        let made = Made { size, hits, costs, radiance, pixels };
        let written = self.write_made(&path, &made, settings.as_ref())?;
        stage.report_picture(look, common, &stats, render_ms, &written)
    }

    /// Heat maps show no surfaces. Pictures show their holes.
    fn scene_options(&self) -> SceneOptions {
        let options = self.look.scene_options(&self.common);
        let textures = options.textures && !self.wanted.is_heatmap();
        SceneOptions { textures, cutouts: textures, ..options }
    }

    fn outputs(&self, path: &Path) -> Outputs {
        // Of a part either may be asked for later.
        let (is_part, exr) = (self.part.is_some(), ends_in(path, "exr"));
        self.wanted.outputs(is_part || !exr, is_part || exr)
    }

    /// Where the picture or its part goes.
    fn path(&self, scene: &str) -> PathBuf {
        self.output.clone().unwrap_or_else(|| match self.part {
            None => default_name(scene, ".png"),
            Some(part) => {
                default_name(scene, &format!("-{}-of-{}.picpart", part.index(), part.count()))
            }
        })
    }

    /// Writes what was asked for and gives the files.
    fn write(
        &self,
        path: &Path,
        frame: &Frame<'_>,
        settings: Option<&Settings>,
    ) -> Result<Written, Failure> {
        let outputs = self.outputs(path);
        let hits = if outputs.first_hits { frame.first_hits()? } else { Cow::default() };
        let costs = if outputs.first_costs { frame.first_costs()? } else { Cow::default() };
        let radiance = if outputs.radiance { frame.radiance()? } else { Cow::default() };
        let pixels = if outputs.pixels { frame.pixels()? } else { Cow::default() };
        let (hits, costs, radiance, pixels) = (&*hits, &*costs, &*radiance, &*pixels);
        let made = Made { size: self.look.size, hits, costs, radiance, pixels };
        self.write_made(path, &made, settings)
    }

    /// The same of what any tracer made. A part says by which settings.
    fn write_made(
        &self,
        path: &Path,
        made: &Made<'_>,
        settings: Option<&Settings>,
    ) -> Result<Written, Failure> {
        let (Some(part), Some(settings)) = (self.part, settings) else {
            return self.wanted.write(path, made);
        };
        let bytes = part_file::to_bytes(part, &self.wanted, settings, made)
            .map_err(|error| Failure::limit(format!("the part {part} of the picture: {error}")))?;
        files::write(path, &bytes)?;
        Ok(Written { files: vec![path.to_owned()], heat: None })
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
                shading: stage.tracer.shading(stats.plan.settings()).to_string(),
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
            "{}{}{}traced   {} rays: {} camera, mirrored and refracted, {} shadow{}{}\n\
             rendered in {render_ms:.1} ms{tracing} ({:.1} million rays a second)\n{}\
             written  {} ({width}x{height})\n",
            built.describe(),
            stage.describe_placed(),
            shaded(stage.tracer.shading(stats.plan.settings()), &stage.info),
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
    /// Rays that a GPU left to the CPU, undecided or unfinished.
    redone: u64,
    /// `cpu`, `gpu`, or `cpu, rays on gpu`.
    shading: String,
    /// Time in queries; null where it is not measured.
    trace_ms: Option<f64>,
    render_ms: f64,
    output: Vec<String>,
}

/// Whether light is sampled: that of surfaces, or of a map. It takes more camera rays.
fn shines(scene: &SceneData) -> bool {
    let needs = scene.needs();
    needs.emitters > 0 || needs.environment_map
}

/// A name in the current folder that no scene file has.
fn default_name(scene: &str, ending: &str) -> PathBuf {
    let bare = scene.strip_prefix("builtin:").unwrap_or(scene);
    let endings = [".obj", ".json", ".ply", ".stl", ".gltf", ".glb"];
    let bare = endings.iter().find_map(|ending| bare.strip_suffix(ending)).unwrap_or(bare);
    PathBuf::from(format!("splitplane-{}{ending}", bare.replace([':', '/', '\\'], "-")))
}

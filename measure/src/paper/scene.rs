//! A scene measured: every builder's tree, its frame, and the rays of the frame alone.

mod contender;

use super::machine::Knobs;
use super::rays::FrameRays;
use super::survey::{SurveyScene, nearest};
use super::timing::{median, pool, timed};
use super::{Builder, ReportError};
use contender::Contender;
use serde::Serialize;
use splitplane::backend::OpenOptions;
use splitplane::scene::{Camera, Placement, Scene, SceneOptions};
use splitplane::tracer::{FrameRequest, TracerError};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::{BuildConfig, Preset};
use splitplane_core::error::BuildError;
use splitplane_core::ray::{Hit, QueryOptions};
use splitplane_cpu::CpuBackend;
use splitplane_render::{Outputs, RenderSettings, Size};
use std::ffi::OsStr;

/// How to measure.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Pixels of a frame.
    pub size: Size,
    /// Runs of each measure, of which the median counts. Odd.
    pub repeat: usize,
    /// Frames of scenes that move.
    pub frames: usize,
    /// Threads of whatever runs in parallel on the CPU.
    pub threads: usize,
    /// Who builds.
    pub builders: Vec<Builder>,
    /// The GPU, for builders on it.
    pub open: OpenOptions,
    /// Most bytes of a build.
    pub max_memory: Option<u64>,
}

impl Settings {
    /// How a preset builds.
    pub fn build(&self, preset: Preset) -> BuildOptions<'static> {
        self.build_with(preset.config())
    }

    /// How trees of a configuration are built.
    pub fn build_with(&self, config: BuildConfig) -> BuildOptions<'static> {
        BuildOptions { config, max_memory: self.max_memory, ..BuildOptions::default() }
    }
}

/// A scene with camera and lights, and how it is named.
#[derive(Clone, Debug)]
pub struct Placed {
    /// The scene; its lights are those of the report.
    pub scene: Scene,
    /// From where it is seen.
    pub camera: Camera,
    /// Whether it is an interior.
    pub inside: bool,
    /// Whether the lights were placed for want of any.
    pub by_rule: bool,
}

impl Placed {
    /// Opens a scene and gives it camera and lights: as many lights without a size as asked for, its own
    /// if it brings as many, else placed by rule; its own, or one, when no number is given.
    ///
    /// # Errors
    /// There is no such scene, it is empty, or no tree of it can be built.
    pub fn open(
        spec: impl AsRef<OsStr>,
        lights: Option<usize>,
        settings: &Settings,
    ) -> Result<Placed, ReportError> {
        Placed::open_with(spec, lights, settings, &SceneOptions::default())
    }

    /// As [`Placed::open`], with a say in how files are read.
    ///
    /// # Errors
    /// As [`Placed::open`].
    pub fn open_with(
        spec: impl AsRef<OsStr>,
        lights: Option<usize>,
        settings: &Settings,
        options: &SceneOptions,
    ) -> Result<Placed, ReportError> {
        let spec = spec.as_ref();
        let mut scene = Scene::open_with(spec, options)?;
        if let Some(spec) = spec.to_str().filter(|spec| spec.starts_with("builtin:")) {
            // With its size, which tells two of a report apart.
            scene.name = spec.to_owned();
        }
        if lights.is_some_and(|lights| lights != scene.lights.len()) {
            scene.lights.clear();
        }
        let placement = pool(settings.threads)?.install(|| {
            let options = settings.build(Preset::Fast);
            let accelerator = &CpuBackend::new().build_accelerator(&scene.mesh()?, &options)?;
            if accelerator.tree().bounds.is_empty() {
                return Err(ReportError::Empty(scene.name.clone()));
            }
            let aspect = settings.size.aspect();
            Ok(Placement::of_with(&scene, accelerator, aspect, lights.unwrap_or(1))?)
        })?;
        let by_rule = !scene.is_lit();
        scene.lights = placement.lights;
        Ok(Placed { scene, camera: placement.camera, inside: placement.inside, by_rule })
    }

    /// How a picture of it is made.
    pub fn settings(&self, samples: u32, depth: u32) -> RenderSettings {
        let usual = RenderSettings::default();
        RenderSettings {
            samples,
            depth,
            ambient: if self.inside { RenderSettings::INSIDE_AMBIENT } else { usual.ambient },
            headlight: if self.by_rule { RenderSettings::PLACED_HEADLIGHT } else { 0.0 },
            ..usual
        }
    }
}

/// What one builder's tree is like and what it takes. Times in milliseconds, medians.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BuilderRow {
    /// The preset's name.
    pub preset: &'static str,
    /// `tuned`, or `equal` for the costs that all builders of this kind share.
    pub knobs: &'static str,
    /// `cpu` or `wgpu`.
    pub backend: String,
    /// Whether the others are compared with it.
    pub offline: bool,
    /// Threads that built, on the CPU.
    pub threads: Option<usize>,
    /// T_tree: from triangles in host memory to a tree that frames can be made of.
    pub tree_ms: f64,
    /// T_trace: a frame of camera and shadow rays, shaded, until its pixels are in host memory.
    pub trace_ms: f64,
    /// The rays of the report alone, as two batches from and to host memory.
    pub rays_ms: f64,
    /// Equation 5, corrected: SAH cost of the finished tree, root-normalised, in units of K_I with every
    /// triangle counted and K_T and K_I of [`super::EQUAL_COSTS`], whatever the builder's own.
    pub sah_cost: f64,
    /// Equation 5 as printed, in the same units: relative to parents, a leaf's triangles not counted.
    pub printed_cost: f64,
    /// The cost with leaves costed by blocks of W triangles, with W, K_T and K_I of preset `fast`.
    pub block_cost: f64,
    /// Nodes.
    pub nodes: usize,
    /// Leaves.
    pub leaves: usize,
    /// References of all leaves.
    pub references: usize,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Bytes that queries read.
    pub bytes: u64,
    /// The tree's name.
    pub digest: String,
}

/// A scene measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneReport {
    /// Its letter in the report, from a on.
    pub letter: char,
    /// Its name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// Triangles left out.
    pub dropped: u32,
    /// Lights without a size.
    pub lights: usize,
    /// Camera rays of a frame.
    pub camera_rays: usize,
    /// Shadow rays of the report.
    pub shadow_rays: usize,
    /// Camera rays and rays towards lights that the frame traces, which also go to surfaces that
    /// shine and leave those out that do not scatter.
    pub frame_rays: u64,
    /// The name of the rays of the report.
    pub rays: String,
    /// The row of the survey of nearest size.
    pub survey: &'static SurveyScene,
    /// The builders, the offline one first.
    pub builders: Vec<BuilderRow>,
    /// Builders that there are not, a sentence each.
    pub left_out: Vec<String>,
}

impl SceneReport {
    /// Presets whose tree on the GPU is another one than on the CPU. On a GPU whose parity is bitwise
    /// there is none.
    pub fn differing(&self) -> Vec<&'static str> {
        let gpu = self.builders.iter().filter(|row| row.threads.is_none());
        let differs = |row: &&BuilderRow| {
            let alike = |other: &BuilderRow| (other.preset, other.knobs) == (row.preset, row.knobs);
            let same = |other: &&BuilderRow| alike(other) && other.threads.is_some();
            self.builders.iter().find(same).is_some_and(|other| other.digest != row.digest)
        };
        gpu.filter(differs).map(|row| row.preset).collect()
    }

    /// The builder that a row is compared with: the offline one with the same knobs.
    pub fn offline(&self, knobs: &str) -> Option<&BuilderRow> {
        self.builders.iter().find(|row| row.offline && row.knobs == knobs)
    }
}

/// Measures a scene. `step` is called after each of [`steps`].
///
/// # Errors
/// A tree or frame that cannot be made.
pub fn measure(
    letter: char,
    placed: &Placed,
    settings: &Settings,
    step: &mut dyn FnMut(&str),
) -> Result<SceneReport, ReportError> {
    let scene = &placed.scene;
    let tracing = pool(settings.threads)?;
    let mut rays = None;
    let mut contenders = Vec::new();
    let mut left_out = Vec::new();
    for &builder in &settings.builders {
        match Contender::new(builder, placed, settings, &tracing, &mut rays) {
            Ok(contender) => contenders.push(contender),
            // Presets come to devices one by one; what a GPU lacks, the report lacks and says.
            Err(ReportError::Tracer(TracerError::Build(
                error @ BuildError::PresetNotOnDevice { .. },
            ))) if builder.gpu => left_out.push(error.to_string()),
            Err(error) => return Err(error),
        }
        step(&format!("{}: rays through {}", scene.name, builder.preset.name()));
    }
    let rays = rays.unwrap_or(FrameRays { camera: Vec::new(), shadow: Vec::new() });
    let request = FrameRequest {
        camera: placed.camera.pinhole(settings.size),
        size: settings.size,
        // Neither reflections nor refractions: the rays that the survey counts.
        settings: placed.settings(1, 0),
        outputs: Outputs::PIXELS,
        query: QueryOptions::default(),
    };
    let mut frame_rays = 0;
    // The first round warms up.
    for round in 0..=settings.repeat {
        for contender in &mut contenders {
            frame_rays = contender.round(scene, &request, &tracing, round > 0)?;
        }
        step(&format!("{}: trees and frames", scene.name));
    }
    let triangles = scene.indices.len();
    let dropped = contenders.first().map_or(0, |first| first.tracer.summary().dropped);
    Ok(SceneReport {
        letter,
        name: scene.name.clone(),
        triangles,
        dropped,
        lights: scene.lights.len(),
        camera_rays: rays.camera.len(),
        shadow_rays: rays.shadow.len(),
        frame_rays,
        rays: rays.digest(),
        survey: nearest(triangles),
        builders: contenders.into_iter().map(Contender::finish).collect(),
        left_out,
    })
}

/// How often [`measure`] calls `step`.
pub fn steps(settings: &Settings) -> u64 {
    (settings.builders.len() + settings.repeat + 1) as u64
}

/// The median time to trace the rays of a frame: closest hits, then any hits.
pub(super) fn trace(
    accelerator: &dyn Accelerator,
    rays: &FrameRays,
    repeat: usize,
) -> Result<f64, ReportError> {
    let options = QueryOptions::default();
    let mut hits = vec![Hit::MISS; rays.camera.len()];
    let mut stopped = vec![false; rays.shadow.len()];
    let mut times = Vec::with_capacity(repeat);
    for round in 0..=repeat {
        let (traced, ms) = timed(|| {
            accelerator.closest_hits(&rays.camera, &mut hits, &options)?;
            accelerator.any_hits(&rays.shadow, &mut stopped, &options)
        });
        traced?;
        if round > 0 {
            times.push(ms);
        }
    }
    Ok(median(times))
}

/// The knobs of every preset of these builders, each once.
pub fn knobs(builders: &[Builder]) -> Vec<Knobs> {
    let mut presets: Vec<Preset> = builders.iter().map(|builder| builder.preset).collect();
    presets.sort_by_key(|preset| *preset as u32);
    presets.dedup();
    presets.into_iter().map(Knobs::from).collect()
}

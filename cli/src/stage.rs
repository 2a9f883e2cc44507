//! What verbs that make pictures start with: a scene, its tree, camera and lights, on one backend.

use super::failure::Failure;
use super::look::{Look, Placed};
use super::options::{Common, Settled};
use super::prepared::{Built, milliseconds, note_dropped, note_scene};
use super::{output, progress};
use splitplane::backend::OpenedEngine;
use splitplane::render::Appearance;
use splitplane::scene::Scene;
#[cfg(feature = "wgpu")]
use splitplane::tracer::RayTrial;
use splitplane::tracer::{FrameRequest, Shading, Tracer};
use splitplane::{Accelerator, BackendInfo, BuildOptions};
#[cfg(feature = "wgpu")]
use splitplane::{BackendKind, CpuBackend};
use splitplane_scene::from_file::quoted;
use std::time::Instant;

/// A scene that is built, placed and described.
pub(super) struct Stage {
    pub(super) scene: Scene,
    pub(super) tracer: Tracer,
    pub(super) placed: Placed,
    pub(super) options: BuildOptions<'static>,
    pub(super) info: BackendInfo,
    build_ms: f64,
    preset_reason: Option<String>,
    reason: String,
}

/// Opens the backend. To be called before a large file is read: what is asked for and cannot be had is
/// said first.
pub(super) fn open_backend(common: &Common) -> Result<OpenedEngine, Failure> {
    common.check()?;
    common.open_engine()
}

/// Where a picture is shaded, as a line of a report; empty where all of it is done in one place.
pub(super) fn shaded(shading: Shading, info: &BackendInfo) -> String {
    match shading {
        Shading::CpuWithRaysOnGpu => {
            format!("shading  {}\n", shading.describe(info.adapter.as_deref()))
        }
        _ => String::new(),
    }
}

impl Stage {
    /// Builds the tree of a scene for about so many rays, places camera and lights, and describes what it looks like.
    pub(super) fn set(
        mut scene: Scene,
        OpenedEngine { engine, reason }: OpenedEngine,
        look: &Look,
        rays: u64,
        common: &Common,
    ) -> Result<Stage, Failure> {
        note_scene(common, &scene);
        let info = engine.as_backend().describe();
        if !common.quiet {
            output::note(&format!("backend: {} ({reason})", info.name));
        }
        let settled = common.settle(&scene.mesh()?, Ok(rays))?;
        let Settled { options, reason: preset_reason } = settled;
        let watch = progress::watch(common.quiet);
        let start = Instant::now();
        // Camera and lights are placed by rays; what the scene looks like is taken over when it has both.
        let appearance = Appearance::default();
        let watched = BuildOptions { watch: Some(&watch), ..options };
        let mut tracer = Tracer::load(engine, &scene.mesh()?, &appearance, &watched)?;
        let build_ms = milliseconds(start);
        drop(watch);
        note_dropped(common, &scene, tracer.summary().dropped);
        let spinner = progress::spinner(common.quiet, "placing camera and lights");
        let placed = look.place(&mut scene, host_tree(&tracer)?)?;
        spinner.finish_and_clear();
        if let Some(asked) = placed.asked()
            && placed.lights.len() < asked
            && !common.quiet
        {
            output::note(&format!(
                "note: {}: {} of {asked} lights are placed; no further place reaches what the camera \
                 sees",
                quoted(&scene.name),
                placed.lights.len()
            ));
        }
        scene.lights.clone_from(&placed.lights);
        tracer.update_appearance(&scene.mesh()?, &scene.appearance())?;
        Ok(Stage { scene, tracer, placed, options, info, build_ms, preset_reason, reason })
    }

    /// For `auto`, where the CPU shades what a GPU could trace: takes the one that traces a wave of rays of this picture faster. Pictures do
    /// not depend on it.
    #[cfg(feature = "wgpu")]
    pub(super) fn choose(
        &mut self,
        request: &FrameRequest<'_>,
        common: &Common,
    ) -> Result<(), Failure> {
        if common.backend != BackendKind::Auto {
            return Ok(());
        }
        let spinner = progress::spinner(common.quiet, "timing rays on the GPU and on the CPU");
        let trial = self.tracer.try_rays(&self.scene.mesh()?, request)?;
        spinner.finish_and_clear();
        let Some(trial) = trial else { return Ok(()) };
        let gpu = self.info.adapter.clone().unwrap_or_else(|| self.info.name.clone());
        self.reason = reason(&gpu, &trial);
        if !trial.is_for_gpu() {
            let (mesh, options) = (self.scene.mesh()?, self.options);
            self.tracer =
                Tracer::load(CpuBackend::new(), &mesh, &self.scene.appearance(), &options)?;
            self.info = self.tracer.backend();
        }
        if !common.quiet {
            output::note(&format!("backend: {} ({})", self.info.name, self.reason));
        }
        Ok(())
    }

    #[cfg(not(feature = "wgpu"))]
    pub(super) fn choose(&mut self, _: &FrameRequest<'_>, _: &Common) -> Result<(), Failure> {
        Ok(())
    }

    /// What there is to report of the build.
    pub(super) fn built(&self) -> Result<Built<'_>, Failure> {
        Ok(Built {
            scene: &self.scene,
            info: &self.info,
            accelerator: host_tree(&self.tracer)?,
            build_ms: self.build_ms,
            preset: self.options.config.preset().name(),
            preset_reason: self.preset_reason.as_deref(),
            reason: &self.reason,
        })
    }

    /// Camera and lights in words.
    pub(super) fn describe_placed(&self) -> String {
        let [x, y, z] = self.placed.camera.eye();
        let view = self.placed.view.map_or("as given", |view| view.name());
        let lights = match (self.placed.lights.len(), self.tracer.appearance().needs().emitters) {
            (0, 0) => "none but the environment".to_owned(),
            (0, shining) => format!("{shining} triangles that shine"),
            (count, 0) => format!("{count}{}", if self.placed.by_rule { ", placed" } else { "" }),
            (count, shining) => format!("{count}, and {shining} triangles that shine"),
        };
        format!("camera   at {x},{y},{z}, {view}\nlights   {lights}\n")
    }
}

/// Why `auto` took one or the other for the rays of a picture that the CPU shades.
#[cfg(feature = "wgpu")]
fn reason(gpu: &str, trial: &RayTrial) -> String {
    let [on_gpu, on_cpu] = [trial.gpu, trial.cpu].map(|time| time.as_secs_f64() * 1e3);
    let rays = trial.rays;
    match trial.is_for_gpu() {
        true => format!(
            "auto: the CPU shades; `{gpu}` traces: {rays} rays took {on_gpu:.1} ms there, {on_cpu:.1} ms on the CPU"
        ),
        false => format!(
            "auto: the CPU shades, and traces: {rays} rays took it {on_cpu:.1} ms, `{gpu}` {on_gpu:.1} ms"
        ),
    }
}

/// The tree that the last load brought to host memory.
fn host_tree(tracer: &Tracer) -> Result<&dyn Accelerator, Failure> {
    tracer.accelerator().ok_or_else(|| Failure::bug("the tree is on the GPU alone"))
}

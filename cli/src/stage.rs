//! What verbs that make pictures start with: a scene, its tree, camera and lights, on one backend.

use super::failure::Failure;
use super::look::{Look, Placed};
use super::options::Common;
use super::prepared::{Built, milliseconds, note_dropped, note_scene};
use super::{output, progress};
use splitplane::backend::OpenedEngine;
use splitplane::render::Appearance;
use splitplane::scene::Scene;
use splitplane::tracer::Tracer;
use splitplane::{Accelerator, BackendInfo, BackendKind, BuildOptions};
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
    reason: String,
}

/// Opens the backend. To be called before a large file is read: what is asked for and cannot be had is
/// said first.
pub(super) fn open_backend(common: &Common) -> Result<OpenedEngine, Failure> {
    common.build_options()?;
    Ok(common.backend.open_engine(&common.open_options())?)
}

/// The same for pictures of a mesh. `auto` takes the CPU where it alone makes them.
pub(super) fn open_for_pictures(common: &Common, look: &Look) -> Result<OpenedEngine, Failure> {
    let Some(reason) = look.is_for_the_cpu().filter(|_| common.backend != BackendKind::Cpu) else {
        return open_backend(common);
    };
    if common.backend == BackendKind::Wgpu {
        return Err(Failure::usage(
            "a GPU renders direct light in one pass, and without environment maps: --transport paths and photons, --passes, and \
             --environment with a file need --backend cpu",
        ));
    }
    let mut cpu = common.clone();
    cpu.backend = BackendKind::Cpu;
    let opened = open_backend(&cpu)?;
    Ok(OpenedEngine { reason: reason.into(), ..opened })
}

impl Stage {
    /// Builds the tree of a scene, places camera and lights, and describes what it looks like.
    pub(super) fn set(
        mut scene: Scene,
        OpenedEngine { engine, reason }: OpenedEngine,
        look: &Look,
        common: &Common,
    ) -> Result<Stage, Failure> {
        note_scene(common, &scene);
        let info = engine.as_backend().describe();
        if !common.quiet {
            output::note(&format!("backend: {} ({reason})", info.name));
        }
        let options = common.build_options()?;
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
        Ok(Stage { scene, tracer, placed, options, info, build_ms, reason })
    }

    /// What there is to report of the build.
    pub(super) fn built(&self) -> Result<Built<'_>, Failure> {
        Ok(Built {
            scene: &self.scene,
            info: &self.info,
            accelerator: host_tree(&self.tracer)?,
            build_ms: self.build_ms,
            preset: self.options.config.preset().name(),
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

/// The tree that the last load brought to host memory.
fn host_tree(tracer: &Tracer) -> Result<&dyn Accelerator, Failure> {
    tracer.accelerator().ok_or_else(|| Failure::bug("the tree is on the GPU alone"))
}

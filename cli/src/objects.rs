//! What verbs that show scenes of many objects start with: the scene, what answers its rays, camera and lights.

use super::failure::Failure;
use super::look::{Look, Placed};
use super::options::{Common, Settled};
use super::prepared::{milliseconds, note_scene};
use super::stage::open_backend;
use super::{output, progress};
use splitplane::backend::OpenedEngine;
use splitplane::objects;
use splitplane::scene::instanced::geometries;
use splitplane::scene::{InstancedScene, Scene};
use splitplane::tracer::{InstanceTracer, InstancedLook};
use splitplane::{Backend, BackendInfo, BackendKind, BuildOptions, CpuBackend, OpenOptions};
use splitplane_scene::from_file::quoted;
use std::ffi::OsStr;
use std::time::Instant;

/// A scene of many objects that is built, placed and described.
pub(super) struct ObjectStage {
    pub(super) scene: InstancedScene,
    pub(super) tracer: InstanceTracer,
    pub(super) placed: Placed,
    pub(super) info: BackendInfo,
    pub(super) build_ms: f64,
    pub(super) reason: String,
    pub(super) preset: &'static str,
    described: objects::Scene,
    /// The numbers of first triangles and materials, for frames.
    numbers: (Vec<u32>, Vec<u32>),
    options: BuildOptions<'static>,
}

/// What bringing a scene into a frame took.
pub(super) struct Updated {
    /// Instances that were made anew.
    pub(super) moved: u64,
    pub(super) ms: f64,
}

impl ObjectStage {
    pub(super) fn set(spec: &OsStr, look: &Look, common: &Common) -> Result<ObjectStage, Failure> {
        // What is asked for and cannot be had is said before a large file is read.
        common.build_options()?;
        let opened = open_backend(common)?;
        let spinner = progress::spinner(common.quiet, "reading the scene");
        let mut scene = InstancedScene::open_with(spec, &look.scene_options(common))?;
        look.surround(&mut scene.parts, common)?;
        spinner.finish_and_clear();
        if !common.quiet {
            for sentence in scene.parts.notes.sentences() {
                output::note(&format!("note: {}: {sentence}", quoted(&scene.name)));
            }
        }
        let placed = look.place_objects(&mut scene)?;
        let settled = Settled { options: common.build_options()?, reason: None };
        ObjectStage::of((scene, placed), opened, settled, common)
    }

    /// A mesh whose materials have holes. Camera and lights are placed as for any mesh, by rays that know of no holes.
    pub(super) fn cut_out(
        mut scene: Scene,
        opened: OpenedEngine,
        look: &Look,
        rays: u64,
        common: &Common,
    ) -> Result<ObjectStage, Failure> {
        note_scene(common, &scene);
        let settled = common.settle(&scene.mesh()?, Ok(rays))?;
        let spinner = progress::spinner(common.quiet, "placing camera and lights");
        let tree = CpuBackend::new().build(&scene.mesh()?, &settled.options)?;
        let placed = look.place(&mut scene, &*tree)?;
        spinner.finish_and_clear();
        // The device of `auto` would have the CPU find what rays enter.
        let opened = match common.backend {
            BackendKind::Auto => {
                let cpu = BackendKind::Cpu.open_engine(&OpenOptions::default())?;
                let reason = "auto: the CPU, which sees holes of surfaces by itself".into();
                OpenedEngine { reason, ..cpu }
            }
            _ => opened,
        };
        ObjectStage::of((InstancedScene::cut_out(scene)?, placed), opened, settled, common)
    }

    /// Builds a scene whose camera and lights have their places.
    fn of(
        (mut scene, placed): (InstancedScene, Placed),
        OpenedEngine { engine, reason }: OpenedEngine,
        Settled { options, .. }: Settled,
        common: &Common,
    ) -> Result<ObjectStage, Failure> {
        let info = engine.as_backend().describe();
        if !common.quiet {
            output::note(&format!("backend: {} ({reason})", info.name));
            if info.name != "cpu" {
                output::note("note: the GPU traces rays; the CPU shades");
            }
        }
        scene.parts.lights.clone_from(&placed.lights);
        let watch = progress::watch(common.quiet);
        let start = Instant::now();
        let described = scene.describe()?;
        let numbers = scene.numbers();
        let shown = InstancedLook {
            mesh: scene.parts.mesh()?,
            appearance: scene.parts.appearance(),
            geometries: geometries(&numbers),
        };
        let watched = BuildOptions { watch: Some(&watch), ..options };
        let tracer = InstanceTracer::load(engine, &described, &shown, &watched)?;
        let build_ms = milliseconds(start);
        if let Some(reason) = tracer.scene().placed_by_cpu().filter(|_| !common.quiet) {
            output::note(&format!("note: the CPU finds the instances that rays enter: {reason}"));
        }
        drop(watch);
        let preset = options.config.preset().name();
        Ok(ObjectStage {
            scene,
            tracer,
            placed,
            info,
            build_ms,
            reason,
            preset,
            described,
            numbers,
            options,
        })
    }

    /// Brings everything into a frame.
    pub(super) fn update(&mut self, frame: u32) -> Result<Updated, Failure> {
        let start = Instant::now();
        self.scene.set(frame, &mut self.described)?;
        let shown = InstancedLook {
            mesh: self.scene.parts.mesh()?,
            appearance: self.scene.parts.appearance(),
            geometries: geometries(&self.numbers),
        };
        let report = self.tracer.update(&self.described, &shown, &self.options)?;
        Ok(Updated { moved: report.instances_changed as u64, ms: milliseconds(start) })
    }
}

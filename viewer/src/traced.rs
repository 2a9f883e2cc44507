//! Frames by the ray tracer, on the backend that is asked for: the CPU's pictures are sent to the
//! window's device, those of the window's own GPU never leave it.

mod views;

use super::slot::Slot;
use super::source::{
    Abilities, DebugView, FirstFrame, FrameDevice, FrameError, FrameReport, FrameRequest,
    FrameSource, FrameTarget, Opening, TreeReport, TreeShape,
};
use splitplane::backend::{BackendKind, OpenError, OpenOptions, failed};
use splitplane::render::{MAX_DEPTH, RenderSettings, Size};
use splitplane::scene::{Animation, Change, Placement, Scene, View};
use splitplane::tracer::{self, Moved, Tracer};
use splitplane_core::backend::{Accelerator, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::ray::{Accuracy, QueryOptions};
use splitplane_core::tree::KdTree;
use splitplane_core::tree::stats::TreeStats;
use splitplane_cpu::CpuBackend;
use splitplane_wgpu::{Gpu, Parity, WgpuBackend};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::time::Instant;
pub(super) use views::{debug_picture, outputs, words};

/// Frames a second of an animation that does not say when its frames are.
const FRAMES_A_SECOND: f64 = 24.0;
/// Samples a pixel to choose from.
const MAX_SAMPLES: u32 = 16;

/// A scene, its frames if it moves, and a place for each backend.
pub struct TracedSource {
    scene: Scene,
    animation: Option<Animation>,
    open: OpenOptions,
    build: BuildOptions<'static>,
    lights: usize,
    settings: RenderSettings,
    pool: rayon::ThreadPool,
    cpu: Slot,
    gpu: Slot,
    /// What the tree that is there was built for.
    built: Option<Built>,
    placement: Option<Placement>,
    /// A frame that the window's device is at.
    out: Option<Out>,
    /// Frames that are done and were not asked for yet, in order.
    done: VecDeque<Result<FrameReport, FrameError>>,
    /// Bytes that had come back with the last report.
    bytes_down: u64,
}

/// A frame that was submitted.
#[derive(Debug)]
struct Out {
    start: Instant,
    traced: Instant,
    /// All that is known before it is done.
    report: FrameReport,
}

/// A tree that is kept until another one is asked for.
#[derive(Clone, Debug)]
struct Built {
    backend: BackendKind,
    preset: Preset,
    frame: usize,
    name: String,
    /// Where it is in host memory.
    shape: Option<TreeShape>,
}

/// The time that went into a tree.
#[derive(Clone, Copy, Debug, Default)]
struct Prepared {
    update_ms: f64,
    build_ms: Option<f64>,
}

impl TracedSource {
    /// A source of pictures of a scene, which moves when there is an animation. The preset in `build`
    /// gives way to the one that is asked for; its limit of memory holds for every build. `lights` is how
    /// many are placed where the scene has none; `settings` hold but for depth and samples, which are
    /// chosen in the window. `pool` does the work of the CPU.
    pub fn new(
        scene: Scene,
        animation: Option<Animation>,
        open: OpenOptions,
        build: BuildOptions<'static>,
        lights: usize,
        settings: RenderSettings,
        pool: rayon::ThreadPool,
    ) -> TracedSource {
        TracedSource {
            scene,
            animation,
            open,
            build,
            lights,
            settings,
            pool,
            cpu: Slot::Opened(CpuBackend::new().into()),
            gpu: Slot::Empty,
            built: None,
            placement: None,
            out: None,
            done: VecDeque::new(),
            bytes_down: 0,
        }
    }

    /// Opens and tests a backend on the window's own device when it is first asked for. Gives its parity.
    fn connect(&mut self, target: &FrameDevice) -> Result<Option<Parity>, FrameError> {
        if self.gpu.is_open() {
            return Ok(None);
        }
        let (backend, parity) = connected(target, self.open.allow_structural)?;
        self.gpu = Slot::Opened(backend.into());
        Ok(parity)
    }

    /// What `Auto` becomes: the window's device where it is hardware and bitwise equal to the CPU.
    fn choose(
        &mut self,
        asked: BackendKind,
        target: &FrameDevice,
    ) -> Result<(BackendKind, String), FrameError> {
        match asked {
            BackendKind::Cpu => return Ok((BackendKind::Cpu, "asked for".into())),
            BackendKind::Wgpu => {
                self.connect(target)?;
                return Ok((BackendKind::Wgpu, "asked for".into()));
            }
            _ => {}
        }
        let info = target.device.adapter_info();
        if info.device_type == wgpu::DeviceType::Cpu {
            return Ok((BackendKind::Cpu, format!("auto: `{}` is software", info.name)));
        }
        match self.connect(target) {
            Ok(Some(Parity::Bitwise)) => {
                Ok((BackendKind::Wgpu, "auto: hardware; parity: bitwise".into()))
            }
            Ok(_) => Ok((BackendKind::Cpu, format!("auto: `{}` is not bitwise", info.name))),
            Err(error) if error.is_device_loss() => Err(error),
            Err(error) => Ok((BackendKind::Cpu, format!("auto: {error}"))),
        }
    }

    /// The frame of the animation that is shown at a time.
    fn frame_at(&self, time: f64) -> usize {
        let Some(animation) = &self.animation else { return 0 };
        let part = (time / self.seconds().unwrap_or(1.0)).rem_euclid(1.0);
        ((part * animation.frames() as f64) as usize).min(animation.frames() - 1)
    }

    fn seconds(&self) -> Option<f64> {
        let animation = self.animation.as_ref()?;
        let frames = animation.frames();
        let (first, last) = (animation.time(0), animation.time(frames - 1));
        let told = match (first, last) {
            (Some(first), Some(last)) if frames > 1 && last > first => {
                (last - first) * frames as f64 / (frames - 1) as f64
            }
            _ => frames as f64 / FRAMES_A_SECOND,
        };
        Some(told)
    }

    /// Builds the tree that is asked for, unless it is there. Where it is wanted `here`, it also comes to host memory,
    /// for the panel's counts and the boxes; else a build on the window's device is only submitted.
    fn prepare(
        &mut self,
        backend: BackendKind,
        preset: Preset,
        frame: usize,
        here: bool,
        target: &FrameDevice,
    ) -> Result<Prepared, FrameError> {
        let same = |built: &Built| {
            let is_there = built.shape.is_some() || !here;
            is_there && (built.backend, built.preset, built.frame) == (backend, preset, frame)
        };
        if self.built.as_ref().is_some_and(same) {
            return Ok(Prepared::default());
        }
        match backend {
            BackendKind::Wgpu => drop(self.connect(target)?),
            _ if !self.cpu.is_open() => self.cpu = Slot::Opened(CpuBackend::new().into()),
            _ => {}
        }
        let start = Instant::now();
        let moved = match &mut self.animation {
            Some(animation) => animation.set(frame, &mut self.scene)?,
            None => Change::Nothing,
        };
        if let (Change::Everything, Some(placement)) = (moved, &self.placement) {
            self.scene.lights.clone_from(&placement.lights);
        }
        let switched = self.built.as_ref().is_none_or(|built| built.backend != backend);
        let mut options = self.build;
        if preset != options.config.preset() {
            // The knobs that were given are those of the preset that was given.
            options.config = preset.into();
        }
        let (mesh, appearance) = (self.scene.mesh()?, self.scene.appearance());
        let (slot, pool) = match backend {
            BackendKind::Wgpu => (&mut self.gpu, &self.pool),
            _ => (&mut self.cpu, &self.pool),
        };
        if let Some(tracer) = slot.tracer_mut() {
            pool.install(|| match moved {
                Change::Positions if !switched => {
                    tracer.update_normals(&mesh, &appearance);
                    Ok(())
                }
                Change::Nothing if !switched => Ok(()),
                _ => tracer.update_appearance(&mesh, &appearance),
            })?;
        }
        let update_ms = milliseconds(start);
        let start = Instant::now();
        let stays = !here && backend == BackendKind::Wgpu;
        pool.install(|| match slot.tracer_mut() {
            Some(tracer) if stays => {
                tracer.submit_rebuild(&Moved { mesh, name: Some(frame as u64) }, &options)
            }
            Some(tracer) => tracer.rebuild_for_queries(&mesh, &options),
            None => slot.load(&mesh, &appearance, &options),
        })?;
        let build_ms = Some(milliseconds(start));
        let tracer = slot.tracer().ok_or(FrameError::NoScene)?;
        let shape = match tracer.accelerator() {
            Some(accelerator) if !stays => {
                let stats = TreeStats::of(&accelerator.tree().view());
                Some(TreeShape {
                    leaves: stats.leaves,
                    empty_leaves: stats.empty_leaves,
                    max_depth: stats.max_depth,
                    sah_cost: stats.sah_cost,
                })
            }
            _ => None,
        };
        let info = pool.install(|| tracer.backend());
        let name = match (&info.adapter, info.threads) {
            (Some(adapter), _) => format!("{} ({adapter})", info.name),
            (None, Some(1)) => format!("{} (1 thread)", info.name),
            (None, Some(threads)) => format!("{} ({threads} threads)", info.name),
            (None, None) => info.name,
        };
        self.built = Some(Built { backend, preset, frame, name, shape });
        Ok(Prepared { update_ms, build_ms })
    }

    /// The tracer whose tree is there.
    fn tracer(&self) -> Option<&Tracer> {
        match self.built.as_ref()?.backend {
            BackendKind::Wgpu => self.gpu.tracer(),
            _ => self.cpu.tracer(),
        }
    }

    /// The tree that is there.
    fn accelerator(&self) -> Option<&dyn Accelerator> {
        self.tracer()?.accelerator()
    }

    /// Waits for the frame that is under way on the window's device.
    fn settle(&mut self) {
        let Some(Out { start, traced, report }) = self.out.take() else { return };
        let made = match self.gpu.tracer_mut() {
            Some(tracer) => {
                tracer.finish_frame().map(|made| made.stats().rays()).map_err(FrameError::from)
            }
            None => Err(FrameError::NoScene),
        };
        let made = made.map(|rays| {
            let (trace_ms, total_ms) = (milliseconds(traced), milliseconds(start));
            self.completed(FrameReport { trace_ms, total_ms, rays, ..report })
        });
        self.done.push_back(made);
    }

    /// A report with what is known at the end: the tree, and what has come back.
    fn completed(&mut self, report: FrameReport) -> FrameReport {
        let Some(tracer) = self.tracer() else { return report };
        let (size, triangles) = (tracer.tree_size(), tracer.summary().triangles);
        let down = self.gpu.tracer().and_then(Tracer::traffic).map_or(0, |all| all.bytes_down);
        let bytes_down = down.saturating_sub(self.bytes_down);
        self.bytes_down = down;
        let tree = TreeReport {
            nodes: size.nodes,
            references: size.references,
            bytes: size.bytes,
            ..report.tree
        };
        FrameReport { triangles, tree, bytes_down, ..report }
    }

    /// Makes the frame and puts it into the window's buffer. Gives rays and legend; `None` where the device is still at it.
    fn show(
        &mut self,
        request: &FrameRequest,
        size: Size,
        target: &FrameTarget<'_>,
    ) -> Result<Option<(u64, Option<String>)>, FrameError> {
        let settings =
            RenderSettings { depth: request.depth, samples: request.samples, ..self.settings };
        let query = QueryOptions { accuracy: request.accuracy, ..QueryOptions::default() };
        let outputs = outputs(request.view);
        let settings =
            if outputs.pixels { settings } else { RenderSettings { samples: 1, ..settings } };
        let camera = request.camera.pinhole(size);
        let frame = tracer::FrameRequest { camera, size, settings, outputs, query };
        let (mesh, pool) = (self.scene.mesh()?, &self.pool);
        let on_gpu = request.backend == BackendKind::Wgpu;
        let slot = if on_gpu { &mut self.gpu } else { &mut self.cpu };
        let tracer = slot.tracer_mut().ok_or(FrameError::NoScene)?;
        if on_gpu && outputs.pixels {
            tracer.submit_frame_into(&mesh, &frame, target.pixels)?;
            return Ok(None);
        }
        let made = pool.install(|| tracer.frame(&mesh, &frame))?;
        let rays = made.stats().rays();
        let send = |words: &[u32]| {
            target.queue.write_buffer(target.pixels, 0, bytemuck::cast_slice(words));
        };
        if outputs.pixels {
            send(&made.pixels()?);
            return Ok(Some((rays, None)));
        }
        let hits = if outputs.first_hits { made.first_hits()? } else { Cow::default() };
        let costs = if outputs.first_costs { made.first_costs()? } else { Cow::default() };
        let (image, legend) = pool.install(|| debug_picture(request.view, size, &hits, &costs))?;
        send(&words(&image));
        Ok(Some((rays, legend)))
    }
}

impl FrameSource for TracedSource {
    fn open(&mut self, target: &FrameDevice, first: &FirstFrame) -> Result<Opening, FrameError> {
        let (backend, reason) = self.choose(first.backend, target)?;
        let frame = self.frame_at(0.0);
        // Lights are placed for what is seen.
        let own = self.animation.as_ref().and_then(|animation| animation.camera(frame));
        self.scene.camera = self.scene.camera.or(own);
        self.prepare(backend, first.preset, frame, true, target)?;
        let placement = {
            let accelerator = self.accelerator().ok_or(FrameError::NoScene)?;
            let (scene, lights) = (&self.scene, self.lights);
            self.pool.install(|| Placement::of_with(scene, accelerator, first.aspect, lights))?
        };
        let by_rule = !self.scene.is_lit();
        self.scene.lights.clone_from(&placement.lights);
        if by_rule && self.settings.headlight == 0.0 {
            self.settings.headlight = RenderSettings::PLACED_HEADLIGHT;
        }
        if placement.inside {
            self.settings.ambient = RenderSettings::INSIDE_AMBIENT;
        }
        let (mesh, appearance) = (self.scene.mesh()?, self.scene.appearance());
        let slot = if backend == BackendKind::Wgpu { &mut self.gpu } else { &mut self.cpu };
        let tracer = slot.tracer_mut().ok_or(FrameError::NoScene)?;
        self.pool.install(|| tracer.update_appearance(&mesh, &appearance))?;
        let accelerator = tracer.accelerator().ok_or(FrameError::NoScene)?;
        let camera = placement.camera;
        // A scene's own camera looks at what it turns about, and so does one from outside; one from
        // inside only looks somewhere.
        let mut distance = length(camera.eye(), camera.look_at());
        if placement.view == View::Inside || self.animation.is_some() {
            let ahead = camera.through(1, 1, [[0.5, 0.5]]);
            let hit = ahead
                .first()
                .and_then(|ray| accelerator.closest_hit(ray, &QueryOptions::default()));
            distance = hit.map_or(distance, |hit| f64::from(hit.t));
        }
        let bounds = accelerator.tree().bounds;
        let abilities = Abilities {
            backends: vec![BackendKind::Cpu, BackendKind::Wgpu],
            presets: Preset::ALL.to_vec(),
            accuracies: vec![Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact],
            views: DebugView::ALL.to_vec(),
            max_depth: MAX_DEPTH,
            max_samples: MAX_SAMPLES,
            seconds: self.seconds(),
        };
        self.placement = Some(placement);
        let scene = self.scene.name.clone();
        Ok(Opening { scene, bounds, camera, distance, backend, reason, abilities })
    }

    fn submit(
        &mut self,
        request: &FrameRequest,
        target: &FrameTarget<'_>,
    ) -> Result<(), FrameError> {
        let start = Instant::now();
        let device = FrameDevice { device: target.device.clone(), queue: target.queue.clone() };
        let frame = self.frame_at(request.time);
        if request.tree {
            // Its tree goes.
            self.settle();
        }
        let prepared =
            self.prepare(request.backend, request.preset, frame, request.tree, &device)?;
        // The device has been told of the next vertices and tree: now it may come to the end of this frame.
        self.settle();
        if target.superseded() {
            return Err(FrameError::Superseded);
        }
        let (shape, backend) =
            self.built.as_ref().map(|b| (b.shape, b.name.clone())).unwrap_or_default();
        let report = FrameReport {
            update_ms: prepared.update_ms,
            build_ms: prepared.build_ms,
            tree: TreeReport { shape, ..TreeReport::default() },
            backend,
            ..FrameReport::default()
        };
        let traced = Instant::now();
        let shown = match Size::new(request.width, request.height) {
            Ok(size) => self.show(request, size, target)?,
            // A window too large for a picture, or one without a pixel.
            Err(_) => Some((0, None)),
        };
        match shown {
            None => self.out = Some(Out { start, traced, report }),
            Some((rays, legend)) => {
                let (trace_ms, total_ms) = (milliseconds(traced), milliseconds(start));
                let made = FrameReport { trace_ms, total_ms, rays, legend, ..report };
                let made = self.completed(made);
                self.done.push_back(Ok(made));
            }
        }
        Ok(())
    }

    fn is_done(&mut self) -> bool {
        let is_out = self.out.is_some();
        !self.done.is_empty()
            || !is_out
            || self.gpu.tracer_mut().is_none_or(|tracer| tracer.is_frame_done())
    }

    fn finish(&mut self) -> Result<FrameReport, FrameError> {
        if self.done.is_empty() {
            self.settle();
        }
        self.done.pop_front().unwrap_or(Err(FrameError::NothingSubmitted))
    }

    fn tree(&self) -> Option<&KdTree> {
        Some(self.accelerator()?.tree())
    }
}

/// A backend on the window's own device, tested, and its parity.
pub(super) fn connected(
    target: &FrameDevice,
    allow_structural: bool,
) -> Result<(WgpuBackend, Option<Parity>), FrameError> {
    let gpu = Gpu::borrow(target.device.clone(), target.queue.clone());
    let (adapter, driver) = (gpu.info().name.clone(), gpu.info().driver.clone());
    let backend = WgpuBackend::new(gpu).map_err(|error| failed(&adapter, &driver, &error))?;
    let parity = backend.parity().cloned();
    match &parity {
        Some(Parity::Structural(difference)) if !allow_structural => {
            let difference = difference.clone();
            Err(OpenError::Structural { adapter, difference }.into())
        }
        _ => Ok((backend, parity)),
    }
}

pub(super) fn length(a: [f32; 3], b: [f32; 3]) -> f64 {
    let square = |axis: usize| (f64::from(a[axis]) - f64::from(b[axis])).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

pub(super) fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

//! Frames of a scene of many objects. Instances move from frame to frame; only what moved is brought up to date. The backend traces the
//! rays, the CPU shades, and the picture is sent to the window's device.

use super::source::{
    Abilities, DebugView, FirstFrame, FrameDevice, FrameError, FrameReport, FrameRequest,
    FrameSource, FrameTarget, Opening, TreeReport,
};
use super::traced::{connected, debug_picture, length, milliseconds, outputs, words};
use splitplane::backend::{BackendKind, OpenOptions};
use splitplane::objects;
use splitplane::render::{MAX_DEPTH, RenderSettings, Size};
use splitplane::scene::InstancedScene;
use splitplane::scene::instanced::geometries;
use splitplane::tracer::{self, InstanceTracer, InstancedLook, RenderBackend};
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::BuildOptions;
use splitplane_core::config::Preset;
use splitplane_core::ray::{Accuracy, QueryOptions};
use splitplane_core::tree::KdTree;
use splitplane_cpu::CpuBackend;
use splitplane_wgpu::Parity;
use std::collections::VecDeque;
use std::time::Instant;

/// Samples a pixel to choose from.
const MAX_SAMPLES: u32 = 16;

/// A scene of many objects, and what answers its rays.
pub struct ObjectsSource {
    scene: InstancedScene,
    /// The description that moves with the scene; none before the source is open.
    described: Option<objects::Scene>,
    /// The numbers of first triangles and materials.
    numbers: (Vec<u32>, Vec<u32>),
    open: OpenOptions,
    build: BuildOptions<'static>,
    lights: usize,
    settings: RenderSettings,
    pool: rayon::ThreadPool,
    built: Option<Built>,
    /// Frames that are done and were not asked for yet, in order.
    done: VecDeque<Result<FrameReport, FrameError>>,
}

/// What answers rays, and what it was built for.
struct Built {
    backend: BackendKind,
    preset: Preset,
    frame: u32,
    name: String,
    tracer: InstanceTracer,
}

/// The time that went into what answers rays.
#[derive(Clone, Copy, Debug, Default)]
struct Prepared {
    update_ms: f64,
    build_ms: Option<f64>,
}

impl ObjectsSource {
    /// A source of pictures of a scene, which moves where it has frames. The parameters are those of
    /// [`TracedSource::new`](crate::TracedSource::new).
    pub fn new(
        scene: InstancedScene,
        open: OpenOptions,
        build: BuildOptions<'static>,
        lights: usize,
        settings: RenderSettings,
        pool: rayon::ThreadPool,
    ) -> ObjectsSource {
        let numbers = scene.numbers();
        let (described, built, done) = (None, None, VecDeque::new());
        ObjectsSource {
            scene,
            described,
            numbers,
            open,
            build,
            lights,
            settings,
            pool,
            built,
            done,
        }
    }

    fn seconds(&self) -> Option<f64> {
        let frames = f64::from(self.scene.frames);
        (self.scene.frames > 1).then_some(frames * self.scene.seconds_per_frame)
    }

    /// The frame that is shown at a time.
    fn frame_at(&self, time: f64) -> u32 {
        let part = (time / self.seconds().unwrap_or(1.0)).rem_euclid(1.0);
        ((part * f64::from(self.scene.frames)) as u32).min(self.scene.frames.saturating_sub(1))
    }

    /// The backend that is asked for. On the window's own device it is tested first.
    fn backend(
        &self,
        kind: BackendKind,
        target: &FrameDevice,
    ) -> Result<RenderBackend, FrameError> {
        if kind != BackendKind::Wgpu {
            return Ok(CpuBackend::new().into());
        }
        let (backend, _) = connected(target, self.open.allow_structural)?;
        Ok(backend.into())
    }

    /// What `Auto` becomes. The CPU shades such scenes, so a device has to be hardware and bitwise equal to gain anything.
    fn choose(
        &self,
        asked: BackendKind,
        target: &FrameDevice,
    ) -> Result<(BackendKind, String, Option<RenderBackend>), FrameError> {
        if asked != BackendKind::Auto {
            return Ok((asked, "asked for".into(), None));
        }
        let info = target.device.adapter_info();
        let cpu = |reason: String| Ok((BackendKind::Cpu, format!("auto: {reason}"), None));
        if info.device_type == wgpu::DeviceType::Cpu {
            return cpu(format!("`{}` is software", info.name));
        }
        match connected(target, self.open.allow_structural) {
            Ok((backend, Some(Parity::Bitwise))) => {
                let reason = "auto: hardware; parity: bitwise".into();
                Ok((BackendKind::Wgpu, reason, Some(backend.into())))
            }
            Ok(_) => cpu(format!("`{}` is not bitwise", info.name)),
            Err(error) if error.is_device_loss() => Err(error),
            Err(error) => cpu(error.to_string()),
        }
    }

    /// Builds what is asked for, unless it is there, and moves the instances to a frame. `ready` is the backend, where it has been opened.
    fn prepare(
        &mut self,
        (kind, preset, frame): (BackendKind, Preset, u32),
        ready: Option<RenderBackend>,
        target: &FrameDevice,
    ) -> Result<Prepared, FrameError> {
        let start = Instant::now();
        let mut options = self.build;
        if preset != options.config.preset() {
            // The knobs that were given are those of the preset that was given.
            options.config = preset.into();
        }
        let same =
            |built: &Built| ready.is_none() && (built.backend, built.preset) == (kind, preset);
        let is_there = self.built.as_ref().is_some_and(same);
        if is_there && self.built.as_ref().is_some_and(|built| built.frame == frame) {
            return Ok(Prepared::default());
        }
        let described = match &mut self.described {
            Some(described) => described,
            none => none.insert(self.scene.describe().map_err(moved)?),
        };
        self.scene.set(frame, described).map_err(moved)?;
        let look = InstancedLook {
            mesh: self.scene.parts.mesh()?,
            appearance: self.scene.parts.appearance(),
            geometries: geometries(&self.numbers),
        };
        if let Some(built) = self.built.as_mut().filter(|_| is_there) {
            let tracer = &mut built.tracer;
            self.pool.install(|| tracer.update(described, &look, &options))?;
            built.frame = frame;
            return Ok(Prepared { update_ms: milliseconds(start), build_ms: None });
        }
        let backend = match ready {
            Some(backend) => backend,
            None => self.backend(kind, target)?,
        };
        let (start, described) = (Instant::now(), self.described.as_ref());
        let described = described.ok_or(FrameError::NoScene)?;
        let tracer =
            self.pool.install(|| InstanceTracer::load(backend, described, &look, &options))?;
        let build_ms = Some(milliseconds(start));
        let info = self.pool.install(|| tracer.backend());
        let name = match (&info.adapter, info.threads) {
            (Some(adapter), _) => format!("{} ({adapter}), shaded by the CPU", info.name),
            (None, Some(1)) => format!("{} (1 thread)", info.name),
            (None, Some(threads)) => format!("{} ({threads} threads)", info.name),
            (None, None) => info.name,
        };
        self.built = Some(Built { backend: kind, preset, frame, name, tracer });
        Ok(Prepared { update_ms: 0.0, build_ms })
    }

    /// The box around all instances where they are.
    fn bounds(&self) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        if let Some(built) = &self.built {
            let placements = built.tracer.scene().scene().placements();
            let boxes = placements.filter_map(|(_, placement)| placement.world_box);
            // A box that is everywhere says nothing of where the scene is.
            let known = |own: &Aabb| own.lo.iter().chain(&own.hi).all(|x| x.abs() < f32::MAX);
            bounds = boxes
                .map(|own| own.bounds)
                .filter(known)
                .fold(bounds, |bounds, own| bounds.union(&own));
        }
        bounds
    }

    /// Makes the frame and puts it into the window's buffer. Gives rays and legend.
    fn show(
        &mut self,
        request: &FrameRequest,
        size: Size,
        target: &FrameTarget<'_>,
    ) -> Result<(u64, Option<String>), FrameError> {
        let settings =
            RenderSettings { depth: request.depth, samples: request.samples, ..self.settings };
        let query = QueryOptions { accuracy: request.accuracy, ..QueryOptions::default() };
        let outputs = outputs(request.view);
        let settings =
            if outputs.pixels { settings } else { RenderSettings { samples: 1, ..settings } };
        let camera = request.camera.pinhole(size);
        let frame = tracer::FrameRequest { camera, size, settings, outputs, query };
        let mesh = self.scene.parts.mesh()?;
        let tracer = &mut self.built.as_mut().ok_or(FrameError::NoScene)?.tracer;
        let rays = self.pool.install(|| tracer.frame(&mesh, &frame))?.rays();
        let send = |words: &[u32]| {
            target.queue.write_buffer(target.pixels, 0, bytemuck::cast_slice(words));
        };
        if outputs.pixels {
            send(tracer.pixels());
            return Ok((rays, None));
        }
        let (hits, costs) = (tracer.first_hits(), tracer.first_costs());
        let (image, legend) =
            self.pool.install(|| debug_picture(request.view, size, hits, costs))?;
        send(&words(&image));
        Ok((rays, legend))
    }
}

/// Why instances are not where they should be.
fn moved(error: impl std::fmt::Display) -> FrameError {
    FrameError::Animation(error.to_string())
}

impl FrameSource for ObjectsSource {
    fn open(&mut self, target: &FrameDevice, first: &FirstFrame) -> Result<Opening, FrameError> {
        let (backend, reason, ready) = self.choose(first.backend, target)?;
        let placement = self.scene.placement(first.aspect, self.lights);
        let by_rule = !self.scene.is_lit();
        self.scene.parts.lights.clone_from(&placement.lights);
        if by_rule && self.settings.headlight == 0.0 {
            self.settings.headlight = RenderSettings::PLACED_HEADLIGHT;
        }
        self.prepare((backend, first.preset, self.frame_at(0.0)), ready, target)?;
        let camera = placement.camera;
        let abilities = Abilities {
            backends: vec![BackendKind::Cpu, BackendKind::Wgpu],
            presets: Preset::ALL.to_vec(),
            accuracies: vec![Accuracy::Watertight, Accuracy::Fast, Accuracy::Exact],
            views: DebugView::ALL.to_vec(),
            max_depth: MAX_DEPTH,
            max_samples: MAX_SAMPLES,
            seconds: self.seconds(),
        };
        let (bounds, scene) = (self.bounds(), self.scene.name.clone());
        let distance = length(camera.eye(), camera.look_at());
        Ok(Opening { scene, bounds, camera, distance, backend, reason, abilities })
    }

    fn submit(
        &mut self,
        request: &FrameRequest,
        target: &FrameTarget<'_>,
    ) -> Result<(), FrameError> {
        let start = Instant::now();
        let device = FrameDevice { device: target.device.clone(), queue: target.queue.clone() };
        let wanted = (request.backend, request.preset, self.frame_at(request.time));
        let prepared = self.prepare(wanted, None, &device)?;
        if target.superseded() {
            return Err(FrameError::Superseded);
        }
        let traced = Instant::now();
        let (rays, legend) = match Size::new(request.width, request.height) {
            Ok(size) => self.show(request, size, target)?,
            // A window too large for a picture, or one without a pixel.
            Err(_) => (0, None),
        };
        let built = self.built.as_ref().ok_or(FrameError::NoScene)?;
        let scene = built.tracer.scene().scene();
        let mut tree = TreeReport { bytes: scene.bytes(), ..TreeReport::default() };
        for (_, geometry) in scene.geometries() {
            let own = geometry.accelerator().tree();
            tree.nodes += own.nodes.len();
            tree.references += own.references.len();
        }
        self.done.push_back(Ok(FrameReport {
            update_ms: prepared.update_ms,
            build_ms: prepared.build_ms,
            trace_ms: milliseconds(traced),
            total_ms: milliseconds(start),
            rays,
            triangles: self.scene.parts.indices.len() as u32,
            tree,
            backend: built.name.clone(),
            legend,
            ..FrameReport::default()
        }));
        Ok(())
    }

    fn is_done(&mut self) -> bool {
        true
    }

    fn finish(&mut self) -> Result<FrameReport, FrameError> {
        self.done.pop_front().unwrap_or(Err(FrameError::NothingSubmitted))
    }

    /// There is a tree for each geometry, and none of all.
    fn tree(&self) -> Option<&KdTree> {
        None
    }
}

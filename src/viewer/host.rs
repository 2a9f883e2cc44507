//! Frames by way of host memory: rays and hits as arrays, shading on the CPU, and the finished
//! picture sent to the window's device. Any backend answers the rays.

use super::source::{
    Abilities, DebugView, FirstFrame, FrameDevice, FrameError, FrameReport, FrameRequest,
    FrameSource, FrameTarget, Opening, TreeReport,
};
use super::views;
use crate::backend::{BackendKind, OpenError, OpenOptions};
use crate::render::{Size, render};
use crate::scene::{Placement, Scene};
use rayon::prelude::*;
use splitplane_core::arithmetic::Strict;
use splitplane_core::backend::{Accelerator, Backend, BuildOptions};
use splitplane_core::config::Preset;
use splitplane_core::intersect::{Limits, SceneScale};
use splitplane_core::mesh::Mesh;
use splitplane_core::ray::{Accuracy, Hit, QueryOptions, Ray};
use splitplane_core::stats::TreeStats;
use splitplane_core::traverse::{Query, Triangles, trace};
use splitplane_core::tree::{KdTree, KdTreeView};
use splitplane_core::triangle::Triangle;
use splitplane_cpu::CpuBackend;
use splitplane_wgpu::{Gpu, GpuError, Parity, WgpuBackend};
use std::cell::Cell;
use std::time::Instant;

/// Rays between two looks at whether the frame is still wanted.
const BATCH: u32 = 1 << 16;
/// Rays counted by one task.
const CHUNK: usize = 1 << 10;

/// Renders a scene in host memory.
pub struct HostSource {
    scene: Scene,
    open: OpenOptions,
    build: BuildOptions,
    pool: rayon::ThreadPool,
    gpu: Option<WgpuBackend>,
    built: Option<Built>,
    /// Time of a build that no frame has reported yet.
    build_ms: Option<f64>,
    placement: Option<Placement>,
}

/// A tree that is kept until another one is asked for.
struct Built {
    backend: BackendKind,
    preset: Preset,
    name: String,
    accelerator: Box<dyn Accelerator>,
    tree: TreeReport,
    /// What counting traversals need; made when first asked for.
    scale: Option<SceneScale>,
}

/// The colours of a frame and what goes with them.
struct Shown {
    words: Vec<u32>,
    rays: u64,
    legend: Option<String>,
}

impl HostSource {
    /// A source of pictures of a scene. The preset in `build` gives way to the one that is asked
    /// for; its limit of memory holds for every build. `pool` does the work of the CPU.
    pub fn new(
        scene: Scene,
        open: OpenOptions,
        build: BuildOptions,
        pool: rayon::ThreadPool,
    ) -> HostSource {
        HostSource {
            scene,
            open,
            build,
            pool,
            gpu: None,
            built: None,
            build_ms: None,
            placement: None,
        }
    }

    /// The backend over the window's own device, opened and tested when first asked for.
    fn connect(&mut self, target: &FrameDevice) -> Result<(), FrameError> {
        if self.gpu.is_some() {
            return Ok(());
        }
        let gpu = Gpu::borrow(target.device.clone(), target.queue.clone());
        let adapter = gpu.info().name.clone();
        let backend = WgpuBackend::new(gpu).map_err(|error| refused(&adapter, &error))?;
        match backend.parity() {
            Some(Parity::Structural(difference)) if !self.open.allow_structural => {
                let difference = difference.clone();
                return Err(OpenError::Structural { adapter, difference }.into());
            }
            _ => self.gpu = Some(backend),
        }
        Ok(())
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
            BackendKind::Auto => {}
        }
        let info = target.device.adapter_info();
        if info.device_type == wgpu::DeviceType::Cpu {
            return Ok((BackendKind::Cpu, format!("auto: `{}` is software", info.name)));
        }
        match self.connect(target) {
            Ok(()) if self.gpu.as_ref().and_then(|gpu| gpu.parity()) == Some(&Parity::Bitwise) => {
                Ok((BackendKind::Wgpu, "auto: hardware; parity: bitwise".into()))
            }
            Ok(()) => Ok((BackendKind::Cpu, format!("auto: `{}` is not bitwise", info.name))),
            Err(error) if error.is_device_loss() => Err(error),
            Err(error) => Ok((BackendKind::Cpu, format!("auto: {error}"))),
        }
    }

    /// Builds the tree that is asked for, unless it is there.
    fn prepare(
        &mut self,
        backend: BackendKind,
        preset: Preset,
        target: &FrameDevice,
    ) -> Result<(), FrameError> {
        if let Some(built) = &self.built
            && (built.backend, built.preset) == (backend, preset)
        {
            return Ok(());
        }
        if backend == BackendKind::Wgpu {
            self.connect(target)?;
        }
        let cpu = CpuBackend::new();
        let builder: &dyn Backend = match (&self.gpu, backend) {
            (Some(gpu), BackendKind::Wgpu) => gpu,
            _ => &cpu,
        };
        let mesh = self.scene.mesh()?;
        let mut options = self.build;
        options.config.preset = preset;
        let (pool, start) = (&self.pool, Instant::now());
        let (info, accelerator) =
            pool.install(|| (builder.describe(), builder.build(&mesh, &options)));
        let accelerator = accelerator?;
        self.build_ms = Some(milliseconds(start));
        let stats = TreeStats::of(&accelerator.tree().view());
        let tree = TreeReport {
            nodes: stats.nodes,
            leaves: stats.leaves,
            empty_leaves: stats.empty_leaves,
            references: stats.references,
            max_depth: stats.max_depth,
            sah_cost: stats.sah_cost,
            bytes: accelerator.query_bytes(),
        };
        let name = match (&info.adapter, info.threads) {
            (Some(adapter), _) => format!("{} ({adapter})", info.name),
            (None, Some(1)) => format!("{} (1 thread)", info.name),
            (None, Some(threads)) => format!("{} ({threads} threads)", info.name),
            (None, None) => info.name,
        };
        self.built = Some(Built { backend, preset, name, accelerator, tree, scale: None });
        Ok(())
    }

    /// What [`HostSource::prepare`] has built.
    fn built(&self) -> &Built {
        self.built.as_ref().unwrap_or_else(not_built)
    }

    /// Camera and light of the scene, found when first asked for.
    fn place(&mut self, aspect: f64) -> Result<Placement, FrameError> {
        if let Some(placement) = self.placement {
            return Ok(placement);
        }
        let accelerator = self.built().accelerator.as_ref();
        let placement = self.pool.install(|| Placement::of(&self.scene, accelerator, aspect))?;
        self.placement = Some(placement);
        Ok(placement)
    }
}

fn not_built<T>() -> T {
    unreachable!("`prepare` comes first")
}

impl FrameSource for HostSource {
    fn open(&mut self, target: &FrameDevice, first: &FirstFrame) -> Result<Opening, FrameError> {
        let (backend, reason) = self.choose(first.backend, target)?;
        self.prepare(backend, first.preset, target)?;
        let placement = self.place(first.aspect)?;
        let built = self.built();
        let accelerator = built.accelerator.as_ref();
        let camera = placement.camera;
        // A scene's own camera looks at what it turns about, and so does one from outside; one from
        // inside only looks somewhere.
        let mut distance = length(camera.eye(), camera.look_at());
        if placement.view == crate::scene::View::Inside {
            let ahead = camera.through(1, 1, [[0.5, 0.5]]);
            let hit = ahead
                .first()
                .and_then(|ray| accelerator.closest_hit(ray, &QueryOptions::default()));
            distance = hit.map_or(distance, |hit| f64::from(hit.t));
        }
        let abilities = Abilities {
            backends: vec![BackendKind::Cpu, BackendKind::Wgpu],
            presets: vec![Preset::Fast],
            accuracies: vec![Accuracy::Watertight, Accuracy::Fast],
            views: vec![
                DebugView::Shaded,
                DebugView::Depth,
                DebugView::Normals,
                DebugView::TriangleIds,
                DebugView::Triangles,
            ],
            max_depth: 0,
            max_samples: 1,
            seconds: None,
        };
        let bounds = built.accelerator.tree().bounds;
        let scene = self.scene.name.clone();
        Ok(Opening { scene, bounds, camera, distance, backend, reason, abilities })
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        target: &FrameTarget<'_>,
    ) -> Result<FrameReport, FrameError> {
        let start = Instant::now();
        let device = FrameDevice { device: target.device.clone(), queue: target.queue.clone() };
        self.prepare(request.backend, request.preset, &device)?;
        let aspect = f64::from(request.width) / f64::from(request.height.max(1));
        let placement = Placement { camera: request.camera, ..self.place(aspect)? };
        let traced = Instant::now();
        let (scene, built) = (&self.scene, self.built.as_mut().unwrap_or_else(not_built));
        let shown = self.pool.install(|| show(scene, built, &placement, request, target))?;
        let trace_ms = milliseconds(traced);
        target.queue.write_buffer(target.pixels, 0, bytemuck::cast_slice(&shown.words));
        Ok(FrameReport {
            update_ms: 0.0,
            build_ms: self.build_ms.take(),
            trace_ms,
            total_ms: milliseconds(start),
            rays: shown.rays,
            triangles: built.accelerator.summary().triangles,
            tree: built.tree,
            backend: built.name.clone(),
            legend: shown.legend,
        })
    }

    fn tree(&self) -> Option<&KdTree> {
        self.built.as_ref().map(|built| built.accelerator.tree())
    }
}

/// The colours of a view.
fn show(
    scene: &Scene,
    built: &mut Built,
    placement: &Placement,
    request: &FrameRequest,
    target: &FrameTarget<'_>,
) -> Result<Shown, FrameError> {
    let options = QueryOptions { accuracy: request.accuracy, ..QueryOptions::default() };
    let accelerator = built.accelerator.as_ref();
    let (width, height) = (request.width, request.height);
    if request.view == DebugView::Shaded {
        let Ok(size) = Size::new(width, height) else {
            return Ok(Shown { words: Vec::new(), rays: 0, legend: None });
        };
        let rendered = render(accelerator, scene, placement, size, &options, &|_| {})?;
        let words = rendered.image.pixels().map(|pixel| views::word(pixel.0)).collect();
        return Ok(Shown { words, rays: rendered.rays, legend: None });
    }
    if request.view == DebugView::Triangles {
        let mesh = scene.mesh()?;
        let scale = *built.scale.get_or_insert_with(|| scale_of(&mesh, built.accelerator.tree()));
        let tree = built.accelerator.tree().view();
        let mut counts = Vec::new();
        for rays in batches(request) {
            stop_if_superseded(target)?;
            counts.extend(count(&tree, &mesh, &scale, &rays, &options));
        }
        let rays = counts.len() as u64;
        let (words, legend) = views::heat(&counts);
        return Ok(Shown { words, rays, legend });
    }
    let (mut all_rays, mut all_hits) = (Vec::new(), Vec::new());
    for rays in batches(request) {
        stop_if_superseded(target)?;
        let mut hits = vec![Hit::MISS; rays.len()];
        accelerator.closest_hits(&rays, &mut hits, &options)?;
        all_rays.extend(rays);
        all_hits.extend(hits);
    }
    let (words, legend) = match request.view {
        DebugView::Depth => views::depth(&all_hits),
        DebugView::Normals => (views::normals(scene, &all_rays, &all_hits), None),
        _ => (views::triangle_ids(&all_hits), None),
    };
    Ok(Shown { words, rays: all_rays.len() as u64, legend })
}

/// The camera's rays, some rows at a time.
fn batches(request: &FrameRequest) -> impl Iterator<Item = Vec<Ray>> {
    let FrameRequest { width, height, camera, .. } = *request;
    let band = (BATCH / width.max(1)).max(1);
    (0..height)
        .step_by(band as usize)
        .map(move |top| camera.rows(width, height, top..height.min(top.saturating_add(band))))
}

fn stop_if_superseded(target: &FrameTarget<'_>) -> Result<(), FrameError> {
    if target.superseded() { Err(FrameError::Superseded) } else { Ok(()) }
}

/// How many triangles the reference traversal tests for each ray. Faster traversals test the same
/// leaves in blocks.
fn count(
    tree: &KdTreeView<'_>,
    mesh: &Mesh<'_>,
    scale: &SceneScale,
    rays: &[Ray],
    options: &QueryOptions,
) -> Vec<u32> {
    let chunk = |rays: &[Ray]| -> Vec<u32> {
        let counted = Counted { mesh, tests: Cell::new(0) };
        let tests = |ray: &Ray| {
            counted.tests.set(0);
            trace::<Strict>(tree, &counted, scale, ray, options, Query::Closest);
            counted.tests.get()
        };
        rays.iter().map(tests).collect()
    };
    rays.par_chunks(CHUNK).flat_map_iter(chunk).collect()
}

/// Triangles that count how often they are asked for.
struct Counted<'a> {
    mesh: &'a Mesh<'a>,
    tests: Cell<u32>,
}

impl Triangles for Counted<'_> {
    fn corners(&self, triangle: u32) -> Triangle {
        self.tests.set(self.tests.get() + 1);
        self.mesh.corners(triangle)
    }
}

/// The scale of a mesh with a tree. Triangles that no leaf refers to do not count.
fn scale_of(mesh: &Mesh<'_>, tree: &KdTree) -> SceneScale {
    let limits = tree
        .references
        .par_iter()
        .map(|&triangle| Limits::of(&mesh.corners(triangle)))
        .reduce(|| Limits::NONE, Limits::union);
    SceneScale::new(tree.bounds, &limits)
}

fn refused(adapter: &str, error: &GpuError) -> OpenError {
    let (adapter, reason) = (adapter.to_owned(), error.to_string());
    match error {
        GpuError::Lost { .. } | GpuError::TimedOut { .. } => {
            OpenError::DeviceFailed { adapter, reason }
        }
        _ => OpenError::Unusable { adapter, reason },
    }
}

fn length(a: [f32; 3], b: [f32; 3]) -> f64 {
    let square = |axis: usize| (f64::from(a[axis]) - f64::from(b[axis])).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangle_tests_are_counted() {
        let scene = Scene {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            indices: vec![[0, 1, 2]],
            ..Scene::default()
        };
        let mesh = scene.mesh().unwrap();
        let built = CpuBackend::new().build(&mesh, &BuildOptions::default()).unwrap();
        let tree = built.tree();
        let rays = [
            Ray::new([0.2, 0.2, 5.0], [0.0, 0.0, -1.0]),
            Ray::new([9.0, 0.2, 5.0], [0.0, 0.0, -1.0]),
        ];
        let scale = scale_of(&mesh, tree);
        let counts = count(&tree.view(), &mesh, &scale, &rays, &QueryOptions::default());
        assert_eq!(counts, [1, 0]);
    }
}

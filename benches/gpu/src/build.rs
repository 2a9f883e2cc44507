//! Builds: the device's and the CPU's by turns, the device's by kernels, and whether the trees are equal.

use serde::Serialize;
use splitplane::gpu::{DeviceBuild, Effort, GpuError, KernelTime, WgpuAccelerator, WgpuBackend};
use splitplane::{Accelerator, BuildOptions, CpuBackend, Mesh};
use splitplane_cpu::CpuAccelerator;
use wgpu::BufferUsages as Usage;

use crate::Failure;
use crate::device::warm;
use crate::options::Options;
use crate::stats::{median, milliseconds};

/// A scene's trees on both sides, and what making them took.
pub(crate) struct Built {
    pub gpu: WgpuAccelerator,
    pub cpu: CpuAccelerator,
    pub times: Vec<KernelTime>,
    pub figures: Figures,
}

/// The figures of a scene's builds. Times of builds on the device are from the call until the tree
/// can be queried there, with the mesh in host memory.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Figures {
    pub triangles: u32,
    pub dropped: u32,
    pub levels: u32,
    pub small_roots: u32,
    pub nodes: u32,
    pub references: u32,
    pub digest_cpu: String,
    pub digest_gpu: String,
    pub equal: bool,
    /// The first build after the self-test, which has compiled the kernels: no buffers yet.
    pub first_ms: f64,
    /// Later builds, buffers recycled.
    pub rebuild_ms: Vec<f64>,
    /// The part of each until everything is submitted: the mesh copied, commands recorded.
    pub submit_ms: Vec<f64>,
    /// The mesh alone sent to the device, until it is there.
    pub upload_ms: Vec<f64>,
    pub cpu_ms: Vec<f64>,
    /// A build with copies of tree and corners in host memory, as the facade's.
    pub with_host_copy_ms: f64,
    /// Times of all kernels together, each dispatch in a pass of its own.
    pub kernels_ms: Option<f64>,
    pub mesh_bytes: u64,
    /// All buffers of a build, tree included.
    pub build_bytes: u64,
    /// What queries need.
    pub tree_bytes: u64,
    pub cpu_tree_bytes: u64,
    pub submissions: u32,
    pub readbacks: u32,
    pub dispatches: u32,
    pub repeats: u32,
    pub first_repeats: u32,
    pub first_dispatches: u32,
}

/// Builds of which kernels are timed; the one of median sum counts.
const PROFILED: u32 = 5;

/// Builds a scene on both sides.
pub(crate) fn measure(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    run: &Options,
) -> Result<Built, Failure> {
    let cpu_backend = CpuBackend::new();
    let mut figures = Figures::default();
    let (first, first_ms) = milliseconds(|| backend.build_on_device(mesh, options));
    let first = first?;
    figures.first_ms = first_ms;
    figures.first_repeats = first.effort.repeats;
    figures.first_dispatches = first.effort.dispatches;
    // What the rebuilds say replaces this.
    figures.asked(&first);
    backend.recycle(first.tree);
    let mut times = Vec::new();
    if !run.check {
        cpu_backend.build_accelerator(mesh, options)?;
        warm(backend.gpu(), || rebuild(backend, mesh, options, &mut Figures::default()))?;
        for _ in 0..run.reps {
            rebuild(backend, mesh, options, &mut figures)?;
        }
        for _ in 0..run.reps {
            let (built, ms) = milliseconds(|| cpu_backend.build_accelerator(mesh, options));
            built?;
            figures.cpu_ms.push(ms);
        }
        figures.upload_ms = uploads(backend, mesh, run.reps)?;
        times = profile(backend, mesh, options, run.reps.min(PROFILED))?;
        if !times.is_empty() {
            figures.kernels_ms = Some(sum(&times) * 1e-6);
        }
    }
    let (gpu, ms) = milliseconds(|| backend.build_accelerator(mesh, options));
    let mut gpu = gpu?;
    figures.with_host_copy_ms = ms;
    let cpu = cpu_backend.build_accelerator(mesh, options)?;

    let summary = gpu.summary();
    figures.triangles = summary.triangles;
    figures.dropped = summary.dropped;
    figures.levels = summary.large_levels;
    figures.small_roots = summary.small_roots;
    figures.nodes = gpu.device_tree().node_count();
    figures.references = gpu.device_tree().reference_count();
    figures.digest_cpu = cpu.tree().digest().to_string();
    figures.digest_gpu = gpu.tree().digest().to_string();
    figures.equal = figures.digest_cpu == figures.digest_gpu;
    figures.mesh_bytes = mesh_bytes(mesh).iter().map(|bytes| bytes.len() as u64).sum();
    figures.tree_bytes = gpu.query_bytes();
    figures.cpu_tree_bytes = cpu.query_bytes();
    if run.compressed {
        gpu.compress()?;
        figures.tree_bytes = gpu.query_bytes();
    }
    Ok(Built { gpu, cpu, times, figures })
}

fn rebuild(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    figures: &mut Figures,
) -> Result<(), Failure> {
    let mut submit_ms = 0.0;
    let (built, ms) = milliseconds(|| {
        let (pending, ms) = milliseconds(|| backend.submit_build(mesh, options));
        submit_ms = ms;
        pending?.wait()
    });
    let built = built?;
    figures.rebuild_ms.push(ms);
    figures.submit_ms.push(submit_ms);
    figures.asked(&built);
    backend.recycle(built.tree);
    Ok(())
}

/// Times of kernels, of the build with the median sum; empty on a device without timestamps.
fn profile(
    backend: &WgpuBackend,
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
    reps: u32,
) -> Result<Vec<KernelTime>, Failure> {
    let mut all = Vec::new();
    warm(backend.gpu(), || rebuild(backend, mesh, options, &mut Figures::default()))?;
    for _ in 0..reps {
        let built = backend.build_profiled(mesh, options)?;
        backend.recycle(built.tree);
        all.extend(built.times);
    }
    all.sort_by(|a, b| sum(a).total_cmp(&sum(b)));
    let middle = all.len() / 2;
    Ok(all.into_iter().nth(middle).unwrap_or_default())
}

fn sum(times: &[KernelTime]) -> f64 {
    times.iter().map(|time| time.nanoseconds).sum()
}

/// Times to send as many bytes as the mesh has, buffer there already.
fn uploads(backend: &WgpuBackend, mesh: &Mesh<'_>, reps: u32) -> Result<Vec<f64>, Failure> {
    let gpu = backend.gpu();
    let parts = mesh_bytes(mesh);
    let bytes = parts.iter().map(|part| part.len() as u64).sum();
    let buffer = gpu.buffer("mesh", bytes, Usage::STORAGE | Usage::COPY_DST)?;
    let mut times = Vec::new();
    // The first is not counted.
    for _ in 0..=reps {
        let (sent, ms) = milliseconds(|| -> Result<(), GpuError> {
            let mut at = 0;
            for part in &parts {
                gpu.queue().write_buffer(&buffer, at, part);
                at += part.len() as u64;
            }
            gpu.submit([])?;
            gpu.wait()
        });
        sent?;
        times.push(ms);
    }
    times.remove(0);
    Ok(times)
}

/// Positions and indices as they are sent.
fn mesh_bytes<'a>(mesh: &Mesh<'a>) -> Vec<&'a [u8]> {
    let (positions, indices) = mesh.arrays();
    let mut parts: Vec<&[u8]> = vec![bytemuck::cast_slice(positions)];
    parts.extend(indices.map(bytemuck::cast_slice::<_, u8>));
    parts
}

impl Figures {
    /// What a build asked of the device.
    fn asked(&mut self, built: &DeviceBuild) {
        self.build_bytes = built.summary.peak_bytes;
        let Effort { submissions, readbacks, dispatches, repeats, .. } = built.effort;
        (self.submissions, self.readbacks) = (submissions, readbacks);
        (self.dispatches, self.repeats) = (dispatches, repeats);
    }

    /// Median of a rebuild.
    pub(crate) fn rebuild(&self) -> f64 {
        median(&self.rebuild_ms)
    }

    /// Median of a build on the CPU.
    pub(crate) fn cpu(&self) -> f64 {
        median(&self.cpu_ms)
    }
}

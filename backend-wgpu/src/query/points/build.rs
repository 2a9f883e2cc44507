//! Trees of points built on the device: see [`splitplane_core::build::points`].

use std::ops::ControlFlow;
use std::time::Duration;

use splitplane_core::build::points::{build, large_levels};
use splitplane_core::kernel::{
    Grid, PointBuffer, PointBuildUniform, PointBuilder, PointCounter, PointKernel,
};
use splitplane_core::layout::{
    POINT_CHUNK, PointBuild, PointCounters, PointExtent, PointRecord, PointSplit,
};
use splitplane_core::points::build::{MOST_POINTS, PointBuildError, PointOptions};
use splitplane_core::points::distance::Unit;
use splitplane_core::points::tree::{Axes, BLOCK, PointNode, PointTree, height};
use splitplane_core::watch::{Progress, Stage};
use wgpu::{BufferBinding, BufferUsages as Usage};

use super::super::pipelines::Queries;
use super::super::tree::can_be_bound;
use super::device::{DevicePoints, bounds_of, write_nodes};
use crate::device::clock::Instant;
use crate::device::gpu::Gpu;
use crate::device::host;
use crate::device::readback::read;
use crate::device::scope::checked;
use crate::device::wait::Wait;
use crate::device::{BindGroups, DeviceExecutor, DeviceSet, Job, LoopControl, Piece, Round, Text};
use crate::error::GpuError;

/// Workgroups of a dispatch: each goes on as long as there are chunks or nodes.
const MOST_GROUPS: u32 = 4096;
/// Levels of a submission.
const LEVELS: u32 = 4;
/// Interval between two calls of the watch.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

impl DeviceSet for PointBuilder {
    type Variant = ();

    fn text(kernel: PointKernel, (): &()) -> Text {
        let shader = &splitplane_shaders::POINT_BUILD[kernel as usize];
        Text { name: shader.name, parts: shader.parts.into() }
    }
}

/// A tree that is being built, as a device executor sees it.
#[derive(Debug)]
pub struct BuildingPoints {
    inputs: PointBuild,
    levels: u32,
    chunks: u32,
    groups: BindGroups<PointBuilder>,
    uniform: wgpu::Buffer,
    /// By [`PointBuffer`].
    buffers: Vec<wgpu::Buffer>,
}

/// A device executor that builds trees of points.
pub type PointExecutor<'a> = DeviceExecutor<'a, BuildingPoints>;

/// How many of some points are kept.
fn kept<const N: usize>(points: &[[f32; N]]) -> usize {
    points.iter().filter(|point| point.iter().all(|x| x.is_finite())).count()
}

/// Elements that a buffer has room for.
fn room(buffer: PointBuffer, inputs: &PointBuild, kept: usize) -> usize {
    let given = inputs.given as usize;
    let chunk = POINT_CHUNK as usize;
    match buffer {
        PointBuffer::Counters => 1,
        PointBuffer::Input => given * inputs.dimensions as usize,
        PointBuffer::ChunkMeasures | PointBuffer::ChunkPlaces => given.div_ceil(chunk),
        PointBuffer::Records
        | PointBuffer::NextRecords
        | PointBuffer::Points
        | PointBuffer::Indices => kept,
        PointBuffer::Nodes => kept.div_ceil(BLOCK),
        PointBuffer::ChunkExtents
        | PointBuffer::ChunkDigits
        | PointBuffer::ChunkSides
        | PointBuffer::SidesBefore => kept.div_ceil(chunk),
        // Those of the lowest level of large nodes.
        PointBuffer::Splits => kept.div_ceil(2 * chunk),
    }
}

/// Bytes of a buffer, which is never empty.
fn bytes(buffer: PointBuffer, inputs: &PointBuild, kept: usize) -> u64 {
    let elements = room(buffer, inputs, kept).max(1);
    (elements as u64 * buffer.element_size() as u64).next_multiple_of(16)
}

/// What a build needs on the device, the tree included.
fn device_bytes(inputs: &PointBuild, kept: usize) -> u64 {
    ALL.iter().map(|&buffer| bytes(buffer, inputs, kept)).sum()
}

/// The buffers in the order of their numbers.
const ALL: [PointBuffer; 14] = [
    PointBuffer::Counters,
    PointBuffer::Input,
    PointBuffer::ChunkMeasures,
    PointBuffer::ChunkPlaces,
    PointBuffer::Records,
    PointBuffer::NextRecords,
    PointBuffer::ChunkExtents,
    PointBuffer::Splits,
    PointBuffer::ChunkDigits,
    PointBuffer::ChunkSides,
    PointBuffer::SidesBefore,
    PointBuffer::Nodes,
    PointBuffer::Points,
    PointBuffer::Indices,
];

impl BuildingPoints {
    fn new<const N: usize>(
        gpu: &Gpu,
        points: &[[f32; N]],
        axes: Axes,
        kept: usize,
    ) -> Result<BuildingPoints, GpuError> {
        let inputs = PointBuild {
            given: points.len() as u32,
            dimensions: N as u32,
            widest: u32::from(axes == Axes::Widest),
            zero: 0,
        };
        checked(gpu, "a tree of points", || {
            let storage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
            let mut buffers = Vec::new();
            for buffer in ALL {
                let what = format!("{buffer:?} of points");
                let bytes = bytes(buffer, &inputs, kept);
                can_be_bound(gpu, &what, bytes)?;
                buffers.push(gpu.buffer(&what, bytes, storage)?);
            }
            let uniform = gpu.buffer(
                "inputs of points",
                size_of::<PointBuild>() as u64,
                Usage::UNIFORM | Usage::COPY_DST,
            )?;
            gpu.write(&uniform, 0, bytemuck::bytes_of(&inputs));
            let counters = PointCounters::at_start(inputs.given);
            gpu.write(&buffers[0], 0, bytemuck::bytes_of(&counters));
            if !points.is_empty() {
                let words: &[f32] = points.as_flattened();
                gpu.write(&buffers[1], 0, bytemuck::cast_slice(words));
            }
            let (levels, chunks) = (large_levels(kept), inputs.given.div_ceil(POINT_CHUNK));
            let groups = BindGroups::default();
            Ok(BuildingPoints { inputs, levels, chunks, groups, uniform, buffers })
        })
    }

    fn held(&self, buffer: PointBuffer) -> &wgpu::Buffer {
        &self.buffers[buffer as usize]
    }
}

impl Job for BuildingPoints {
    type Set = PointBuilder;
    type Counters = PointCounters;
    type Error = GpuError;

    fn variant(&self) -> &() {
        &()
    }

    fn buffer(&self, buffer: PointBuffer) -> Option<&wgpu::Buffer> {
        Some(self.held(buffer))
    }

    fn uniform(&self, uniform: PointBuildUniform) -> Option<BufferBinding<'_>> {
        match uniform {
            PointBuildUniform::PointBuild => Some(self.uniform.as_entire_buffer_binding()),
        }
    }

    fn groups(&mut self) -> &mut BindGroups<PointBuilder> {
        &mut self.groups
    }

    fn pieces(&self, kernel: PointKernel, _swapped: bool, pieces: &mut Vec<Piece>) {
        let workgroups = match kernel.grid() {
            Grid::One => 1,
            Grid::Each(PointCounter::Large) => self.chunks.div_ceil(2).clamp(1, MOST_GROUPS),
            grid => grid.workgroups(self.chunks).clamp(1, MOST_GROUPS),
        };
        pieces.push(Piece { block: None, workgroups, view: 0 });
    }

    fn round(&mut self, _counter: PointCounter, rounds: u32) -> Round {
        Round { goes_on: rounds < self.levels, submit: rounds > 0 && rounds.is_multiple_of(LEVELS) }
    }

    fn is_void(&self, _counters: &PointCounters) -> bool {
        false
    }
}

/// A finished tree, in both places.
pub(super) struct Built<const N: usize> {
    pub(super) tree: PointTree<N>,
    pub(super) device: DevicePoints,
}

/// Builds a tree on the device and reads it back.
pub(super) fn built<const N: usize>(
    queries: &Queries,
    points: &[[f32; N]],
    options: &PointOptions<'_>,
) -> Result<Built<N>, PointBuildError> {
    if N == 0 || N > 4 {
        return Err(PointBuildError::Dimensions { dimensions: N });
    }
    if points.len() > MOST_POINTS {
        return Err(PointBuildError::TooManyPoints { points: points.len() });
    }
    let kept = kept(points);
    let total = kept as u64;
    let tell = |done: u64| {
        let progress = Progress { stage: Stage::Points, done, total };
        match options.watch.map(|watch| watch.progress(&progress)) {
            Some(ControlFlow::Break(())) => Err(PointBuildError::Cancelled { done, total }),
            _ => Ok(()),
        }
    };
    tell(0)?;
    let gpu = queries.gpu();
    Wait::Blocking.check()?;
    let job = BuildingPoints::check_and_make(gpu, points, options, kept)?;
    let mut executor = DeviceExecutor::new(gpu, &queries.pipelines, job, LoopControl::Recorded);
    checked(gpu, "building a tree of points", || {
        build(&mut executor, options.axes)?;
        executor.submit()
    })?;
    if options.watch.is_some() {
        let (done, since) = (gpu.submitted_work_done().0, Instant::now());
        while !done.load(std::sync::atomic::Ordering::Acquire) && since.elapsed() < gpu.timeout() {
            tell(0)?;
            std::thread::sleep(POLL_INTERVAL);
            gpu.poll()?;
        }
    }
    let job = executor.into_job();
    let tree = job.read(gpu, options.axes, kept)?;
    tell(total)?;
    let buffer = |buffer| job.held(buffer).clone();
    let device = DevicePoints {
        nodes: buffer(PointBuffer::Nodes),
        points: buffer(PointBuffer::Points),
        indices: buffer(PointBuffer::Indices),
        unfiltered: checked(gpu, "no filter", || gpu.buffer("no filter", 16, Usage::STORAGE))?,
        count: kept as u32,
        height: height(kept),
        bounds: bounds_of(&tree),
    };
    checked(gpu, "the nodes of a point tree", || write_nodes(gpu, &tree, &device.nodes))?;
    Ok(Built { tree, device })
}

impl BuildingPoints {
    fn check_and_make<const N: usize>(
        gpu: &Gpu,
        points: &[[f32; N]],
        options: &PointOptions<'_>,
        kept: usize,
    ) -> Result<BuildingPoints, PointBuildError> {
        let inputs =
            PointBuild { given: points.len() as u32, dimensions: N as u32, widest: 0, zero: 0 };
        // On the device, and read back: as bytes, and as the tree.
        let tree = kept * (size_of::<[f32; N]>() + 4) + kept.div_ceil(BLOCK) * 8;
        let tree = tree as u64 + PointTree::<N>::summary_bytes(kept);
        let needed = device_bytes(&inputs, kept) + tree + 16 * kept as u64;
        if let Some(limit) = options.max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        Ok(BuildingPoints::new(gpu, points, options.axes, kept)?)
    }

    /// The tree, once all kernels have run.
    fn read<const N: usize>(
        &self,
        gpu: &Gpu,
        axes: Axes,
        kept: usize,
    ) -> Result<PointTree<N>, PointBuildError> {
        let bytes = |buffer: PointBuffer, elements: usize| {
            let bytes = elements as u64 * buffer.element_size() as u64;
            checked(gpu, "reading a tree of points", || read(gpu, self.held(buffer), 0, bytes))
        };
        let counters = bytes(PointBuffer::Counters, 1)?;
        let counters: PointCounters = bytemuck::pod_read_unaligned(&counters);
        let inner = kept.div_ceil(BLOCK).saturating_sub(1);
        let broken = || GpuError::Refused("the tree of points that came back is none".into());
        let ended = counters[PointCounter::Large] == 0
            && counters[PointCounter::Kept] as usize == kept
            && counters[PointCounter::Nodes] as usize == inner;
        if !ended {
            return Err(broken().into());
        }
        let nodes: Vec<PointNode> = host::copied(&bytes(PointBuffer::Nodes, inner)?)?;
        let padded = bytes(PointBuffer::Points, kept)?;
        let mut points: Vec<[f32; N]> = host::room(kept, "points that were read back")?;
        points.extend(padded.chunks_exact(16).map(|bytes| {
            let all: [f32; 4] = bytemuck::pod_read_unaligned(bytes);
            std::array::from_fn(|axis| all[axis])
        }));
        drop(padded);
        let indices: Vec<u32> = host::copied(&bytes(PointBuffer::Indices, kept)?)?;
        let unit = Unit::of_exponent(counters[PointCounter::Unit].cast_signed() - 127);
        let given = self.inputs.given;
        let tree = PointTree::from_parts(axes, unit, given, nodes, points, indices);
        Ok(tree.ok_or_else(broken)?)
    }
}

impl Queries {
    /// Builds a tree of points by an executor whose buffers can be read between its steps: for tests that hold the kernels to their
    /// reference.
    ///
    /// # Errors
    /// A device that fails, or cannot hold the points.
    #[doc(hidden)]
    pub fn with_point_executor<const N: usize, T>(
        &self,
        points: &[[f32; N]],
        axes: Axes,
        run: impl FnOnce(PointExecutor<'_>, PointBuild) -> T,
    ) -> Result<T, GpuError> {
        let job = BuildingPoints::new(self.gpu(), points, axes, kept(points))?;
        let inputs = job.inputs;
        let (gpu, pipelines) = (self.gpu(), &self.pipelines);
        Ok(run(DeviceExecutor::new(gpu, pipelines, job, LoopControl::ReadCounters), inputs))
    }

    /// Gives a kernel of these another text: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_point_build_kernel(&self, kernel: PointKernel, source: Option<String>) {
        self.pipelines.replace::<PointBuilder>(kernel, source);
    }
}

const _: () = {
    assert!(size_of::<PointRecord>() == 20 && size_of::<PointSplit>() == 16);
    assert!(size_of::<PointExtent>() == 32);
};

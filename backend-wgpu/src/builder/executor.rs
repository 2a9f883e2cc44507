//! A build on a device: what its grids represent, how long its levels continue, where its buffers
//! are.

use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::config::CHUNK;
use splitplane_core::kernel::{Buffer, Counter, Grid, Kernel, Overflow, TreeBuilder, Uniform};
use splitplane_core::layout::{Counters, LargeNode, Parameters};
use wgpu::BufferBinding;

use super::buffers::{Buffers, ROOTS_A_SLICE, readback};
use super::capacities::Capacities;
use super::views::{self, Lists, SCATTER_VIEWS, small_views};
use crate::device::executor::CopyOut;
use crate::device::gpu::Gpu;
use crate::device::halves::{binding_limit, halves_limit};
use crate::device::kernel_set::Bound;
use crate::device::{
    BindGroups, DeviceExecutor, DeviceSet, Job, LoopControl, Piece, Pipelines, Round, Text,
};
use crate::error::GpuError;
use crate::query::Queries;

/// Invocations of a workgroup of `preorder_addresses_retry`, each of which has a node.
const TOP_NODES_A_GROUP: u32 = 256;
/// Invocations of a workgroup of `allocate_children_retry`, each of which has a node.
const NODES_A_GROUP: u32 = 64;

impl DeviceSet for TreeBuilder {
    /// How the longest lists are bound.
    type Variant = Lists;

    fn text(kernel: Kernel, lists: &Lists) -> Text {
        let shader = &splitplane_shaders::KERNELS[kernel as usize];
        let parts = match lists {
            Lists::Whole => shader.parts.into(),
            Lists::ByHalves => splitplane_shaders::parts_by_halves(shader).into(),
        };
        Text { name: shader.name, parts }
    }

    /// Those that have one bind no list that goes on in a second binding.
    fn retry(kernel: Kernel, _lists: &Lists) -> Option<Text> {
        let shader = splitplane_shaders::kernel_retry(kernel.name())?;
        Some(Text { name: shader.name, parts: shader.parts.into() })
    }

    fn bindings(kernel: Kernel, lists: &Lists) -> Vec<Bound<TreeBuilder>> {
        views::bindings(kernel, *lists)
    }

    fn is_list_of_blocks(uniform: Uniform) -> bool {
        uniform == Uniform::Parameters
    }
}

/// The GPU executor: one build over a mesh that is already in its buffers. Dispatches are recorded;
/// submitting them is up to its creator.
pub type WgpuExecutor<'a> = DeviceExecutor<'a, Build<'a>>;

/// One build, as a device executor sees it.
#[derive(Debug)]
pub struct Build<'a> {
    buffers: &'a mut Buffers,
    capacities: Capacities,
    lists: Lists,
    groups: BindGroups<TreeBuilder>,
    /// Levels that run without reading the counters.
    levels: u32,
    /// Rounds run: a level has at most twice the nodes of the one before. None when it began
    /// elsewhere.
    level: Option<u32>,
    software: bool,
    /// The greatest size of a storage buffer, and the limit that says so.
    room: (u64, &'static str),
}

impl<'a> Build<'a> {
    /// A build of at most this many levels, from its start or from a level that is not known.
    pub(crate) fn new(
        gpu: &Gpu,
        buffers: &'a mut Buffers,
        capacities: Capacities,
        levels: u32,
        from_start: bool,
    ) -> Build<'a> {
        Build {
            buffers,
            capacities,
            lists: Lists::of(&capacities),
            groups: BindGroups::default(),
            levels,
            level: from_start.then_some(0),
            software: gpu.is_software(),
            room: match capacities.by_halves {
                true => halves_limit(gpu.limits()),
                false => binding_limit(gpu.limits()),
            },
        }
    }

    /// The most items that a grid may represent now.
    fn most(&self, counter: Counter) -> u32 {
        let c = &self.capacities;
        match counter {
            Counter::InputChunks => c.triangles.div_ceil(CHUNK),
            Counter::ActiveNodes => {
                let nodes = self.level.map_or(u32::MAX, |level| 1 << level.min(31));
                c.nodes.min(nodes)
            }
            Counter::Chunks => c.chunks,
            Counter::SmallRoots | Counter::MiddleRoots => c.small_roots,
            _ => c.top_nodes,
        }
    }
}

/// Workgroups of a dispatch that loops over a list of unknown length: enough to fill a large GPU,
/// few enough to cost little where the list is short. Software runs one at a time: few for short
/// lists. For long ones no fewer than one per 16 items, since Mesa's llvmpipe ends an invocation,
/// in silence, after 65,535 rounds of all its loops, and a small root takes up to 900.
fn most_groups(software: bool, things: u32) -> u32 {
    if software { (things / 16).clamp(8, 65_535) } else { 2048 }
}

/// The same over small roots. These differ in how long they take, and a workgroup that has several takes as long as all of
/// them. So there are more workgroups than a device runs at a time: whichever ends first makes room for another.
fn most_groups_of_small_roots(software: bool, roots: u32) -> u32 {
    if software { most_groups(software, roots) } else { 16_384 }
}

impl Job for Build<'_> {
    type Set = TreeBuilder;
    type Counters = Counters;
    type Error = GpuError;

    fn variant(&self) -> &Lists {
        &self.lists
    }

    fn buffer(&self, buffer: Buffer) -> Option<&wgpu::Buffer> {
        self.buffers.find(buffer)
    }

    fn uniform(&self, uniform: Uniform) -> Option<BufferBinding<'_>> {
        match uniform {
            // One block; the offset of the dispatch says which.
            Uniform::Parameters => Some(BufferBinding {
                buffer: &self.buffers.parameters,
                offset: 0,
                size: wgpu::BufferSize::new(size_of::<Parameters>() as u64),
            }),
        }
    }

    fn groups(&mut self) -> &mut BindGroups<TreeBuilder> {
        &mut self.groups
    }

    fn pieces(&self, kernel: Kernel, swapped: bool, pieces: &mut Vec<Piece>) {
        let piece = |block, workgroups| Piece { block: Some(block), workgroups, view: 0 };
        let whole = self.buffers.whole(swapped);
        if is_of_middle_stage(kernel) && !self.capacities.middle {
            return;
        }
        let grid = kernel.grid();
        match grid {
            Grid::One => pieces.push(piece(whole, 1)),
            Grid::Each(Counter::SmallRoots) => {
                let firsts = (0..self.capacities.small_roots).step_by(ROOTS_A_SLICE as usize);
                for view in 0..small_views(&self.capacities) {
                    pieces.extend(firsts.clone().map(|first| {
                        let roots = (self.capacities.small_roots - first).min(ROOTS_A_SLICE);
                        let workgroups =
                            roots.min(most_groups_of_small_roots(self.software, roots));
                        let block = self.buffers.slice(first / ROOTS_A_SLICE, view);
                        Piece { view, ..piece(block, workgroups) }
                    }));
                }
            }
            Grid::Each(counter) | Grid::Invocations(counter, _) | Grid::Few(counter, _) => {
                let wanted = grid.workgroups(self.most(counter));
                let workgroups = wanted.clamp(1, most_groups(self.software, wanted));
                if kernel == Kernel::ScatterReferences && self.capacities.by_halves {
                    pieces.extend((0..SCATTER_VIEWS).map(|view| {
                        let block = self.buffers.scatter(view, swapped);
                        Piece { view, ..piece(block, workgroups) }
                    }));
                } else {
                    pieces.push(piece(whole, workgroups));
                }
            }
        }
    }

    /// With a middle stage the lists of nodes are short, and `allocate_children` does all by itself.
    fn retry_workgroups(&self, kernel: Kernel, piece: &Piece) -> u32 {
        match kernel {
            Kernel::AllocateChildren if self.capacities.middle => 0,
            Kernel::AllocateChildren => {
                let wanted = self.most(Counter::ActiveNodes).div_ceil(NODES_A_GROUP);
                wanted.clamp(1, most_groups(self.software, wanted))
            }
            Kernel::PreorderAddresses => {
                let wanted = self.most(Counter::TopNodes).div_ceil(TOP_NODES_A_GROUP);
                wanted.clamp(1, most_groups(self.software, wanted))
            }
            _ => piece.workgroups,
        }
    }

    fn round(&mut self, _counter: Counter, rounds: u32) -> Round {
        if rounds > 0 {
            self.level = self.level.map(|level| level + 1);
        }
        Round { goes_on: rounds < self.levels, submit: false }
    }

    fn named(&self, counters: Counters, swapped: bool) -> Counters {
        named(counters, swapped)
    }

    fn is_void(&self, counters: &Counters) -> bool {
        counters[Counter::Overflow] != 0
    }

    fn check_counters(&self, counters: &Counters) -> Result<(), GpuError> {
        // Where the middle stage could not finish, all lists are empty.
        let outgrown = counters[Counter::Overflow] & !(Overflow::MiddleStage as u32);
        if outgrown != 0 {
            // The capacities were made as large as the device allows: counts now go beyond them.
            let (allowed, limit) = self.room;
            let what = "a list of this scene".into();
            return Err(GpuError::Limit { what, limit, needed: allowed + 1, allowed });
        }
        Ok(())
    }

    /// The state of all chunks is in one buffer, one array after the other.
    fn offset(&self, buffer: Buffer) -> u64 {
        let before = match buffer {
            Buffer::ReferenceSides => Buffer::ChunkCounts.element_size(),
            Buffer::ChunkBounds => {
                Buffer::ChunkCounts.element_size() + Buffer::ReferenceSides.element_size()
            }
            _ => 0,
        };
        u64::from(self.capacities.chunks) * before as u64
    }

    fn part<'b>(
        &self,
        kernel: Kernel,
        bound: &Bound<TreeBuilder>,
        view: u32,
        held: &'b wgpu::Buffer,
    ) -> BufferBinding<'b> {
        views::part(&self.capacities, kernel, bound, view, held)
    }

    fn viewed(&self, kernel: Kernel, buffer: Buffer, view: u32) -> Buffer {
        views::viewed(kernel, buffer, view)
    }

    /// The root's cell is the tree's bounds; its node will be overwritten.
    fn copy_behind(&self, kernel: Kernel) -> Option<CopyOut> {
        (kernel == Kernel::ScanTriangles).then(|| CopyOut {
            from: self.buffers.get(Buffer::ActiveNodes).clone(),
            to: self.buffers.readback.clone(),
            at: readback::ROOT,
            bytes: size_of::<LargeNode>() as u64,
        })
    }
}

impl<'a> WgpuExecutor<'a> {
    /// A build whose buffers can be read between its steps.
    pub(crate) fn inspected(
        gpu: &'a Gpu,
        pipelines: &'a Pipelines,
        buffers: &'a mut Buffers,
        capacities: Capacities,
    ) -> WgpuExecutor<'a> {
        let build = Build::new(gpu, buffers, capacities, 0, true);
        DeviceExecutor::new(gpu, pipelines, build, LoopControl::ReadCounters)
    }

    /// Records the kernel that finds the range of the triangles' coordinates, for queries.
    pub(crate) fn record_limits(
        &mut self,
        queries: &Queries,
        count: u32,
        kept: &mut Option<[wgpu::Buffer; 2]>,
    ) -> Result<(), GpuError> {
        let triangles = self.job().buffers.get(Buffer::Triangles).clone();
        let readback = self.job().buffers.readback.clone();
        let encoder = self.encoder();
        let result = (&readback, readback::LIMITS);
        queries.record_triangle_limits(encoder, &triangles, count, result, kept)?;
        self.count_dispatch();
        Ok(())
    }

    /// Copies what the host reads after the build.
    pub(crate) fn read_back(&mut self, tree_to_host: bool) {
        let Build { buffers, capacities, .. } = self.job();
        let readback = buffers.readback.clone();
        let counters = buffers.get(Buffer::Counters).clone();
        // The whole capacity, since only the device knows how much is used.
        let held = |buffer| (buffers.get(buffer).clone(), capacities.bytes_of(buffer));
        let tree = tree_to_host.then(|| [Buffer::Nodes, Buffer::LeafReferences].map(held));
        let encoder = self.encoder();
        encoder.copy_buffer_to_buffer(&counters, 0, &readback, 0, size_of::<Counters>() as u64);
        let mut at = readback::TREE;
        for (buffer, bytes) in tree.into_iter().flatten() {
            encoder.copy_buffer_to_buffer(&buffer, 0, &readback, at, bytes);
            at += bytes;
        }
    }
}

/// The counters that a build begins with.
pub(crate) fn first_counters(triangles: u32) -> Counters {
    let mut counters = Counters::default();
    let chunks = triangles.div_ceil(CHUNK);
    counters[Counter::Triangles] = triangles;
    counters[Counter::InputChunks] = chunks;
    counters[Counter::Chunks] = chunks;
    counters
}

/// Counters from their bytes.
pub(crate) fn counters_from(bytes: &[u8], swapped: bool) -> Counters {
    named(bytemuck::pod_read_unaligned(&bytes[..size_of::<Counters>()]), swapped)
}

/// Kernels count lists that have changed places under the names that these had: see
/// [`Parameters::swapped`].
fn named(mut counters: Counters, swapped: bool) -> Counters {
    if swapped {
        counters.words.swap(Counter::ActiveNodes as usize, Counter::NextNodes as usize);
        counters.words.swap(Counter::Chunks as usize, Counter::NextChunks as usize);
        counters.words.swap(Counter::ActiveReferences as usize, Counter::NextReferences as usize);
    }
    counters
}

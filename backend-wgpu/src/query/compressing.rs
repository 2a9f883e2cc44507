//! Compressed nodes made on the device from a tree that is there: see [`splitplane_core::query::compressed::compress`].

use splitplane_core::kernel::{
    CompressBuffer, CompressCounter, CompressKernel, CompressUniform, Grid, NodeCompressor, Slot,
};
use splitplane_core::layout::{Compress, CompressCounters, Part};
use splitplane_core::query::compressed::{
    CHILDREN, CompressedNode, CompressedNodes, compress, most_nodes, root,
};
use wgpu::BufferBinding;

use super::pipelines::Queries;
use super::tree::{Compressed, DeviceTree, can_be_bound};
use crate::device::gpu::Gpu;
use crate::device::halves::{binding_limit, half};
use crate::device::kernel_set::{Bound, with_continued};
use crate::device::readback::read;
use crate::device::scope::checked;
use crate::device::{
    BindGroups, DeviceExecutor, DeviceSet, Job, LoopControl, Piece, Pipelines, Round, Text,
};
use crate::error::GpuError;

/// Most parts of a batch: their children take 16 MiB.
const BATCH: u32 = 1 << 16;
/// Rounds that are recorded before the counters are read, at first and at most.
const FIRST_ROUNDS: u32 = 12;
const MOST_ROUNDS: u32 = 64;
/// Workgroups of a dispatch: each goes on as long as there are parts.
const MOST_GROUPS: u32 = 2048;

impl DeviceSet for NodeCompressor {
    /// Whether the triangles go on in a second binding.
    type Variant = bool;

    fn text(kernel: CompressKernel, _by_halves: &bool) -> Text {
        let shader = &splitplane_shaders::COMPRESS[kernel as usize];
        Text { name: shader.name, parts: shader.parts.into() }
    }

    fn bindings(kernel: CompressKernel, by_halves: &bool) -> Vec<Bound<NodeCompressor>> {
        with_continued::<NodeCompressor>(kernel, |buffer| {
            *by_halves && buffer == CompressBuffer::Triangles
        })
    }
}

/// Compressed nodes that are being made, as a device executor sees them.
#[derive(Debug)]
pub struct Compressing<'a> {
    tree: &'a DeviceTree,
    inputs: Compress,
    by_halves: bool,
    groups: BindGroups<NodeCompressor>,
    uniform: wgpu::Buffer,
    counters: wgpu::Buffer,
    parts: wgpu::Buffer,
    children: wgpu::Buffer,
    child_counts: wgpu::Buffer,
    places: wgpu::Buffer,
    nodes: wgpu::Buffer,
    references: wgpu::Buffer,
    /// Rounds that run without reading the counters.
    rounds: u32,
}

/// A device executor that makes compressed nodes.
pub type CompressExecutor<'a> = DeviceExecutor<'a, Compressing<'a>>;

impl<'a> Compressing<'a> {
    /// With room for this many nodes, of which a batch has so many at most.
    fn new(
        gpu: &Gpu,
        tree: &'a DeviceTree,
        part_room: u32,
        batch_room: u32,
    ) -> Result<Compressing<'a>, GpuError> {
        use wgpu::BufferUsages as Usage;
        let storage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let made = |what: &str, elements: u32, each: usize| {
            let bytes = u64::from(elements.max(1)) * each as u64;
            can_be_bound(gpu, what, bytes)?;
            gpu.buffer(what, bytes, storage)
        };
        let batch = batch_room.min(part_room);
        let slack = tree.scene_scale().slack;
        let inputs = Compress { slack, zero: 0, batch_room: batch, part_room };
        checked(gpu, "compressed nodes", || {
            let inputs_bytes = size_of::<Compress>() as u64;
            let uniform = Usage::UNIFORM | Usage::COPY_DST;
            let compressing = Compressing {
                tree,
                inputs,
                by_halves: tree.triangles().size() > binding_limit(gpu.limits()).0,
                groups: BindGroups::default(),
                uniform: gpu.buffer("inputs of compressed nodes", inputs_bytes, uniform)?,
                counters: made("counters of compressed nodes", 8, 4)?,
                parts: made("parts of the tree", part_room, size_of::<Part>())?,
                children: made("children of parts", batch, CHILDREN * size_of::<Part>())?,
                child_counts: made("counts of children", batch, 8)?,
                places: made("places of children", batch, 8)?,
                nodes: made("compressed nodes", part_room, size_of::<CompressedNode>())?,
                references: made("the references of compressed nodes", tree.reference_count(), 4)?,
                rounds: FIRST_ROUNDS,
            };
            let root = root(tree.bounds());
            gpu.write(&compressing.uniform, 0, bytemuck::bytes_of(&inputs));
            let counters = CompressCounters::at_start();
            gpu.write(&compressing.counters, 0, bytemuck::bytes_of(&counters));
            gpu.write(&compressing.parts, 0, bytemuck::bytes_of(&root));
            Ok(compressing)
        })
    }
}

impl Job for Compressing<'_> {
    type Set = NodeCompressor;
    type Counters = CompressCounters;
    type Error = GpuError;

    fn variant(&self) -> &bool {
        &self.by_halves
    }

    fn buffer(&self, buffer: CompressBuffer) -> Option<&wgpu::Buffer> {
        Some(match buffer {
            CompressBuffer::Counters => &self.counters,
            CompressBuffer::Nodes => self.tree.nodes(),
            CompressBuffer::LeafReferences => self.tree.leaf_references(),
            CompressBuffer::Triangles => self.tree.triangles(),
            CompressBuffer::Parts => &self.parts,
            CompressBuffer::Children => &self.children,
            CompressBuffer::ChildCounts => &self.child_counts,
            CompressBuffer::Places => &self.places,
            CompressBuffer::CompressedNodes => &self.nodes,
            CompressBuffer::CompressedReferences => &self.references,
        })
    }

    fn uniform(&self, uniform: CompressUniform) -> Option<BufferBinding<'_>> {
        match uniform {
            CompressUniform::Compress => Some(self.uniform.as_entire_buffer_binding()),
        }
    }

    fn groups(&mut self) -> &mut BindGroups<NodeCompressor> {
        &mut self.groups
    }

    fn pieces(&self, kernel: CompressKernel, _swapped: bool, pieces: &mut Vec<Piece>) {
        let workgroups = match kernel.grid() {
            Grid::One => 1,
            grid => grid.workgroups(self.inputs.batch_room).clamp(1, MOST_GROUPS),
        };
        pieces.push(Piece { block: None, workgroups, view: 0 });
    }

    fn round(&mut self, _counter: CompressCounter, rounds: u32) -> Round {
        Round { goes_on: rounds < self.rounds, submit: false }
    }

    fn is_void(&self, counters: &CompressCounters) -> bool {
        counters[CompressCounter::Outgrown] > 0
    }

    fn part<'b>(
        &self,
        _kernel: CompressKernel,
        bound: &Bound<NodeCompressor>,
        _view: u32,
        held: &'b wgpu::Buffer,
    ) -> BufferBinding<'b> {
        match bound.slot {
            Slot::Storage(own) if self.by_halves && own.buffer == CompressBuffer::Triangles => {
                half(held, held.size(), bound.part == 1, 0)
            }
            _ => held.as_entire_buffer_binding(),
        }
    }
}

impl DeviceTree {
    /// As [`DeviceTree::compress`], but the device makes the nodes, by the rule of [`CompressedNodes::greedy`], bit for bit: no
    /// copy of the tree is needed, and nothing but counters comes back, for which this waits. Hits are the same; rays visit somewhat more
    /// nodes.
    ///
    /// # Errors
    /// As for [`DeviceTree::compress`]; the tree has then the compressed nodes that it had.
    pub fn compress_on_device(&mut self, queries: &Queries) -> Result<(), GpuError> {
        if self.scene_scale().wide {
            return Ok(());
        }
        self.names_references()?;
        let most = most_nodes(self.node_count(), self.reference_count());
        // What nearly all trees need.
        let mut room = (self.node_count() / 6 + self.reference_count() / 64 + 64).min(most);
        loop {
            let (gpu, pipelines) = (queries.gpu(), &queries.pipelines);
            match made_with(gpu, pipelines, self, room)? {
                Made::Done(compressed) => {
                    self.set_compressed(compressed);
                    return Ok(());
                }
                Made::Outgrown if room < most => room = room.saturating_mul(2).min(most),
                Made::Outgrown => {
                    return Err(GpuError::Refused("more compressed nodes than a tree has".into()));
                }
            }
        }
    }

    /// Whether compressed nodes can name all references.
    ///
    /// # Errors
    /// They cannot.
    pub(super) fn names_references(&self) -> Result<(), GpuError> {
        let needed = u64::from(self.reference_count());
        let allowed = u64::from(CompressedNodes::MOST_REFERENCES);
        if needed <= allowed {
            return Ok(());
        }
        let (what, limit) =
            ("the references of compressed nodes", "references of compressed nodes");
        Err(GpuError::Limit { what: what.into(), limit, needed, allowed })
    }
}

/// What became of an attempt.
enum Made {
    Done(Compressed),
    /// There are more nodes than there was room for.
    Outgrown,
}

/// Makes compressed nodes with room for so many.
fn made_with(
    gpu: &Gpu,
    pipelines: &Pipelines,
    tree: &DeviceTree,
    room: u32,
) -> Result<Made, GpuError> {
    let mut rounds = FIRST_ROUNDS;
    let mut job = Compressing::new(gpu, tree, room, BATCH)?;
    loop {
        job.rounds = rounds;
        let mut executor = DeviceExecutor::new(gpu, pipelines, job, LoopControl::Recorded);
        checked(gpu, "making compressed nodes", || {
            compress(&mut executor)?;
            executor.submit()
        })?;
        job = executor.into_job();
        let bytes = read(gpu, &job.counters, 0, size_of::<CompressCounters>() as u64)?;
        let counters: CompressCounters = bytemuck::pod_read_unaligned(&bytes);
        if job.is_void(&counters) {
            return Ok(Made::Outgrown);
        }
        if counters[CompressCounter::Waiting] == 0 {
            let Compressing { nodes, references, .. } = job;
            return Ok(Made::Done(Compressed { nodes, references }));
        }
        rounds = (2 * rounds).min(MOST_ROUNDS);
    }
}

impl Queries {
    /// Makes compressed nodes of a tree by an executor whose buffers can be read between its steps, with batches of so many parts and room for so
    /// many nodes: for tests that hold the kernels to their reference. `run` gets the executor and its inputs.
    ///
    /// # Errors
    /// A device that fails.
    #[doc(hidden)]
    pub fn with_compress_executor<T>(
        &self,
        tree: &DeviceTree,
        batch: u32,
        room: u32,
        run: impl FnOnce(CompressExecutor<'_>, Compress) -> T,
    ) -> Result<T, GpuError> {
        let room = room.min(most_nodes(tree.node_count(), tree.reference_count()));
        let job = Compressing::new(self.gpu(), tree, room, batch)?;
        let inputs = job.inputs;
        let (gpu, pipelines) = (self.gpu(), &self.pipelines);
        Ok(run(DeviceExecutor::new(gpu, pipelines, job, LoopControl::ReadCounters), inputs))
    }

    /// Gives a kernel of these another text: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_compress_kernel(&self, kernel: CompressKernel, source: Option<String>) {
        self.pipelines.replace::<NodeCompressor>(kernel, source);
    }
}

//! The buffers of one build on the device, kept between builds.

use splitplane_core::kernel::{Buffer, KernelSet, TreeBuilder};
use splitplane_core::layout::{Counters, Parameters};
use wgpu::BufferUsages as Usage;

use super::capacities::{Capacities, is_long};
use super::source::Source;
use super::views::{SCATTER_VIEWS, small_views};
use crate::device::gpu::Gpu;
use crate::device::halves::binding_limit;
use crate::error::GpuError;

/// Small roots of one dispatch: few enough that a device builds them well before any watchdog acts.
pub(crate) const ROOTS_A_SLICE: u32 = 1 << 16;

/// What stands before the nodes of the middle stage when it begins: nothing of its pool is taken.
pub(crate) const POOL_AT_START: [u8; 4] = [0; 4];

/// What is read back after a build, by its place in the one buffer that is mapped: counters, the
/// root's node, the limits of the triangles, then nodes and references where the host wants them.
pub(crate) mod readback {
    /// Where the root's node is stored.
    pub(crate) const ROOT: u64 = 128;
    /// Where the limits of the triangles are stored.
    pub(crate) const LIMITS: u64 = 192;
    /// Where the tree begins; all before is always read.
    pub(crate) const TREE: u64 = 256;
}

/// What kernels share, by [`Buffer`]. Buffers only grow. The executor exchanges the names of lists
/// that have changed places.
#[derive(Debug)]
pub(crate) struct Buffers {
    buffers: Vec<Option<wgpu::Buffer>>,
    pub(crate) parameters: wgpu::Buffer,
    /// Bytes between two blocks of parameters.
    pub(crate) stride: u64,
    /// The buffer that is mapped after the build.
    pub(crate) readback: wgpu::Buffer,
    blocks: u32,
    /// The uniform of a tree that is no longer needed, for the next one.
    pub(crate) scene: Option<wgpu::Buffer>,
    /// Slices of the grids over small roots.
    slices: u32,
    /// What the kernel of the triangles' limits has for itself.
    pub(crate) limits: Option<[wgpu::Buffer; 2]>,
}

/// Blocks of parameters before those of slices: for lists as they are, and for lists that have changed
/// places.
const WHOLE_BLOCKS: u32 = 2;

/// Bytes of what is mapped after a build.
fn readback_bytes(capacities: &Capacities, tree_to_host: bool) -> u64 {
    let tree = capacities.bytes_of(Buffer::Nodes) + capacities.bytes_of(Buffer::LeafReferences);
    readback::TREE + if tree_to_host { tree } else { 0 }
}

const READBACK: Usage = Usage::COPY_DST.union(Usage::MAP_READ);

impl Buffers {
    /// No buffers yet except the small ones.
    pub(crate) fn new(gpu: &Gpu) -> Result<Buffers, GpuError> {
        let alignment = u64::from(gpu.device().limits().min_uniform_buffer_offset_alignment);
        let stride = (size_of::<Parameters>() as u64).next_multiple_of(alignment.max(16));
        Ok(Buffers {
            buffers: vec![None; TreeBuilder::BUFFERS.len()],
            parameters: gpu.buffer("parameters", 2 * stride, Usage::UNIFORM | Usage::COPY_DST)?,
            stride,
            readback: gpu.buffer("readback", readback::TREE, READBACK)?,
            blocks: 2,
            scene: None,
            slices: 1,
            limits: None,
        })
    }

    /// A buffer of the schedule. Those that share a storage share a buffer.
    ///
    /// # Panics
    /// Before [`Buffers::reserve`].
    pub(crate) fn get(&self, buffer: Buffer) -> &wgpu::Buffer {
        self.find(buffer).expect("reserved before use")
    }

    /// A buffer of the schedule, if there is one.
    pub(crate) fn find(&self, buffer: Buffer) -> Option<&wgpu::Buffer> {
        self.buffers[buffer.storage() as usize].as_ref()
    }

    /// Takes a buffer out: the finished tree keeps it.
    ///
    /// # Panics
    /// Before [`Buffers::reserve`].
    pub(crate) fn take(&mut self, buffer: Buffer) -> wgpu::Buffer {
        self.buffers[buffer.storage() as usize].take().expect("reserved before use")
    }

    /// Puts a buffer back for reuse.
    pub(crate) fn put(&mut self, buffer: Buffer, held: wgpu::Buffer) {
        self.buffers[buffer.storage() as usize] = Some(held);
    }

    /// Makes space, also for the tree in the mapped buffer when the host wants it. Contents of
    /// buffers that grow are lost.
    pub(crate) fn reserve(
        &mut self,
        gpu: &Gpu,
        capacities: &Capacities,
        tree_to_host: bool,
    ) -> Result<(), GpuError> {
        let bytes = readback_bytes(capacities, tree_to_host);
        if self.readback.size() < bytes {
            self.readback = gpu.buffer("readback", bytes, READBACK)?;
        }
        for buffer in Capacities::BUFFERS {
            let bytes = capacities.bytes_of(buffer);
            // Bins are for builds that find planes by them.
            if buffer != Buffer::ChunkBins || bytes > 0 {
                self.grow(gpu, buffer, bytes)?;
            }
        }
        self.grow(gpu, Buffer::Counters, size_of::<Counters>() as u64)?;
        self.slices = capacities.small_roots.div_ceil(ROOTS_A_SLICE).max(1);
        let of_halves = if capacities.by_halves { 2 * SCATTER_VIEWS } else { 0 };
        let blocks = WHOLE_BLOCKS + small_views(capacities) * self.slices + of_halves;
        if self.blocks < blocks {
            let bytes = u64::from(blocks) * self.stride;
            self.parameters = gpu.buffer("parameters", bytes, Usage::UNIFORM | Usage::COPY_DST)?;
            self.blocks = blocks;
        }
        Ok(())
    }

    fn grow(&mut self, gpu: &Gpu, buffer: Buffer, bytes: u64) -> Result<(), GpuError> {
        let slot = &mut self.buffers[buffer.storage() as usize];
        // Triangles that fit one binding are left in a buffer that does: shaders of hosts need that.
        let (binding, _) = binding_limit(gpu.limits());
        let too_long = |held: &wgpu::Buffer| {
            buffer == Buffer::Triangles && bytes <= binding && held.size() > binding
        };
        if slot.as_ref().is_none_or(|held| held.size() < bytes || too_long(held)) {
            // The old one goes first: both may not fit.
            *slot = None;
            let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
            let label = format!("{buffer:?}");
            // The sizes of long lists are within the limits: see `Capacities::within`.
            let made = if is_long(buffer) { Gpu::long_buffer } else { Gpu::buffer };
            *slot = Some(made(gpu, &label, bytes, usage)?);
        }
        Ok(())
    }

    /// Bytes held once there is space for these capacities.
    pub(crate) fn bytes_with(&self, capacities: &Capacities, tree_to_host: bool) -> u64 {
        let held = |buffer: Buffer, wanted: u64| {
            let held =
                self.buffers[buffer.storage() as usize].as_ref().map_or(0, wgpu::Buffer::size);
            let least = if buffer == Buffer::ChunkBins { 0 } else { 16 };
            held.max(wanted.max(least).next_multiple_of(4))
        };
        let growing = Capacities::BUFFERS.map(|buffer| held(buffer, capacities.bytes_of(buffer)));
        growing.iter().sum::<u64>()
            + held(Buffer::Counters, size_of::<Counters>() as u64)
            + held(Buffer::Input, capacities.bytes_of(Buffer::Input))
            + self.readback.size().max(readback_bytes(capacities, tree_to_host))
    }

    /// Makes space for a mesh and uploads it, if it is in host memory.
    pub(crate) fn upload(
        &mut self,
        gpu: &Gpu,
        capacities: &Capacities,
        source: &Source<'_>,
    ) -> Result<(), GpuError> {
        self.grow(gpu, Buffer::Input, capacities.bytes_of(Buffer::Input))?;
        if let Source::Host(mesh) = source {
            let input = self.get(Buffer::Input);
            let (positions, indices) = mesh.arrays();
            let positions: &[u8] = bytemuck::cast_slice(positions);
            gpu.write(input, 0, positions);
            if let Some(indices) = indices {
                let bytes = bytemuck::cast_slice(indices);
                gpu.write(input, positions.len() as u64, bytes);
            }
        }
        Ok(())
    }

    /// Records the copy of a mesh that is on the device.
    pub(crate) fn copy_mesh(&self, encoder: &mut wgpu::CommandEncoder, source: &Source<'_>) {
        if let Source::Device(mesh) = source {
            let [positions, indices] = source.bytes();
            let input = self.get(Buffer::Input);
            encoder.copy_buffer_to_buffer(mesh.positions, 0, input, 0, positions);
            if let Some(buffer) = mesh.indices {
                encoder.copy_buffer_to_buffer(buffer, 0, input, positions, indices);
            }
        }
    }

    /// Writes parameters for whole grids, for every slice, and for every view of lists by halves.
    pub(crate) fn write_parameters(
        &self,
        gpu: &Gpu,
        capacities: &Capacities,
        parameters: &Parameters,
    ) {
        let whole = [0, 1].map(|swapped| Parameters { swapped, ..*parameters });
        let mut blocks = whole.to_vec();
        for view in 0..small_views(capacities) {
            blocks.extend((0..self.slices).map(|slice| Parameters {
                first: slice * ROOTS_A_SLICE,
                count: ROOTS_A_SLICE,
                view,
                ..*parameters
            }));
        }
        if capacities.by_halves {
            let views = (0..SCATTER_VIEWS).flat_map(|view| whole.map(|p| Parameters { view, ..p }));
            blocks.extend(views);
        }
        let mut bytes = vec![0; blocks.len() * self.stride as usize];
        for (block, here) in blocks.iter().enumerate() {
            let at = block * self.stride as usize;
            bytes[at..at + size_of::<Parameters>()].copy_from_slice(bytemuck::bytes_of(here));
        }
        gpu.write(&self.parameters, 0, &bytes);
    }

    /// Where the parameters of a whole grid begin.
    pub(crate) fn whole(&self, swapped: bool) -> u32 {
        (u64::from(swapped) * self.stride) as u32
    }

    /// Where the parameters of a slice of a grid over small roots begin, in a view of their references.
    pub(crate) fn slice(&self, slice: u32, view: u32) -> u32 {
        (u64::from(WHOLE_BLOCKS + view * self.slices + slice) * self.stride) as u32
    }

    /// Where the parameters of a view of the lists begin that `scatter_references` moves references between.
    pub(crate) fn scatter(&self, view: u32, swapped: bool) -> u32 {
        // Only where lists are bound by halves, so that small roots have two views.
        let block = WHOLE_BLOCKS + 2 * self.slices + 2 * view + u32::from(swapped);
        (u64::from(block) * self.stride) as u32
    }
}

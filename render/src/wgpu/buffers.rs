//! The buffers of a frame on the device, kept between frames.

use crate::kernel::{Buffer, Kernel, RayTracer, Uniform};
use crate::layout::{Counters, FirstCost, FirstHit, Frame};
use crate::plan::Plan;
use crate::scene_data::SceneData;
use splitplane_core::kernel::KernelSet;
use splitplane_wgpu::device::BindGroups;
use splitplane_wgpu::{DeviceTree, Gpu, GpuError};
use std::num::NonZeroU64;
use wgpu::BufferUsages as Usage;

/// The buffers that kernels exchange, and their bind groups. Buffers only grow.
#[derive(Debug)]
pub(super) struct Buffers {
    buffers: [Option<wgpu::Buffer>; RayTracer::BUFFERS.len()],
    uniform: wgpu::Buffer,
    tree: Option<Tree>,
    /// The caller's buffer for the picture, if there is one.
    target: Option<wgpu::Buffer>,
    groups: BindGroups<RayTracer>,
    /// Which words of which scene are there: [`SceneData::revision`] and that of its normals.
    scene: (u64, u64),
}

/// The bindings of a tree.
#[derive(Clone, Debug, PartialEq)]
struct Tree {
    nodes: wgpu::Buffer,
    leaf_references: wgpu::Buffer,
    /// Compressed nodes and their references, where the tree has some.
    compressed: Option<[wgpu::Buffer; 2]>,
    triangles: wgpu::Buffer,
    scene: wgpu::Buffer,
    /// Where two bindings hold the triangles, the place and the bytes of each.
    halves: Option<[(u64, NonZeroU64); 2]>,
}

impl Buffers {
    /// No buffers yet except the uniform.
    pub(super) fn new(gpu: &Gpu) -> Result<Buffers, GpuError> {
        let bytes = size_of::<Frame>() as u64;
        Ok(Buffers {
            buffers: Default::default(),
            uniform: gpu.buffer("frame", bytes, Usage::UNIFORM | Usage::COPY_DST)?,
            tree: None,
            target: None,
            groups: Default::default(),
            scene: (0, 0),
        })
    }

    /// A buffer; `None` before a frame needed it.
    pub(super) fn get(&self, buffer: Buffer) -> Option<&wgpu::Buffer> {
        let tree = self.tree.as_ref();
        match (buffer, &self.target) {
            (Buffer::Pixels, Some(target)) => Some(target),
            (Buffer::Nodes, _) => tree.map(|tree| &tree.nodes),
            (Buffer::LeafReferences, _) => tree.map(|tree| &tree.leaf_references),
            (Buffer::CompressedNodes, _) => Some(&tree?.compressed.as_ref()?[0]),
            (Buffer::CompressedReferences, _) => Some(&tree?.compressed.as_ref()?[1]),
            (Buffer::Triangles, _) => tree.map(|tree| &tree.triangles),
            _ => self.buffers[buffer as usize].as_ref(),
        }
    }

    /// A uniform; `None` before a tree was given.
    pub(super) fn uniform(&self, uniform: Uniform) -> Option<&wgpu::Buffer> {
        match uniform {
            Uniform::Frame => Some(&self.uniform),
            Uniform::Scene => self.tree.as_ref().map(|tree| &tree.scene),
        }
    }

    /// The bind groups of these buffers.
    pub(super) fn groups(&mut self) -> &mut BindGroups<RayTracer> {
        &mut self.groups
    }

    /// Makes space for everything that the kernels of a plan bind. Contents of buffers that grow
    /// are lost.
    pub(super) fn reserve(&mut self, gpu: &Gpu, plan: &Plan) -> Result<(), GpuError> {
        self.grow(gpu, Buffer::Counters, size_of::<Counters>() as u64)?;
        self.grow(gpu, Buffer::Deferred, plan.bytes(Buffer::Deferred))?;
        for kernel in plan.kernels() {
            for buffer in kernel.bindings().map(|binding| binding.buffer) {
                // The tree has its own buffers, and the caller may have one for the picture.
                let own = Buffer::ALLOCATED.contains(&buffer)
                    && (buffer != Buffer::Pixels || self.target.is_none());
                if own {
                    // One element at least: a binding cannot be empty.
                    let tail = if buffer == Buffer::Scene { self.tail_bytes() } else { 0 };
                    let bytes = plan.bytes(buffer).max(buffer.element_size() as u64) + tail;
                    self.grow(gpu, buffer, bytes)?;
                }
            }
        }
        Ok(())
    }

    fn grow(&mut self, gpu: &Gpu, buffer: Buffer, bytes: u64) -> Result<(), GpuError> {
        let slot = &mut self.buffers[buffer as usize];
        if slot.as_ref().is_none_or(|held| held.size() < bytes) {
            // The old one goes first: both may not fit.
            *slot = None;
            self.groups.clear();
            if buffer == Buffer::Scene {
                self.scene = (0, 0);
            }
            let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
            *slot = Some(gpu.buffer(&format!("{buffer:?}"), bytes, usage)?);
        }
        Ok(())
    }

    /// Sets the tree to trace.
    pub(super) fn set_tree(&mut self, gpu: &Gpu, tree: &DeviceTree) {
        let place = |half: wgpu::BufferBinding<'_>| half.size.map(|size| (half.offset, size));
        let halves = tree
            .triangle_halves(gpu)
            .and_then(|[first, second]| Some([place(first)?, place(second)?]));
        let held = Tree {
            nodes: tree.nodes().clone(),
            leaf_references: tree.leaf_references().clone(),
            compressed: tree.compressed_buffers().map(|held| held.map(wgpu::Buffer::clone)),
            triangles: tree.triangles().clone(),
            scene: tree.scene().clone(),
            halves,
        };
        if self.tree.as_ref() != Some(&held) {
            self.tree = Some(held);
            self.groups.clear();
        }
    }

    /// A half of the triangles; `None` where one binding holds them.
    pub(super) fn triangle_half(&self, second: bool) -> Option<wgpu::BufferBinding<'_>> {
        let tree = self.tree.as_ref()?;
        let (offset, size) = tree.halves?[usize::from(second)];
        Some(wgpu::BufferBinding { buffer: &tree.triangles, offset, size: Some(size) })
    }

    /// Bytes of the second half of the triangles, which stands behind the words of the scene too; 0 where one binding holds all.
    fn tail_bytes(&self) -> u64 {
        self.triangle_half(true).and_then(|half| half.size).map_or(0, NonZeroU64::get)
    }

    /// Copies the second half of the triangles, if there is one, behind the words of the scene.
    pub(super) fn copy_tail(&self, gpu: &Gpu, words: u64) -> Result<(), GpuError> {
        let (Some(half), Some(scene)) = (self.triangle_half(true), self.get(Buffer::Scene)) else {
            return Ok(());
        };
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let bytes = self.tail_bytes();
        encoder.copy_buffer_to_buffer(half.buffer, half.offset, scene, 4 * words, bytes);
        let recorded = gpu.guard(|| encoder.finish())?;
        gpu.submit([recorded]).map(|_| ())
    }

    /// Sets the buffer for the picture; `None` for a buffer of its own.
    pub(super) fn set_target(&mut self, target: Option<&wgpu::Buffer>) {
        if self.target.as_ref() != target {
            self.target = target.cloned();
            self.groups.forget(Kernel::Resolve);
        }
    }

    /// Uploads the initial data of the frame: the uniform and the counters.
    pub(super) fn upload(&self, gpu: &Gpu, frame: &Frame, counters: &Counters) {
        gpu.write(&self.uniform, 0, bytemuck::bytes_of(frame));
        if let Some(buffer) = self.get(Buffer::Counters) {
            gpu.write(buffer, 0, bytemuck::bytes_of(counters));
        }
    }

    /// Fills the buffers that a slice writes only in part with the initial contents of the CPU's
    /// buffers: for comparing them between slices.
    pub(super) fn fill(&self, gpu: &Gpu, plan: &Plan) {
        let fill = |buffer: Buffer, element: &[u8]| {
            if let Some(held) = self.get(buffer) {
                let bytes = element.repeat(plan.elements(buffer) as usize);
                gpu.write(held, 0, &bytes);
            }
        };
        fill(Buffer::FirstHits, bytemuck::bytes_of(&FirstHit::MISS));
        fill(Buffer::FirstCosts, bytemuck::bytes_of(&FirstCost::default()));
    }

    /// Uploads the words of a scene, or only its normals, when they have changed.
    pub(super) fn upload_scene(&mut self, gpu: &Gpu, scene: &SceneData) {
        let now = (scene.revision(), scene.normals_revision());
        let Some(buffer) = &self.buffers[Buffer::Scene as usize] else { return };
        let words = if self.scene.0 != now.0 {
            0..scene.words().len()
        } else if self.scene.1 != now.1 {
            scene.normal_words()
        } else {
            return;
        };
        let at = 4 * words.start as u64;
        gpu.write(buffer, at, bytemuck::cast_slice(&scene.words()[words]));
        self.scene = now;
    }

    /// Bytes on the device that are held between frames, the tree's not counted.
    pub(super) fn bytes(&self) -> u64 {
        let held = self.buffers.iter().flatten().map(wgpu::Buffer::size);
        held.sum::<u64>() + self.uniform.size()
    }
}

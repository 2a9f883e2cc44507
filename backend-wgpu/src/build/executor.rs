//! Records the schedule's steps as commands of the device.

use std::num::NonZeroU32;

use splitplane_core::kernel::{Buffer, Counter, Grid, Kernel, TreeBuilder};
use splitplane_core::layout::{Counters, LargeNode};
use splitplane_core::lockstep::Inspect;
use splitplane_core::schedule::Executor;
use wgpu::BufferUsages as Usage;

use super::buffers::{Buffers, ROOTS_A_SLICE, readback};
use super::capacities::{Capacities, binding_limit};
use super::kernels::Kernels;
use super::profile::Profile;
use crate::error::GpuError;
use crate::gpu::Gpu;
use crate::query::Queries;

/// How the executor answers whether a loop goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Looking {
    /// It runs this many rounds, and whoever reads the counters later sees whether they sufficed.
    Never(u32),
    /// It submits what is recorded and reads the counter.
    Always,
}

/// The GPU executor: one build over a mesh that is already in its buffers. Dispatches are recorded;
/// submitting them is up to whoever made it.
#[derive(Debug)]
pub struct WgpuExecutor<'a> {
    gpu: &'a Gpu,
    kernels: &'a Kernels,
    buffers: &'a mut Buffers,
    capacities: Capacities,
    looking: Looking,
    profile: Option<&'a mut Profile>,
    encoder: Option<wgpu::CommandEncoder>,
    pass: Option<wgpu::ComputePass<'static>>,
    groups: Vec<Option<wgpu::BindGroup>>,
    swapped: bool,
    /// Rounds run: a level has at most twice the nodes of the one before. None when it began
    /// elsewhere.
    level: Option<u32>,
    dispatches: u32,
    /// Most workgroups of a dispatch, where a caller limits them, and of any so far.
    max_workgroups: Option<NonZeroU32>,
    most_workgroups: u32,
}

/// Workgroups of a dispatch that loops over a list of unknown length: enough to fill a large GPU, few
/// enough to cost little where the list is short. Software does one after the other: few for short
/// lists. For long ones no fewer than one for 16 things, since Mesa's llvmpipe ends an invocation,
/// in silence, after 65,535 rounds of all its loops, and a small root takes up to 900.
fn most_groups(software: bool, things: u32) -> u32 {
    if software { (things / 16).clamp(64, 65_535) } else { 2048 }
}

impl<'a> WgpuExecutor<'a> {
    pub(crate) fn new(
        gpu: &'a Gpu,
        kernels: &'a Kernels,
        buffers: &'a mut Buffers,
        capacities: Capacities,
        looking: Looking,
    ) -> WgpuExecutor<'a> {
        WgpuExecutor {
            gpu,
            kernels,
            buffers,
            capacities,
            looking,
            profile: None,
            encoder: None,
            pass: None,
            groups: vec![None; 2 * Kernel::ALL.len()],
            swapped: false,
            level: Some(0),
            dispatches: 0,
            max_workgroups: None,
            most_workgroups: 0,
        }
    }

    /// With no more than this many workgroups a dispatch.
    pub(crate) fn limited(mut self, most: Option<NonZeroU32>) -> WgpuExecutor<'a> {
        self.max_workgroups = most;
        self
    }

    /// Goes on where another executor over the same buffers stopped.
    pub(crate) fn resumed(mut self, swapped: bool) -> WgpuExecutor<'a> {
        self.swapped = swapped;
        self.level = None;
        self
    }

    pub(crate) fn profiled(mut self, profile: &'a mut Profile) -> WgpuExecutor<'a> {
        self.profile = Some(profile);
        self
    }

    /// Whether active and next lists have changed places.
    pub(crate) fn swapped(&self) -> bool {
        self.swapped
    }

    /// Dispatches recorded so far.
    pub fn dispatches(&self) -> u32 {
        self.dispatches
    }

    /// Workgroups of the largest dispatch of the schedule so far.
    pub(crate) fn most_workgroups(&self) -> u32 {
        self.most_workgroups
    }

    /// The encoder, outside of any pass.
    pub(crate) fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        let gpu = self.gpu;
        self.encoder.get_or_insert_with(|| new_encoder(gpu))
    }

    /// Records the kernel that finds the range of the triangles' coordinates, for queries.
    pub(crate) fn record_limits(&mut self, queries: &Queries, count: u32) -> Result<(), GpuError> {
        let triangles = self.buffers.get(Buffer::Triangles).clone();
        let readback = self.buffers.readback.clone();
        let encoder = self.encoder();
        queries.record_triangle_limits(encoder, &triangles, count, &readback, readback::LIMITS)?;
        self.dispatches += 1;
        Ok(())
    }

    /// Copies what the host reads after the build.
    pub(crate) fn read_back(&mut self, tree_to_host: bool) {
        let readback = self.buffers.readback.clone();
        let counters = self.buffers.get(Buffer::Counters).clone();
        self.encoder().copy_buffer_to_buffer(&counters, 0, &readback, 0, 64);
        if tree_to_host {
            // All there is room for, since how much it is stays on the device.
            let nodes = self.buffers.get(Buffer::Nodes).clone();
            let references = self.buffers.get(Buffer::LeafReferences).clone();
            let node_bytes = self.capacities.bytes_of(Buffer::Nodes);
            let reference_bytes = self.capacities.bytes_of(Buffer::LeafReferences);
            let at = readback::TREE;
            let encoder = self.encoder();
            encoder.copy_buffer_to_buffer(&nodes, 0, &readback, at, node_bytes);
            let at = at + node_bytes;
            encoder.copy_buffer_to_buffer(&references, 0, &readback, at, reference_bytes);
        }
    }

    /// Submits what is recorded.
    ///
    /// # Errors
    /// The device's.
    pub(crate) fn submit(&mut self) -> Result<(), GpuError> {
        self.submit_after(None)
    }

    /// Submits what is recorded, behind other commands.
    ///
    /// # Errors
    /// The device's.
    pub(crate) fn submit_after(
        &mut self,
        before: Option<wgpu::CommandBuffer>,
    ) -> Result<(), GpuError> {
        self.pass = None;
        if let Some(encoder) = self.encoder.take() {
            // What was recorded wrongly is refused here.
            let recorded = self.gpu.guard(|| encoder.finish())?;
            self.gpu.submit(before.into_iter().chain([recorded]))?;
        }
        Ok(())
    }

    fn bind_group(&mut self, kernel: Kernel) -> Result<&wgpu::BindGroup, GpuError> {
        let slot = &mut self.groups[2 * kernel as usize + usize::from(self.swapped)];
        if slot.is_none() {
            let compiled = self.kernels.get(self.gpu, kernel)?;
            let size = size_of::<splitplane_core::layout::Parameters>() as u64;
            let mut entries = vec![
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                        buffer: &self.buffers.parameters,
                        offset: 0,
                        size: wgpu::BufferSize::new(size),
                    }),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: self.buffers.get(Buffer::Counters).as_entire_binding(),
                },
            ];
            for (index, binding) in kernel.storage_bindings().enumerate() {
                let Some(buffer) = self.buffers.find(binding.buffer) else {
                    // A schedule for another preset than the executor was made for.
                    let what = format!("{kernel:?} needs {:?}", binding.buffer);
                    return Err(GpuError::Refused(format!("{what}, which this preset lacks")));
                };
                entries.push(wgpu::BindGroupEntry {
                    binding: 2 + index as u32,
                    resource: buffer.as_entire_binding(),
                });
            }
            *slot = Some(self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(kernel.name()),
                layout: &compiled.layout,
                entries: &entries,
            }));
        }
        Ok(slot.as_ref().expect("made above"))
    }

    /// The most things a grid may stand for now.
    fn most(&self, counter: Counter) -> u32 {
        let c = &self.capacities;
        match counter {
            Counter::InputChunks => c.triangles.div_ceil(splitplane_core::config::CHUNK),
            Counter::ActiveNodes => {
                let nodes = self.level.map_or(u32::MAX, |level| 1 << level.min(31));
                c.nodes.min(nodes)
            }
            Counter::Chunks => c.chunks,
            Counter::SmallRoots => c.small_roots,
            _ => c.top_nodes,
        }
    }

    fn read(&self, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Result<Vec<u8>, GpuError> {
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let staging = self.gpu.buffer("look", bytes, Usage::COPY_DST | Usage::MAP_READ)?;
        let mut encoder = new_encoder(self.gpu);
        encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, bytes);
        self.gpu.submit([encoder.finish()])?;
        self.gpu.read_mapped(&staging, bytes)
    }

    /// The counters, after all that is recorded. Those of lists that have changed places are given
    /// under the names of what the lists now are.
    ///
    /// # Errors
    /// The device's.
    pub fn counters(&mut self) -> Result<Counters, GpuError> {
        self.submit()?;
        let bytes = self.read(self.buffers.get(Buffer::Counters), 0, 64)?;
        Ok(counters_from(&bytes, self.swapped))
    }
}

/// Counters from their bytes.
pub(crate) fn counters_from(bytes: &[u8], swapped: bool) -> Counters {
    let mut counters: Counters = bytemuck::pod_read_unaligned(&bytes[..64]);
    if swapped {
        counters.words.swap(Counter::ActiveNodes as usize, Counter::NextNodes as usize);
        counters.words.swap(Counter::ActiveReferences as usize, Counter::NextReferences as usize);
    }
    counters
}

fn new_encoder(gpu: &Gpu) -> wgpu::CommandEncoder {
    gpu.device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("splitplane build") })
}

impl Executor<TreeBuilder> for WgpuExecutor<'_> {
    type Error = GpuError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), GpuError> {
        // All that can fail comes before the pass is opened.
        let group = self.bind_group(kernel)?.clone();
        let pipeline = self.kernels.get(self.gpu, kernel)?.pipeline.clone();
        let software = self.gpu.info().device_type == wgpu::DeviceType::Cpu;
        // Parameters' offset and workgroups of each dispatch.
        let whole = self.buffers.whole(self.swapped);
        let dispatches: Vec<(u32, u32)> = match kernel.grid() {
            Grid::One => vec![(whole, 1)],
            Grid::Each(Counter::SmallRoots) => (0..self.capacities.small_roots)
                .step_by(ROOTS_A_SLICE as usize)
                .map(|first| {
                    let roots = (self.capacities.small_roots - first).min(ROOTS_A_SLICE);
                    let groups = roots.min(most_groups(software, roots));
                    (self.buffers.slice(first / ROOTS_A_SLICE), groups)
                })
                .collect(),
            Grid::Each(counter) => {
                let things = self.most(counter);
                // These two do one thing an invocation.
                let by_invocation = matches!(kernel, Kernel::AssignChunks | Kernel::EmitTop);
                let wanted = if by_invocation { things.div_ceil(256) } else { things };
                vec![(whole, wanted.clamp(1, most_groups(software, wanted)))]
            }
        };
        if self.profile.is_some() {
            self.pass = None;
        }
        if self.pass.is_none() {
            let gpu = self.gpu;
            let encoder = self.encoder.get_or_insert_with(|| new_encoder(gpu));
            let timestamp_writes =
                self.profile.as_deref_mut().and_then(|profile| profile.next(kernel));
            let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(kernel.name()),
                timestamp_writes,
            });
            self.pass = Some(pass.forget_lifetime());
        }
        let pass = self.pass.as_mut().expect("opened above");
        pass.set_pipeline(&pipeline);
        let most = self.max_workgroups.map_or(u32::MAX, NonZeroU32::get);
        for (offset, groups) in dispatches {
            let groups = groups.min(most);
            self.most_workgroups = self.most_workgroups.max(groups);
            pass.set_bind_group(0, &group, &[offset]);
            pass.dispatch_workgroups(groups, 1, 1);
            self.dispatches += 1;
        }
        if kernel == Kernel::ScanTriangles {
            // The root's cell is the tree's bounds; its node will be overwritten.
            let size = size_of::<LargeNode>() as u64;
            let nodes = self.buffers.get(Buffer::ActiveNodes).clone();
            let readback = self.buffers.readback.clone();
            self.encoder().copy_buffer_to_buffer(&nodes, 0, &readback, readback::ROOT, size);
        }
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), GpuError> {
        match (a, b) {
            (Buffer::ActiveNodes, Buffer::NextNodes) => {}
            // The second exchange of a level: from here on the kernels read the other counters.
            (Buffer::References, Buffer::NextReferences) => self.swapped = !self.swapped,
            _ => return Err(GpuError::Refused(format!("{a:?} and {b:?} cannot be exchanged"))),
        }
        self.buffers.swap(a, b);
        Ok(())
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, GpuError> {
        if rounds > 0 {
            self.level = self.level.map(|level| level + 1);
        }
        match self.looking {
            Looking::Never(levels) => Ok(rounds < levels),
            Looking::Always => Ok(self.counters()?[counter] > 0),
        }
    }
}

impl Inspect<TreeBuilder> for WgpuExecutor<'_> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, GpuError> {
        let counters = self.counters()?;
        if buffer == Buffer::Counters {
            return Ok(bytemuck::bytes_of(&counters).to_vec());
        }
        if counters[Counter::Overflow] != 0 {
            // The rooms were made as large as the device allows: counts now go beyond them.
            let (allowed, limit) = binding_limit(self.gpu.limits());
            let what = "a list of this scene".into();
            return Err(GpuError::Limit { what, limit, needed: allowed + 1, allowed });
        }
        let Some(length) = buffer.live() else { return Ok(Vec::new()) };
        let bytes = u64::from(counters[length]) * buffer.element_size() as u64;
        let room = u64::from(self.capacities.chunks);
        // What a chunk is known by stands in one buffer, one array behind the other.
        let offset = match buffer {
            Buffer::ReferenceSides => room * Buffer::ChunkCounts.element_size() as u64,
            Buffer::ChunkBounds => {
                let before =
                    Buffer::ChunkCounts.element_size() + Buffer::ReferenceSides.element_size();
                room * before as u64
            }
            _ => 0,
        };
        self.buffers.find(buffer).map_or(Ok(Vec::new()), |held| self.read(held, offset, bytes))
    }
}

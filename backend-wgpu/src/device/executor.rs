//! Records a schedule's steps as commands of the device, for any kernel set.

use std::num::NonZeroU32;
use std::ops::Index;

use splitplane_core::build::lockstep::Inspect;
use splitplane_core::build::schedule::Executor;
use splitplane_core::kernel::{KernelSet, Slot};

use super::bindings::{BindGroups, bind};
use super::kernel_set::{Bound, DeviceSet};
use super::once::FEW_WORKGROUPS;
use super::pipelines::{Compiled, Pipelines};
use super::profile::Profile;
use super::readback::read;
use crate::device::gpu::Gpu;
use crate::error::GpuError;

/// The work of a device executor: the memory behind the names of a set, the sizes of its grids, and
/// how long its loops may continue. A tree build is one kind, a frame another.
pub trait Job {
    /// The kernels.
    type Set: DeviceSet;
    /// The counters as they lie in their buffer.
    type Counters: bytemuck::Pod + Index<SetCounter<Self>, Output = u32>;
    /// What can go wrong.
    type Error: From<GpuError>;

    /// Which of its texts a kernel has.
    fn variant(&self) -> &<Self::Set as DeviceSet>::Variant;

    /// The buffer of a name while lists are in their original places; `None` when there is none.
    /// Asked for storages only ([`KernelSet::storage`]).
    fn buffer(&self, buffer: SetBuffer<Self>) -> Option<&wgpu::Buffer>;

    /// A uniform; `None` when there is none.
    fn uniform(&self, uniform: SetUniform<Self>) -> Option<wgpu::BufferBinding<'_>>;

    /// The bind groups that were made of these.
    fn groups(&mut self) -> &mut BindGroups<Self::Set>;

    /// The dispatches that a kernel takes, in order. `swapped` says whether lists have changed places.
    fn pieces(&self, kernel: SetKernel<Self>, swapped: bool, pieces: &mut Vec<Piece>);

    /// Workgroups of the retry of a piece of a kernel's grid: as many as the piece has, unless the retry has a grid of its own. None where
    /// the kernel leaves nothing to it.
    fn retry_workgroups(&self, _kernel: SetKernel<Self>, piece: &Piece) -> u32 {
        piece.workgroups
    }

    /// Notes that a loop asks for its next round, and says how it continues without reading
    /// counters.
    fn round(&mut self, counter: SetCounter<Self>, rounds: u32) -> Round;

    /// Counters by the names that lists have now; the kernels may have left them under others.
    fn named(&self, counters: Self::Counters, _swapped: bool) -> Self::Counters {
        counters
    }

    /// Whether the work is void: a list outgrew its capacity.
    fn is_void(&self, counters: &Self::Counters) -> bool;

    /// Whether buffers may be read.
    ///
    /// # Errors
    /// Why not.
    fn check_counters(&self, _counters: &Self::Counters) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Where a buffer begins in its storage.
    fn offset(&self, _buffer: SetBuffer<Self>) -> u64 {
        0
    }

    /// How much of the buffer of a storage is bound: all of it, unless the list has several parts or the view of
    /// a dispatch is of a part of it ([`Piece::view`]).
    fn part<'b>(
        &self,
        _kernel: SetKernel<Self>,
        _bound: &Bound<Self::Set>,
        _view: u32,
        held: &'b wgpu::Buffer,
    ) -> wgpu::BufferBinding<'b> {
        held.as_entire_buffer_binding()
    }

    /// Which buffer a storage binding of a kernel refers to in a view, by its name.
    fn viewed(
        &self,
        _kernel: SetKernel<Self>,
        buffer: SetBuffer<Self>,
        _view: u32,
    ) -> SetBuffer<Self> {
        buffer
    }

    /// Whether the host finishes what a kernel has left to it, before the next one.
    fn has_host_part(&self, _kernel: SetKernel<Self>) -> bool {
        false
    }

    /// Finishes what a kernel, which is submitted with all before it, has left to the host. What this writes comes before
    /// all that is submitted later.
    ///
    /// # Errors
    /// The device's, or why the work cannot be finished.
    fn finish_on_host(&mut self, _kernel: SetKernel<Self>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// What must be copied right after a kernel, since a later one overwrites it.
    fn copy_behind(&self, _kernel: SetKernel<Self>) -> Option<CopyOut> {
        None
    }
}

type SetKernel<J> = <<J as Job>::Set as KernelSet>::Kernel;
type SetBuffer<J> = <<J as Job>::Set as KernelSet>::Buffer;
type SetUniform<J> = <<J as Job>::Set as KernelSet>::Uniform;
type SetCounter<J> = <<J as Job>::Set as KernelSet>::Counter;

/// A dispatch, or a part of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Where its block of the uniform begins, in a set whose uniform is a list of blocks.
    pub block: Option<u32>,
    /// How many workgroups.
    pub workgroups: u32,
    /// Which parts of long lists it sees; 0 where it sees all.
    pub view: u32,
}

/// How a loop continues that is recorded without reading counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Round {
    /// Whether there may be another round.
    pub goes_on: bool,
    /// Whether what is recorded is submitted first.
    pub submit: bool,
}

/// Bytes of one buffer for another.
#[derive(Clone, Debug)]
pub struct CopyOut {
    /// From the start of this.
    pub from: wgpu::Buffer,
    /// To this.
    pub to: wgpu::Buffer,
    /// Where in it.
    pub at: u64,
    /// How many.
    pub bytes: u64,
}

/// How the executor decides whether a loop continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopControl {
    /// As [`Job::round`] says; the counters, read later, tell whether that sufficed.
    Recorded,
    /// It submits what is recorded and reads the counter.
    ReadCounters,
}

/// An executor on a device. Dispatches are recorded; submitting them is up to its creator.
#[derive(Debug)]
pub struct DeviceExecutor<'a, J: Job> {
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    job: J,
    loops: LoopControl,
    profile: Option<&'a mut Profile<J::Set>>,
    /// By kernel, once it was needed.
    shaders: Vec<Option<Shaders>>,
    pieces: Vec<Piece>,
    encoder: Option<wgpu::CommandEncoder>,
    pass: Option<wgpu::ComputePass<'static>>,
    /// Whether the lists of this round and the next have changed places.
    swapped: bool,
    dispatches: u32,
    submissions: u32,
    /// Most workgroups of a dispatch, where a caller limits them, and of any so far.
    max_workgroups: Option<NonZeroU32>,
    most_workgroups: u32,
}

/// The shaders of a kernel.
#[derive(Clone, Debug)]
struct Shaders {
    /// Its own, and what finishes what that leaves.
    compiled: Vec<Compiled>,
    /// Whether the second is its retry.
    retries: bool,
    /// Whether its own binds other buffers than the rest.
    own_bindings: bool,
}

impl<'a, J: Job> DeviceExecutor<'a, J> {
    /// An executor that has recorded nothing.
    pub fn new(
        gpu: &'a Gpu,
        pipelines: &'a Pipelines,
        job: J,
        loops: LoopControl,
    ) -> DeviceExecutor<'a, J> {
        DeviceExecutor {
            gpu,
            pipelines,
            job,
            loops,
            profile: None,
            shaders: vec![None; J::Set::KERNELS.len()],
            pieces: Vec::new(),
            encoder: None,
            pass: None,
            swapped: false,
            dispatches: 0,
            submissions: 0,
            max_workgroups: None,
            most_workgroups: 0,
        }
    }

    /// With no more than this many workgroups per dispatch.
    #[must_use]
    pub fn limited(mut self, most: Option<NonZeroU32>) -> DeviceExecutor<'a, J> {
        self.max_workgroups = most;
        self
    }

    /// With the time of every dispatch. Each is then a pass of its own.
    #[must_use]
    pub fn profiled(mut self, profile: &'a mut Profile<J::Set>) -> DeviceExecutor<'a, J> {
        self.profile = Some(profile);
        self
    }

    /// Continues where another executor over the same memory stopped.
    #[must_use]
    pub fn resumed(mut self, swapped: bool) -> DeviceExecutor<'a, J> {
        self.swapped = swapped;
        self
    }

    /// What it does.
    pub fn job(&self) -> &J {
        &self.job
    }

    /// The same, for another executor. What was recorded and not submitted is dropped.
    pub fn into_job(self) -> J {
        self.job
    }

    /// Whether the lists of this round and the next have changed places.
    pub fn swapped(&self) -> bool {
        self.swapped
    }

    /// Dispatches recorded so far.
    pub fn dispatches(&self) -> u32 {
        self.dispatches
    }

    /// Submissions so far.
    pub fn submissions(&self) -> u32 {
        self.submissions
    }

    /// Workgroups of the largest dispatch of the schedule so far.
    pub fn most_workgroups(&self) -> u32 {
        self.most_workgroups
    }

    /// The encoder, outside of any pass.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        let gpu = self.gpu;
        self.encoder.get_or_insert_with(|| new_encoder::<J::Set>(gpu))
    }

    /// Counts a dispatch that a caller has recorded by [`DeviceExecutor::encoder`].
    pub(crate) fn count_dispatch(&mut self) {
        self.dispatches += 1;
    }

    /// Submits what is recorded.
    ///
    /// # Errors
    /// What was recorded wrongly; the device's.
    pub fn submit(&mut self) -> Result<(), GpuError> {
        self.submit_after(None)
    }

    /// Submits what is recorded, after other commands.
    ///
    /// # Errors
    /// As for [`DeviceExecutor::submit`].
    pub fn submit_after(&mut self, before: Option<wgpu::CommandBuffer>) -> Result<(), GpuError> {
        self.pass = None;
        if let Some(encoder) = self.encoder.take() {
            // What was recorded wrongly is refused here.
            let recorded = self.gpu.guard(|| encoder.finish())?;
            self.gpu.submit(before.into_iter().chain([recorded]))?;
            self.submissions += 1;
        }
        Ok(())
    }

    /// The counters, after all that is recorded. Those of lists that have changed places are given
    /// under the names of what the lists now are.
    ///
    /// # Errors
    /// The device's.
    pub fn counters(&mut self) -> Result<J::Counters, J::Error> {
        self.submit()?;
        let counters = J::Set::BUFFERS.iter().map(|row| row.buffer).find(|&b| is_counters::<J>(b));
        let held = counters.and_then(|buffer| self.job.buffer(buffer));
        let held = held.ok_or_else(|| GpuError::Refused("there are no counters".into()))?;
        let bytes = read(self.gpu, held, 0, size_of::<J::Counters>() as u64)?;
        Ok(self.job.named(bytemuck::pod_read_unaligned(&bytes), self.swapped))
    }

    /// The buffer that a name refers to now.
    fn held(&self, buffer: SetBuffer<J>) -> Option<&wgpu::Buffer> {
        let storage = J::Set::storage(buffer);
        self.job.buffer(if self.swapped { J::Set::exchanged(storage) } else { storage })
    }

    /// The shaders of a kernel, in their order; there is at least one.
    fn shaders(&mut self, kernel: SetKernel<J>) -> Result<Shaders, GpuError> {
        let place = J::Set::kernel_index(kernel);
        if let Some(shaders) = &self.shaders[place] {
            return Ok(shaders.clone());
        }
        let (gpu, variant) = (self.gpu, self.job.variant());
        let own = self.pipelines.get::<J::Set>(gpu, kernel, variant)?;
        let retry = self.pipelines.get_retry::<J::Set>(gpu, kernel, variant)?;
        let settle = self.pipelines.get_settle::<J::Set>(gpu, kernel, variant)?;
        let retries = retry.is_some();
        let compiled = [Some(own), retry, settle].into_iter().flatten().collect();
        let own_bindings = J::Set::own_bindings(kernel, variant).is_some();
        Ok(self.shaders[place].insert(Shaders { compiled, retries, own_bindings }).clone())
    }

    /// A bind group for each of these views: for a kernel's own shader where that binds other buffers than the rest, or for all that
    /// bind the same.
    fn groups(
        &mut self,
        kernel: SetKernel<J>,
        layout: &wgpu::BindGroupLayout,
        views: &[u32],
        own: bool,
    ) -> Result<Vec<wgpu::BindGroup>, GpuError> {
        views.iter().map(|&view| self.group(kernel, layout, view, own)).collect()
    }

    fn group(
        &mut self,
        kernel: SetKernel<J>,
        layout: &wgpu::BindGroupLayout,
        view: u32,
        own: bool,
    ) -> Result<wgpu::BindGroup, GpuError> {
        let swapped = self.swapped;
        if let Some(group) = self.job.groups().place(kernel, swapped, view, own) {
            return Ok(group.clone());
        }
        let variant = self.job.variant();
        let bound = match J::Set::own_bindings(kernel, variant) {
            Some(bound) if own => bound,
            _ => J::Set::bindings(kernel, variant),
        };
        let counted = self.pipelines.counted();
        let find = |bound: &Bound<J::Set>| match bound.slot {
            Slot::Uniform(uniform) => self.job.uniform(uniform),
            Slot::Storage(binding) => {
                let buffer = self.job.viewed(kernel, binding.buffer, view);
                self.held(buffer).map(|held| self.job.part(kernel, bound, view, held))
            }
        };
        let group = bind::<J::Set>(self.gpu, layout, kernel, &bound, counted, find)?;
        Ok(self.job.groups().place(kernel, swapped, view, own).insert(group).clone())
    }
}

/// Whether a buffer is that of the counters, which every kernel of a schedule binds.
fn is_counters<J: Job>(buffer: SetBuffer<J>) -> bool {
    J::Set::is_bound_by_all(buffer)
}

fn new_encoder<K: KernelSet>(gpu: &Gpu) -> wgpu::CommandEncoder {
    gpu.device().create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(K::NAME) })
}

impl<J: Job> Executor<J::Set> for DeviceExecutor<'_, J> {
    type Error = J::Error;

    fn dispatch(&mut self, kernel: SetKernel<J>) -> Result<(), J::Error> {
        // All that can fail comes before the pass is opened.
        let Shaders { compiled, retries, own_bindings } = self.shaders(kernel)?;
        let few_retries = retries && J::Set::FEW_RETRIES && !self.gpu.is_software();
        self.pieces.clear();
        self.job.pieces(kernel, self.swapped, &mut self.pieces);
        let views: Vec<u32> = self.pieces.iter().map(|piece| piece.view).collect();
        let layout = &compiled[0].layout;
        let first = self.groups(kernel, layout, &views, own_bindings)?;
        let rest = match own_bindings && compiled.len() > 1 {
            true => Some(self.groups(kernel, layout, &views, false)?),
            false => None,
        };
        if self.profile.is_some() {
            self.pass = None;
        }
        if self.pass.is_none() {
            let gpu = self.gpu;
            let encoder = self.encoder.get_or_insert_with(|| new_encoder::<J::Set>(gpu));
            let timestamp_writes =
                self.profile.as_deref_mut().and_then(|profile| profile.next(kernel));
            let pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(J::Set::kernel(kernel).name),
                timestamp_writes,
            });
            self.pass = Some(pass.forget_lifetime());
        }
        let pass = self.pass.as_mut().expect("opened above");
        let most = self.max_workgroups.map_or(u32::MAX, NonZeroU32::get);
        for (place, compiled) in compiled.iter().enumerate() {
            pass.set_pipeline(&compiled.pipeline);
            let groups = rest.as_ref().filter(|_| place > 0).unwrap_or(&first);
            for (piece, group) in self.pieces.iter().zip(groups) {
                let is_retry = retries && place == 1;
                let few = few_retries && is_retry;
                let most = if few { most.min(FEW_WORKGROUPS) } else { most };
                let wanted = match is_retry {
                    true => self.job.retry_workgroups(kernel, piece),
                    false => piece.workgroups,
                };
                if wanted == 0 {
                    continue;
                }
                let workgroups = wanted.min(most);
                self.most_workgroups = self.most_workgroups.max(workgroups);
                pass.set_bind_group(0, group, piece.block.as_slice());
                pass.dispatch_workgroups(workgroups, 1, 1);
                self.dispatches += 1;
            }
        }
        if let Some(CopyOut { from, to, at, bytes }) = self.job.copy_behind(kernel) {
            self.encoder().copy_buffer_to_buffer(&from, 0, &to, at, bytes);
        }
        if self.job.has_host_part(kernel) {
            self.submit()?;
            self.job.finish_on_host(kernel)?;
        }
        Ok(())
    }

    fn swap(&mut self, a: SetBuffer<J>, b: SetBuffer<J>) -> Result<(), J::Error> {
        match J::Set::EXCHANGED.iter().position(|&pair| pair == (a, b)) {
            // With the last exchange of a round all names change to the other buffers at once.
            Some(pair) => self.swapped ^= pair + 1 == J::Set::EXCHANGED.len(),
            None => {
                return Err(
                    GpuError::Refused(format!("{a:?} and {b:?} cannot be exchanged")).into()
                );
            }
        }
        Ok(())
    }

    fn pending(&mut self, counter: SetCounter<J>, rounds: u32) -> Result<bool, J::Error> {
        let Round { goes_on, submit } = self.job.round(counter, rounds);
        match self.loops {
            LoopControl::ReadCounters => {
                let counters = self.counters()?;
                // Void work need not be finished.
                Ok(!self.job.is_void(&counters) && counters[counter] > 0)
            }
            LoopControl::Recorded => {
                if submit {
                    self.submit()?;
                }
                Ok(goes_on)
            }
        }
    }
}

impl<J: Job> Inspect<J::Set> for DeviceExecutor<'_, J> {
    fn live(&mut self, buffer: SetBuffer<J>) -> Result<Vec<u8>, J::Error> {
        let counters = self.counters()?;
        if is_counters::<J>(buffer) {
            return Ok(bytemuck::bytes_of(&counters).to_vec());
        }
        self.job.check_counters(&counters)?;
        let row = J::Set::buffer(buffer);
        match (row.live, self.held(buffer)) {
            (Some(length), Some(held)) => {
                let bytes = u64::from(counters[length]) * row.element_size as u64;
                Ok(read(self.gpu, held, self.job.offset(buffer), bytes)?)
            }
            _ => Ok(Vec::new()),
        }
    }
}

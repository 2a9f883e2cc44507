//! Records the steps of a frame as commands of the device.

use super::buffers::{Buffers, exchanged};
use super::pipelines::Pipelines;
use super::readback::read;
use super::room::groups;
use crate::error::RenderError;
use crate::kernel::{Buffer, Counter, Grid, Kernel, RayTracer};
use crate::layout::Counters;
use crate::plan::Plan;
use splitplane_core::lockstep::Inspect;
use splitplane_core::schedule::Executor;
use splitplane_shaders::RenderFeatures;
use splitplane_wgpu::{Gpu, GpuError};

/// How the executor answers whether a loop goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Looking {
    /// It runs all slices and waves that the plan may have.
    Never,
    /// It submits what is recorded and reads the counter.
    Always,
}

/// One frame on the GPU.
#[derive(Debug)]
pub struct WgpuExecutor<'a> {
    gpu: &'a Gpu,
    pipelines: &'a mut Pipelines,
    buffers: &'a mut Buffers,
    plan: Plan,
    features: RenderFeatures,
    looking: Looking,
    encoder: Option<wgpu::CommandEncoder>,
    pass: Option<wgpu::ComputePass<'static>>,
    /// Whether the queues of this wave and of the next have changed places.
    swapped: bool,
    wave: u32,
    dispatches: u32,
    submissions: u32,
}

impl<'a> WgpuExecutor<'a> {
    /// An executor over buffers that are reserved for the plan and hold what a frame starts with.
    pub(super) fn new(
        gpu: &'a Gpu,
        pipelines: &'a mut Pipelines,
        buffers: &'a mut Buffers,
        plan: Plan,
        features: RenderFeatures,
        looking: Looking,
    ) -> WgpuExecutor<'a> {
        let mut executor = WgpuExecutor {
            gpu,
            pipelines,
            buffers,
            plan,
            features,
            looking,
            encoder: None,
            pass: None,
            swapped: false,
            wave: 0,
            dispatches: 0,
            submissions: 0,
        };
        // What the schedule expects to be zero.
        if plan.outputs().shades()
            && let Some(radiance) = executor.buffers.get(Buffer::Radiance).cloned()
        {
            executor.encoder().clear_buffer(&radiance, 0, Some(plan.bytes(Buffer::Radiance)));
        }
        executor
    }

    /// Dispatches recorded so far.
    pub fn dispatches(&self) -> u32 {
        self.dispatches
    }

    /// Submissions so far.
    pub fn submissions(&self) -> u32 {
        self.submissions
    }

    /// The encoder, outside of any pass.
    pub(super) fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        let gpu = self.gpu;
        self.encoder.get_or_insert_with(|| new_encoder(gpu))
    }

    /// Submits what is recorded.
    pub(super) fn submit(&mut self) -> Result<(), GpuError> {
        self.pass = None;
        if let Some(encoder) = self.encoder.take() {
            // What was recorded wrongly is refused here.
            let recorded = self.gpu.guard(|| encoder.finish())?;
            self.gpu.submit([recorded])?;
            self.submissions += 1;
        }
        Ok(())
    }

    /// The counters, after all that is recorded.
    ///
    /// # Errors
    /// The device's.
    pub fn counters(&mut self) -> Result<Counters, RenderError> {
        self.submit()?;
        let bytes = self.read(Buffer::Counters, size_of::<Counters>() as u64)?;
        Ok(bytemuck::pod_read_unaligned(&bytes))
    }

    fn read(&self, buffer: Buffer, bytes: u64) -> Result<Vec<u8>, RenderError> {
        let buffer = if self.swapped { exchanged(buffer) } else { buffer };
        match self.buffers.get(buffer) {
            Some(held) if bytes > 0 => Ok(read(self.gpu, held, bytes)?),
            _ => Ok(Vec::new()),
        }
    }

    /// The most things a grid may stand for now.
    fn most(&self, counter: Counter) -> u32 {
        match counter {
            Counter::Pixels => self.plan.size().pixels(),
            Counter::ShadowRays => self.plan.shadow_room(),
            _ if self.wave == 0 => self.plan.slice_pixels() * self.plan.settings().samples,
            _ => self.plan.path_room(),
        }
    }
}

fn new_encoder(gpu: &Gpu) -> wgpu::CommandEncoder {
    gpu.device()
        .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("splitplane frame") })
}

impl Executor<RayTracer> for WgpuExecutor<'_> {
    type Error = RenderError;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), RenderError> {
        // All that can fail comes before the pass is opened.
        let pipeline = self.pipelines.get(self.gpu, kernel, &self.features)?;
        let group = self.buffers.group(self.gpu, self.pipelines, kernel, self.swapped);
        let groups = match kernel.grid() {
            Grid::One => 1,
            Grid::Chunks(counter) => groups(self.gpu, kernel, self.most(counter)),
        };
        if self.pass.is_none() {
            let pass = self.encoder().begin_compute_pass(&Default::default());
            self.pass = Some(pass.forget_lifetime());
        }
        if let Some(pass) = &mut self.pass {
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(groups, 1, 1);
        }
        self.dispatches += 1;
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), RenderError> {
        match (a, b) {
            (Buffer::Rays, Buffer::NextRays) => {}
            // The second exchange of a wave: from here on the names stand for the other buffers.
            (Buffer::Paths, Buffer::NextPaths) => self.swapped = !self.swapped,
            _ => {
                let reason = format!("{a:?} and {b:?} cannot be exchanged");
                return Err(GpuError::Refused(reason).into());
            }
        }
        Ok(())
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, RenderError> {
        if counter == Counter::Paths {
            self.wave = rounds;
        }
        match (self.looking, counter) {
            (Looking::Always, _) => {
                let counters = self.counters()?;
                // A frame that is void needs no end.
                Ok(counters[Counter::Overflow] == 0 && counters[counter] > 0)
            }
            (Looking::Never, Counter::PixelsLeft) => {
                if rounds > 0 && self.plan.slices() > 1 {
                    self.submit()?;
                }
                Ok(rounds < self.plan.slices())
            }
            (Looking::Never, _) => Ok(rounds < self.plan.waves()),
        }
    }
}

impl Inspect<RayTracer> for WgpuExecutor<'_> {
    fn live(&mut self, buffer: Buffer) -> Result<Vec<u8>, RenderError> {
        let counters = self.counters()?;
        match (buffer, buffer.live()) {
            (Buffer::Counters, _) => Ok(bytemuck::bytes_of(&counters).to_vec()),
            (_, Some(length)) => {
                self.read(buffer, u64::from(counters[length]) * buffer.element_size() as u64)
            }
            (_, None) => Ok(Vec::new()),
        }
    }
}

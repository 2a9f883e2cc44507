//! Exact frames: after each kernel that leaves rays to the CPU the host waits for the device and answers them. Stated once, for hosts that block and
//! those that give way.

use super::executor::executor;
use super::renderer::{Submitted, WgpuRenderer, bring, halved};
use super::undecided::{Undecided, leaves};
use crate::error::RenderError;
use crate::frame::FrameInput;
use crate::kernel::{Buffer, Counter, Kernel, RayTracer, first_counters};
use crate::layout::{Counters, Frame};
use crate::plan::Plan;
use crate::schedule;
use splitplane_core::build::schedule::Executor;
use splitplane_shaders::RenderFeatures;
use splitplane_wgpu::device::readback::read_by;
use splitplane_wgpu::device::{LoopControl, Wait};
use splitplane_wgpu::{DeviceTree, GpuError};
use std::convert::Infallible;
use std::sync::Arc;

/// A call of the schedule.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Dispatch(Kernel),
    Swap(Buffer, Buffer),
    /// Of a loop inside of a slice.
    Pending(Counter, u32),
}

/// Writes down what the schedule does with one slice: it calls executors that return, and a step here may have to be awaited.
struct Steps<'a> {
    plan: &'a Plan,
    steps: Vec<Step>,
}

impl Executor<RayTracer> for Steps<'_> {
    type Error = Infallible;

    fn dispatch(&mut self, kernel: Kernel) -> Result<(), Infallible> {
        self.steps.push(Step::Dispatch(kernel));
        Ok(())
    }

    fn swap(&mut self, a: Buffer, b: Buffer) -> Result<(), Infallible> {
        self.steps.push(Step::Swap(a, b));
        Ok(())
    }

    fn pending(&mut self, counter: Counter, rounds: u32) -> Result<bool, Infallible> {
        if counter == Counter::PixelsLeft {
            return Ok(rounds == 0);
        }
        self.steps.push(Step::Pending(counter, rounds));
        Ok(rounds < self.plan.waves())
    }
}

/// The steps of a slice, and those after the last one.
fn steps_of(plan: &Plan) -> [Vec<Step>; 2] {
    let mut slice = Steps { plan, steps: Vec::new() };
    let Ok(()) = schedule::pass(&mut slice, plan);
    let mut end = Steps { plan, steps: Vec::new() };
    let Ok(()) = schedule::finish(&mut end, plan);
    [slice.steps, end.steps]
}

impl WgpuRenderer {
    /// Renders all of an exact frame but its end, which is requested; one that is void is repeated in smaller slices. `begun` is
    /// its plan, its uniform, what shaders need, and whether its outputs come along.
    pub(super) async fn begin_exact(
        &mut self,
        wait: Wait,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
        begun: (Plan, Frame, RenderFeatures, bool),
    ) -> Result<(), RenderError> {
        let (mut plan, mut frame, features, brings) = begun;
        while !self.record_exact(wait, tree, input, (plan, frame, features, brings)).await? {
            (plan, frame) = halved(plan, frame)?;
        }
        Ok(())
    }

    /// One attempt. Whether all queues had room.
    async fn record_exact(
        &mut self,
        wait: Wait,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
        (plan, frame, features, brings): (Plan, Frame, RenderFeatures, bool),
    ) -> Result<bool, RenderError> {
        let readback = self.readback(&plan, brings)?;
        let gpu = Arc::clone(&self.gpu);
        let mut undecided = Undecided::new(&gpu, tree, *input, frame);
        let [slice, end] = steps_of(&plan);
        let (buffers, pipelines) = (&mut self.buffers, &self.pipelines);
        let counters = buffers.get(Buffer::Counters).cloned();
        let counters = counters.ok_or_else(|| GpuError::Refused("there are no counters".into()))?;
        let loops = LoopControl::Recorded;
        let mut executor = gpu.guard(|| {
            buffers.upload(&gpu, &frame, &first_counters(plan.pixels()));
            executor(&gpu, pipelines, buffers, plan, features, loops, None)
        })?;
        let mut slices = 0;
        loop {
            let goes_on = gpu.guard(|| executor.pending(Counter::PixelsLeft, slices))??;
            for &step in if goes_on { &slice } else { &end } {
                gpu.guard(|| match step {
                    Step::Dispatch(kernel) => executor.dispatch(kernel),
                    Step::Swap(a, b) => executor.swap(a, b),
                    Step::Pending(counter, rounds) => executor.pending(counter, rounds).map(|_| ()),
                })??;
                match step {
                    Step::Dispatch(kernel) if leaves(kernel) => {
                        executor.submit()?;
                        undecided.finish(wait, kernel, executor.job().buffers(), &plan).await?;
                    }
                    _ => {}
                }
            }
            if !goes_on {
                break;
            }
            slices += 1;
        }
        executor.submit()?;
        let bytes = read_by(wait, &gpu, &counters, 0, size_of::<Counters>() as u64).await?;
        let told: Counters = bytemuck::pod_read_unaligned(&bytes);
        if told[Counter::Overflow] != 0 {
            self.spare = Some(readback);
            return Ok(false);
        }
        gpu.guard(|| bring(&mut executor, &plan, brings, &readback))?;
        executor.submit()?;
        let (submissions, redone) = (executor.submissions(), undecided.redone());
        self.request(Submitted { plan, frame, features, readback, submissions, brings, redone })?;
        Ok(true)
    }
}

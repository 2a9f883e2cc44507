//! A frame on a device: what its grids represent, how long its loops continue, where its buffers
//! are.

use super::buffers::Buffers;
use super::room::groups;
use super::undecided::{Undecided, leaves};
use crate::error::RenderError;
use crate::kernel::{Buffer, Counter, Kernel, RayTracer, Uniform, of_compressed};
use crate::layout::Counters;
use crate::plan::Plan;
use splitplane_core::kernel::{Grid, Slot};
use splitplane_core::ray::Accuracy;
use splitplane_shaders::{RenderFeatures, TriangleTest, has_tail, render_compressed, render_parts};
use splitplane_wgpu::Gpu;
use splitplane_wgpu::device::{
    BindGroups, Bound, DeviceExecutor, DeviceSet, Job, LoopControl, Piece, Pipelines, Round, Text,
    Wait, blocking, kernel_set::with_continued,
};
use wgpu::BufferBinding;

impl DeviceSet for RayTracer {
    /// Kernels contain no more than the scene needs.
    type Variant = RenderFeatures;

    fn text(kernel: Kernel, features: &RenderFeatures) -> Text {
        let name = compressed_name(kernel, features).unwrap_or(kernel.name());
        // The table holds every kernel; a test of the shaders holds it to that.
        let parts = render_parts(name, features).unwrap_or_default();
        Text { name, parts: parts.into() }
    }

    fn own_bindings(kernel: Kernel, features: &RenderFeatures) -> Option<Vec<Bound<RayTracer>>> {
        compressed_name(kernel, features)?;
        let mut bound = Self::bindings(kernel, features);
        bound.iter_mut().for_each(|bound| bound.slot = of_compressed(bound.slot));
        Some(bound)
    }

    fn bindings(kernel: Kernel, features: &RenderFeatures) -> Vec<Bound<RayTracer>> {
        let tail = splitplane_shaders::find(kernel.name()).is_some_and(has_tail);
        let continued = |buffer| features.by_halves && !tail && buffer == Buffer::Triangles;
        with_continued::<RayTracer>(kernel, continued)
    }

    const FEW_RETRIES: bool = true;

    fn retry(kernel: Kernel, features: &RenderFeatures) -> Option<Text> {
        let name = splitplane_shaders::render_retry(kernel.name())?;
        Some(Text { name, parts: render_parts(name, features)?.into() })
    }

    fn settle(kernel: Kernel, features: &RenderFeatures) -> Option<Text> {
        if features.test != TriangleTest::Certain {
            return None;
        }
        let name = splitplane_shaders::render_settle(kernel.name())?;
        Some(Text { name, parts: render_parts(name, features)?.into() })
    }
}

/// The shader of a kernel that goes through compressed nodes, if it is to do so and there is one.
fn compressed_name(kernel: Kernel, features: &RenderFeatures) -> Option<&'static str> {
    render_compressed(kernel.name()).filter(|_| features.compressed)
}

/// The features that shaders need for a plan.
pub(super) fn features(plan: &Plan, accuracy: Accuracy, buffers: &Buffers) -> RenderFeatures {
    let needs = plan.needs();
    RenderFeatures {
        textures: needs.textures,
        smooth_normals: needs.smooth_normals,
        area_lights: plan.area_samples() > 0,
        dielectrics: needs.dielectrics,
        test: match accuracy {
            Accuracy::Fast => TriangleTest::MoellerTrumbore,
            Accuracy::Watertight => TriangleTest::Watertight,
            _ => TriangleTest::Certain,
        },
        by_halves: buffers.triangle_half(false).is_some(),
        // Proved for the watertight test alone.
        compressed: accuracy == Accuracy::Watertight
            && buffers.get(Buffer::CompressedNodes).is_some(),
    }
}

/// One frame on the GPU.
pub type WgpuExecutor<'a> = DeviceExecutor<'a, FrameJob<'a>>;

/// One frame, as a device executor sees it.
#[derive(Debug)]
pub struct FrameJob<'a> {
    gpu: &'a Gpu,
    buffers: &'a mut Buffers,
    plan: Plan,
    features: RenderFeatures,
    wave: u32,
    /// In an exact frame that nothing awaits.
    undecided: Option<Undecided<'a>>,
}

impl FrameJob<'_> {
    /// A buffer, for what comes after the schedule.
    pub(super) fn output(&self, buffer: Buffer) -> Option<&wgpu::Buffer> {
        self.buffers.get(buffer)
    }

    /// All buffers.
    pub(super) fn buffers(&self) -> &Buffers {
        self.buffers
    }

    /// The most items that a grid may represent now.
    fn most(&self, counter: Counter) -> u32 {
        match counter {
            Counter::Pixels => self.plan.size().pixels(),
            Counter::ShadowRays => self.plan.shadow_room(),
            _ if self.wave == 0 => self.plan.slice_pixels() * self.plan.settings().samples,
            _ => self.plan.path_room(),
        }
    }
}

/// An executor over buffers that are reserved for the plan and hold the initial data of a frame.
pub(super) fn executor<'a>(
    gpu: &'a Gpu,
    pipelines: &'a Pipelines,
    buffers: &'a mut Buffers,
    plan: Plan,
    features: RenderFeatures,
    loops: LoopControl,
    undecided: Option<Undecided<'a>>,
) -> WgpuExecutor<'a> {
    let radiance = buffers.get(Buffer::Radiance).cloned();
    let frame = FrameJob { gpu, buffers, plan, features, wave: 0, undecided };
    let mut executor = DeviceExecutor::new(gpu, pipelines, frame, loops);
    // The values that the schedule expects to be zero.
    if let Some(radiance) = radiance.filter(|_| plan.outputs().shades()) {
        executor.encoder().clear_buffer(&radiance, 0, Some(plan.bytes(Buffer::Radiance)));
    }
    executor
}

impl Job for FrameJob<'_> {
    type Set = RayTracer;
    type Counters = Counters;
    type Error = RenderError;

    fn variant(&self) -> &RenderFeatures {
        &self.features
    }

    fn buffer(&self, buffer: Buffer) -> Option<&wgpu::Buffer> {
        self.buffers.get(buffer)
    }

    fn uniform(&self, uniform: Uniform) -> Option<BufferBinding<'_>> {
        self.buffers.uniform(uniform).map(wgpu::Buffer::as_entire_buffer_binding)
    }

    fn groups(&mut self) -> &mut BindGroups<RayTracer> {
        self.buffers.groups()
    }

    fn part<'b>(
        &self,
        _kernel: Kernel,
        bound: &Bound<RayTracer>,
        _view: u32,
        held: &'b wgpu::Buffer,
    ) -> BufferBinding<'b> {
        let whole = held.as_entire_buffer_binding();
        match bound.slot {
            Slot::Storage(storage) if storage.buffer == Buffer::Triangles => {
                let half = self.buffers.triangle_half(bound.part == 1);
                half.map_or(whole.clone(), |BufferBinding { offset, size, .. }| BufferBinding {
                    buffer: held,
                    offset,
                    size,
                })
            }
            _ => whole,
        }
    }

    fn pieces(&self, kernel: Kernel, _swapped: bool, pieces: &mut Vec<Piece>) {
        let grid = kernel.grid();
        let workgroups = match grid {
            Grid::One => 1,
            Grid::Each(counter) | Grid::Invocations(counter, _) | Grid::Few(counter, _) => {
                groups(self.gpu, kernel, grid.workgroups(self.most(counter)))
            }
        };
        pieces.push(Piece { block: None, workgroups, view: 0 });
    }

    fn round(&mut self, counter: Counter, rounds: u32) -> Round {
        match counter {
            Counter::PixelsLeft => {
                let slices = self.plan.slices();
                Round { goes_on: rounds < slices, submit: rounds > 0 && slices > 1 }
            }
            _ => {
                self.wave = rounds;
                Round { goes_on: rounds < self.plan.waves(), submit: false }
            }
        }
    }

    fn has_host_part(&self, kernel: Kernel) -> bool {
        self.undecided.is_some() && leaves(kernel)
    }

    fn finish_on_host(&mut self, kernel: Kernel) -> Result<(), RenderError> {
        match &mut self.undecided {
            Some(undecided) => {
                blocking(undecided.finish(Wait::Blocking, kernel, self.buffers, &self.plan))
            }
            None => Ok(()),
        }
    }

    fn is_void(&self, counters: &Counters) -> bool {
        counters[Counter::Overflow] != 0
    }
}

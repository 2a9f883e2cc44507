//! Renders frames, one at a time, in the same memory of a device.

use super::brought::{self, Brought};
use super::buffers::Buffers;
use super::executor::{WgpuExecutor, executor, features};
use super::room;
use super::undecided::Undecided;
use crate::error::RenderError;
use crate::frame::{FrameInput, FrameStats};
use crate::kernel::{Buffer, Counter, Kernel, RayTracer, first_counters};
use crate::layout::{Counters, FirstCost, FirstHit, Frame};
use crate::plan::{Plan, Room};
use crate::scene_data::SceneData;
use crate::schedule;
use crate::settings::{LightTransport, RenderSettings};
use splitplane_core::ray::Accuracy;
use splitplane_shaders::RenderFeatures;
use splitplane_wgpu::device::readback::{READBACK, read};
use splitplane_wgpu::device::{Awaited, LoopControl, Pipelines, Wait, blocking};
use splitplane_wgpu::{DeviceTree, Gpu, GpuError, Parity};
use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Instant;

/// Why the kernels of a device do not shade such frames; `None` where they do. The CPU may shade them and leave the rays to the device.
pub(crate) fn beyond_device(scene: &SceneData, settings: &RenderSettings) -> Option<RenderError> {
    if settings.light != LightTransport::Direct || settings.passes > 1 {
        return Some(RenderError::LightOnDevice);
    }
    scene.environment().map(|_| RenderError::EnvironmentMapOnDevice)
}

/// Whether a buffer can hold the picture of a frame and has the usage by which it is written, given with its name.
///
/// # Errors
/// [`RenderError::Target`], which says what is wrong with it.
pub(crate) fn check_target(
    target: &wgpu::Buffer,
    input: &FrameInput<'_>,
    (usage, name): (wgpu::BufferUsages, &str),
) -> Result<(), RenderError> {
    let wrong = |reason: String| Err(RenderError::Target { reason });
    let needed = 4 * u64::from(input.size.pixels());
    if !input.outputs.pixels {
        return wrong("is given, but no picture is asked for".into());
    }
    if target.size() < needed {
        return wrong(format!("has {} bytes; {needed} are needed", target.size()));
    }
    if !target.usage().contains(usage) {
        return wrong(format!("lacks the usage {name}"));
    }
    Ok(())
}

/// Renders frames on a device, of trees that are there. Pipelines are compiled when a frame first
/// needs them; buffers are kept between frames and grow only when a frame needs more than all
/// earlier ones.
///
/// The device sends 64 bytes per frame, and the outputs that are read. It receives 320 bytes per
/// frame, and the words of a scene that have changed since the last one.
#[derive(Debug)]
pub struct WgpuRenderer {
    pub(super) gpu: Arc<Gpu>,
    pub(super) pipelines: Pipelines,
    pub(super) buffers: Buffers,
    room: Room,
    pending: Option<Pending>,
    finished: Option<Plan>,
    /// For what comes back, between frames.
    pub(super) spare: Option<wgpu::Buffer>,
    brought: Brought,
    /// Whether bounds of error hold on the device.
    is_certain: bool,
}

/// A frame that was submitted.
#[derive(Debug)]
struct Pending {
    plan: Plan,
    frame: Frame,
    features: RenderFeatures,
    readback: wgpu::Buffer,
    mapped: Arc<AtomicU8>,
    submissions: u32,
    /// The last of them.
    last: Option<wgpu::SubmissionIndex>,
    /// Whether the outputs come back together with the counters.
    brings: bool,
    /// Rays that the CPU traced.
    redone: u64,
}

/// A frame that was submitted, before its end is asked for.
pub(super) struct Submitted {
    pub(super) plan: Plan,
    pub(super) frame: Frame,
    pub(super) features: RenderFeatures,
    pub(super) readback: wgpu::Buffer,
    pub(super) submissions: u32,
    pub(super) brings: bool,
    pub(super) redone: u64,
}

/// States of the mapping that a callback reports.
const WAITING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

impl WgpuRenderer {
    /// A renderer without memory yet.
    ///
    /// # Errors
    /// A device whose limits are below WebGPU's defaults, or that fails.
    pub fn new(gpu: Arc<Gpu>) -> Result<WgpuRenderer, RenderError> {
        gpu.check_limits()?;
        WgpuRenderer::under_any_limits(gpu)
    }

    /// As [`WgpuRenderer::new`], also where limits are below WebGPU's defaults: for tests of lists that outgrow a binding.
    #[doc(hidden)]
    pub fn under_any_limits(gpu: Arc<Gpu>) -> Result<WgpuRenderer, RenderError> {
        let pipelines = Pipelines::default();
        let buffers = Buffers::new(&gpu)?;
        let room = room::of(&gpu);
        Ok(WgpuRenderer {
            gpu,
            pipelines,
            buffers,
            room,
            pending: None,
            finished: None,
            spare: None,
            brought: Brought::default(),
            is_certain: false,
        })
    }

    /// Gives one kernel another text, or its own again: for tests that inject faults.
    #[doc(hidden)]
    pub fn replace_kernel(&mut self, kernel: Kernel, source: Option<String>) {
        self.pipelines.replace::<RayTracer>(kernel, source);
    }

    /// The same for what finishes the work of a kernel.
    #[doc(hidden)]
    pub fn replace_retry(&mut self, kernel: Kernel, source: Option<String>) {
        self.pipelines.replace_retry::<RayTracer>(kernel, source);
    }

    /// The same for what follows both, in exact frames.
    #[doc(hidden)]
    pub fn replace_settle(&mut self, kernel: Kernel, source: Option<String>) {
        self.pipelines.replace_settle::<RayTracer>(kernel, source);
    }

    /// Sets what a self-test found about the device. With [`Parity::Bitwise`] it may render frames of accuracy `exact`.
    pub fn set_parity(&mut self, parity: &Parity) {
        self.is_certain = parity.is_bitwise();
    }

    /// Limits the paths of a wave, for less memory; results do not depend on it. The limit is at
    /// most [`Room::GPU`] and what the device allows.
    pub fn limit_paths(&mut self, paths: u32) {
        self.room.paths = paths.clamp(1, room::of(&self.gpu).paths);
    }

    /// The limits of the queues of a frame of an accuracy.
    pub fn room(&self, accuracy: Accuracy) -> Room {
        Room { undecided: accuracy == Accuracy::Exact, ..self.room }
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The plan of a frame on this device.
    ///
    /// # Errors
    /// Settings out of range, too many lights, or a scene or picture that does not fit a buffer.
    pub fn plan(&self, input: &FrameInput<'_>) -> Result<Plan, RenderError> {
        let FrameInput { scene, size, settings, outputs, query, .. } = *input;
        let plan = Plan::new(scene, size, settings, outputs, self.room(query.accuracy))?;
        match beyond_device(scene, settings) {
            Some(error) => Err(error),
            None => Ok(plan),
        }
    }

    /// Renders a frame and waits for it. `tree` must be built over the mesh of `input`.
    ///
    /// # Errors
    /// Settings out of range, an appearance or a tree of another mesh, a device that fails.
    pub fn render(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        self.submit(tree, input)?;
        self.wait()
    }

    /// As [`WgpuRenderer::render`], with the picture in a buffer of the caller's, such as one that
    /// a window is drawn from: 4 bytes per pixel, row by row from the top left, red in the first
    /// byte, then green, blue and 255. It needs the usage `STORAGE`. `input` must ask for pixels.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render`]; an unsuitable buffer.
    pub fn render_into(
        &mut self,
        target: &wgpu::Buffer,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        self.submit_into(target, tree, input)?;
        self.wait()
    }

    /// Submits a frame and returns at once; [`WgpuRenderer::poll`] says when it is done. A frame
    /// that was submitted before and not polled is rendered, but whether it is void is not
    /// reported.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render`].
    pub fn submit(&mut self, tree: &DeviceTree, input: &FrameInput<'_>) -> Result<(), RenderError> {
        let plan = self.plan(input)?;
        self.buffers.set_target(None);
        self.begin(tree, input, plan, false)
    }

    /// As [`WgpuRenderer::submit`], for a host that wants all outputs that it asks for: they come back together
    /// with the counters, in one round trip, and [`WgpuRenderer::pixels`] and the like wait for nothing.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render`].
    pub fn submit_for_host(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<(), RenderError> {
        let plan = self.plan(input)?;
        self.buffers.set_target(None);
        self.begin(tree, input, plan, true)
    }

    /// As [`WgpuRenderer::submit`] into a buffer: see [`WgpuRenderer::render_into`].
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render_into`].
    pub fn submit_into(
        &mut self,
        target: &wgpu::Buffer,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<(), RenderError> {
        check_target(target, input, (wgpu::BufferUsages::STORAGE, "STORAGE"))?;
        let plan = self.plan(input)?;
        self.buffers.set_target(Some(target));
        self.begin(tree, input, plan, false)
    }

    fn begin(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
        plan: Plan,
        brings: bool,
    ) -> Result<(), RenderError> {
        self.forget();
        let frame = self.prepare(tree, input, &plan)?;
        let features = features(&plan, input.query.accuracy, &self.buffers);
        match input.query.accuracy {
            // The host waits for the device between waves.
            Accuracy::Exact => {
                let begun = (plan, frame, features, brings);
                blocking(self.begin_exact(Wait::Blocking, tree, input, begun))
            }
            _ => self.record(plan, frame, features, 0, brings),
        }
    }

    /// Nothing is under way or finished any more.
    pub(crate) fn forget(&mut self) {
        self.pending = None;
        self.finished = None;
        self.brought.clear();
    }

    /// Whether a frame was submitted and not polled to its end.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Makes space and uploads the scene; returns the frame's uniform.
    fn prepare(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
        plan: &Plan,
    ) -> Result<Frame, RenderError> {
        if input.query.accuracy == Accuracy::Exact && !self.is_certain {
            return Err(RenderError::ExactOnDevice);
        }
        let described = input.scene.triangles();
        for triangles in [input.mesh.len() as u32, tree.triangle_count()] {
            if triangles != described {
                return Err(RenderError::WrongMesh { described, triangles });
            }
        }
        self.buffers.set_tree(&self.gpu, tree);
        self.buffers.reserve(&self.gpu, plan)?;
        let (gpu, buffers) = (&self.gpu, &mut self.buffers);
        gpu.guard(|| buffers.upload_scene(gpu, input.scene))?;
        let tail_at = input.scene.words().len() as u32;
        buffers.copy_tail(gpu, u64::from(tail_at))?;
        Ok(Frame { tail_at, ..plan.frame(input.scene, &input.camera, &input.query) })
    }

    /// Records and submits the whole schedule, and requests the counters.
    fn record(
        &mut self,
        plan: Plan,
        frame: Frame,
        features: RenderFeatures,
        before: u32,
        brings: bool,
    ) -> Result<(), RenderError> {
        let readback = self.readback(&plan, brings)?;
        let gpu = Arc::clone(&self.gpu);
        let (buffers, pipelines) = (&mut self.buffers, &self.pipelines);
        let submissions = gpu.guard(|| -> Result<u32, RenderError> {
            buffers.upload(&gpu, &frame, &first_counters(plan.pixels()));
            let loops = LoopControl::Recorded;
            let mut executor = executor(&gpu, pipelines, buffers, plan, features, loops, None);
            schedule::frame(&mut executor, &plan)?;
            bring(&mut executor, &plan, brings, &readback);
            executor.submit()?;
            Ok(executor.submissions())
        })??;
        let submissions = before + submissions;
        self.request(Submitted { plan, frame, features, readback, submissions, brings, redone: 0 })
    }

    /// A buffer for what a frame sends back.
    pub(super) fn readback(
        &mut self,
        plan: &Plan,
        brings: bool,
    ) -> Result<wgpu::Buffer, RenderError> {
        let needed = if brings { brought::bytes(plan) } else { brought::COUNTERS };
        match self.spare.take().filter(|spare| spare.size() >= needed) {
            Some(spare) => Ok(spare),
            None => Ok(self.gpu.buffer("what a frame sends back", needed, READBACK)?),
        }
    }

    /// Requests what a frame sends back.
    pub(super) fn request(&mut self, submitted: Submitted) -> Result<(), RenderError> {
        let Submitted { plan, frame, features, readback, submissions, brings, redone } = submitted;
        let bytes = if brings { brought::bytes(&plan) } else { brought::COUNTERS };
        let last = self.gpu.last_submission();
        let mapped = Arc::new(AtomicU8::new(WAITING));
        let told = Arc::clone(&mapped);
        self.gpu.guard(|| {
            readback.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
                told.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
            });
        })?;
        self.pending = Some(Pending {
            plan,
            frame,
            features,
            readback,
            mapped,
            submissions,
            last,
            brings,
            redone,
        });
        Ok(())
    }

    /// The statistics of the frame if the device is done with it; `None` if it is not, or if a
    /// queue outgrew its capacity and the frame was submitted again in smaller slices. Never waits.
    ///
    /// # Errors
    /// The device's; a pixel whose rays do not fit. No frame is then pending any more.
    pub fn poll(&mut self) -> Result<Option<FrameStats>, RenderError> {
        let Some(pending) = self.pending.take() else {
            return Err(RenderError::NoOutput { what: "frame under way" });
        };
        self.gpu.poll()?;
        match pending.mapped.load(Ordering::Acquire) {
            // Only the callback holds the other reference; when wgpu has forgotten it, the buffer itself
            // knows whether it is mapped.
            WAITING if Arc::strong_count(&pending.mapped) > 1 => {
                self.pending = Some(pending);
                Ok(None)
            }
            WAITING | MAPPED => self.look(pending),
            _ => {
                self.gpu.check()?;
                Err(GpuError::Refused("the counters of a frame cannot be read".into()).into())
            }
        }
    }

    /// Waits until the frame that was submitted is done.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::poll`]; a device that takes longer than its time-out.
    pub fn wait(&mut self) -> Result<FrameStats, RenderError> {
        let mut since = Instant::now();
        let mut submissions = self.pending.as_ref().map_or(0, |pending| pending.submissions);
        loop {
            // For this frame alone: later work, such as the build for the next one, goes on.
            let last = self.pending.as_ref().and_then(|pending| pending.last.clone());
            self.gpu.wait_for(last)?;
            if let Some(stats) = self.poll()? {
                return Ok(stats);
            }
            // It was submitted again, or another thread is about to call back.
            let now = self.pending.as_ref().map_or(0, |pending| pending.submissions);
            if now > submissions {
                (since, submissions) = (Instant::now(), now);
            } else if since.elapsed() > self.gpu.timeout() {
                let seconds = self.gpu.timeout().as_secs();
                return Err(GpuError::TimedOut { seconds }.into());
            }
            std::thread::yield_now();
        }
    }

    /// As [`WgpuRenderer::submit_for_host`], and waits for the frame without blocking, also between the waves of one of accuracy `exact`.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render`].
    pub async fn render_for_host_async(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<FrameStats, RenderError> {
        let mut awaited = Awaited::begin(Arc::clone(&self.gpu));
        let submitted = match input.query.accuracy {
            Accuracy::Exact => self.submit_exact_for_host(tree, input).await,
            _ => self.submit_for_host(tree, input),
        };
        awaited.renew();
        self.finish(awaited, submitted).await
    }

    async fn submit_exact_for_host(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
    ) -> Result<(), RenderError> {
        let plan = self.plan(input)?;
        self.buffers.set_target(None);
        self.forget();
        let frame = self.prepare(tree, input, &plan)?;
        let features = features(&plan, input.query.accuracy, &self.buffers);
        self.begin_exact(Wait::Yielding, tree, input, (plan, frame, features, true)).await
    }

    /// As [`WgpuRenderer::wait`], without blocking. Dropped before its end, it leaves the frame as it is.
    ///
    /// # Errors
    /// As for [`WgpuRenderer::wait`].
    pub async fn wait_async(&mut self) -> Result<FrameStats, RenderError> {
        self.finish(Awaited::begin(Arc::clone(&self.gpu)), Ok(())).await
    }

    /// The outcome of a frame that was submitted, or of trying to.
    async fn finish(
        &mut self,
        mut awaited: Awaited,
        submitted: Result<(), RenderError>,
    ) -> Result<FrameStats, RenderError> {
        let done = match submitted {
            Ok(()) => self.wait_for_end(&mut awaited).await,
            Err(error) => Err(error),
        };
        match done {
            Err(error @ RenderError::Gpu(_)) => Err(awaited.cause(error).await),
            done => done,
        }
    }

    async fn wait_for_end(&mut self, awaited: &mut Awaited) -> Result<FrameStats, RenderError> {
        let mut submissions = self.pending.as_ref().map_or(0, |pending| pending.submissions);
        awaited.give_way().await?;
        loop {
            if let Some(stats) = self.poll()? {
                awaited.settle().await?;
                return Ok(stats);
            }
            // It was submitted again.
            let now = self.pending.as_ref().map_or(0, |pending| pending.submissions);
            if now > submissions {
                awaited.renew();
                submissions = now;
            }
            awaited.pause().await?;
        }
    }

    /// Reads the counters: the frame is done, or must be repeated.
    fn look(&mut self, pending: Pending) -> Result<Option<FrameStats>, RenderError> {
        let Pending { plan, frame, features, readback, submissions, brings, redone, .. } = pending;
        let bytes = if brings { brought::bytes(&plan) } else { brought::COUNTERS };
        let refused = |error: wgpu::MapRangeError| GpuError::Refused(error.to_string());
        self.gpu.note_readback(bytes);
        let view = readback.get_mapped_range(..bytes).map_err(refused)?;
        let counters: Counters = bytemuck::pod_read_unaligned(&view[..size_of::<Counters>()]);
        let is_void = counters[Counter::Overflow] != 0;
        if brings && !is_void {
            self.brought.take(&plan, &view);
        }
        drop(view);
        self.gpu.guard(|| readback.unmap())?;
        self.spare = Some(readback);
        if !is_void {
            self.finished = Some(plan);
            return Ok(Some(FrameStats { redone, ..FrameStats::new(plan, &counters, None) }));
        }
        let (plan, frame) = halved(plan, frame)?;
        self.record(plan, frame, features, submissions, brings)?;
        Ok(None)
    }

    /// Calls `run` with an executor over fresh contents that submits every step and whose buffers
    /// can be read in between: for [`splitplane_core::build::lockstep::Lockstep`].
    ///
    /// # Errors
    /// As for [`WgpuRenderer::render`].
    pub fn with_executor<T>(
        &mut self,
        tree: &DeviceTree,
        input: &FrameInput<'_>,
        plan: &Plan,
        run: impl FnOnce(WgpuExecutor<'_>) -> T,
    ) -> Result<T, RenderError> {
        self.forget();
        self.buffers.set_target(None);
        let frame = self.prepare(tree, input, plan)?;
        let features = features(plan, input.query.accuracy, &self.buffers);
        let gpu = Arc::clone(&self.gpu);
        let is_exact = input.query.accuracy == Accuracy::Exact;
        let undecided = is_exact.then(|| Undecided::new(&gpu, tree, *input, frame));
        let (buffers, pipelines) = (&mut self.buffers, &self.pipelines);
        let out = gpu.guard(|| {
            buffers.upload(&gpu, &frame, &first_counters(plan.pixels()));
            buffers.fill(&gpu, plan);
            let loops = LoopControl::ReadCounters;
            run(executor(&gpu, pipelines, buffers, *plan, features, loops, undecided))
        })?;
        Ok(out)
    }

    /// The pixels for a screen, from the top left: red in the low byte, green, blue, 255; 0 in
    /// place of 255 where the driver did not follow a ray to its end. Waits for the device.
    ///
    /// # Errors
    /// No finished frame with pixels; a device that fails.
    pub fn pixels(&self) -> Result<Vec<u32>, RenderError> {
        self.output(Buffer::Pixels, "picture").map(Cow::into_owned)
    }

    /// The buffer of the picture, on the device, with the usages `STORAGE`, `COPY_SRC` and `COPY_DST`;
    /// that of the caller where it was given. `None` before a frame with pixels.
    pub fn pixel_buffer(&self) -> Option<&wgpu::Buffer> {
        self.buffers.get(Buffer::Pixels)
    }

    /// Linear radiance by pixel; the fourth component is the number of rays that the driver did not
    /// follow to their end. Waits for the device.
    ///
    /// # Errors
    /// No finished frame with light; a device that fails.
    pub fn radiance(&self) -> Result<Vec<[f32; 4]>, RenderError> {
        self.output(Buffer::Radiance, "radiance").map(Cow::into_owned)
    }

    /// The hit of the first ray of each pixel; `triangle` is `u32::MAX - 1` where the driver did
    /// not follow it to its end. Waits for the device.
    ///
    /// # Errors
    /// No finished frame with first hits; a device that fails.
    pub fn first_hits(&self) -> Result<Vec<FirstHit>, RenderError> {
        self.output(Buffer::FirstHits, "record of first hits").map(Cow::into_owned)
    }

    /// The cost of the first ray of each pixel. The visits of nodes are those of this device:
    /// distances to planes are widened, not rounded the same everywhere. Waits for the device.
    ///
    /// # Errors
    /// No finished frame with first costs; a device that fails.
    pub fn first_costs(&self) -> Result<Vec<FirstCost>, RenderError> {
        self.output(Buffer::FirstCosts, "record of first costs").map(Cow::into_owned)
    }

    /// An output, in place where it came along with the frame.
    pub(crate) fn output<T: bytemuck::AnyBitPattern>(
        &self,
        buffer: Buffer,
        what: &'static str,
    ) -> Result<Cow<'_, [T]>, RenderError> {
        if let Some(words) = self.brought.words(buffer) {
            return Ok(Cow::Borrowed(bytemuck::cast_slice(words)));
        }
        let bytes = self.finished.map_or(0, |plan| plan.bytes(buffer));
        match self.buffers.get(buffer) {
            Some(held) if bytes > 0 => {
                let bytes = read(&self.gpu, held, 0, bytes)?;
                let elements = bytes.chunks_exact(size_of::<T>());
                Ok(Cow::Owned(elements.map(bytemuck::pod_read_unaligned).collect()))
            }
            _ => Err(RenderError::NoOutput { what }),
        }
    }

    /// Bytes on the device that are held between frames, the tree's not counted.
    pub fn bytes(&self) -> u64 {
        self.buffers.bytes()
    }

    /// Pipelines compiled so far.
    pub fn pipelines(&self) -> usize {
        self.pipelines.count()
    }
}

/// Records that counters, and the outputs where the host wants them, are copied to what is read back.
pub(super) fn bring(
    executor: &mut WgpuExecutor<'_>,
    plan: &Plan,
    brings: bool,
    readback: &wgpu::Buffer,
) {
    if let Some(counters) = executor.job().output(Buffer::Counters).cloned() {
        let bytes = brought::COUNTERS;
        executor.encoder().copy_buffer_to_buffer(&counters, 0, readback, 0, bytes);
    }
    for (buffer, place) in brought::outputs(plan).filter(|_| brings) {
        if let Some(held) = executor.job().output(buffer).cloned() {
            let (at, bytes) = (place.start, place.end - place.start);
            executor.encoder().copy_buffer_to_buffer(&held, 0, readback, at, bytes);
        }
    }
}

/// The same frame in slices of half as many pixels.
pub(super) fn halved(plan: Plan, frame: Frame) -> Result<(Plan, Frame), RenderError> {
    let too_deep =
        RenderError::PixelTooDeep { paths: plan.path_room(), shadow_rays: plan.shadow_room() };
    let plan = plan.halved().ok_or(too_deep)?;
    Ok((plan, Frame { slice_pixels: plan.slice_pixels(), ..frame }))
}

//! A device, its queue and its limits: opened headless, or borrowed from a host.

use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

use splitplane_shaders::{Part, for_software, with_workgroup_stacks};

use crate::device::bounded::Bounds;
use crate::device::compiler::{Compiler, Opening};
use crate::device::deferred::{Deferred, Mark};
use crate::device::driver;
use crate::device::health::Health;
use crate::device::host;
use crate::device::needs;
use crate::device::patience::Patience;
use crate::device::traffic::{Counted, Traffic};
use crate::device::wait::{Bell, Wait, blocking};
use crate::error::GpuError;
use crate::options::{OpenOptions, RayStack};

/// Polling interval for a device.
const POLL_PAUSE: Duration = Duration::from_micros(100);

/// Bytes of the least buffer.
pub(crate) const LEAST_BUFFER: u64 = 16;

/// A device, ready for work. Clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    info: wgpu::AdapterInfo,
    limits: wgpu::Limits,
    /// Whether it counts as software.
    software: bool,
    /// Where rays keep their stacks.
    ray_stack: RayStack,
    health: Arc<Health>,
    timeout: Duration,
    /// The driver's limits for pipelines, and the pipelines that exceeded them; shared by clones.
    compiler: Arc<Compiler>,
    /// The last submission that is complete; shared by clones. While it is held nobody else submits.
    last: Arc<Mutex<Option<wgpu::SubmissionIndex>>>,
    /// What crosses between host and device; shared by clones.
    traffic: Arc<Counted>,
    /// What a browser has not told yet; shared by clones.
    deferred: Arc<Deferred>,
    /// Longer buffers find no memory, where a test says so; shared by clones.
    planted_memory: Arc<AtomicU64>,
}

impl Gpu {
    /// A device that belongs to nobody else, so its callbacks are free to use.
    pub(crate) fn own(device: wgpu::Device, queue: wgpu::Queue, options: &OpenOptions) -> Gpu {
        let mut gpu = Gpu::borrow(device, queue);
        gpu.timeout = options.timeout.unwrap_or(gpu.timeout);
        gpu.compiler = Arc::new(Compiler::new(driver::bounds(options, &gpu.info)));
        gpu.ray_stack = options.ray_stack.unwrap_or(gpu.ray_stack);
        gpu.health.watch(&gpu.device);
        gpu
    }

    /// A device that a host owns.
    ///
    /// Sets nothing on the device: the host's callbacks for losses and uncaptured errors stay.
    /// What this crate does runs inside error scopes of the calling thread and comes back as
    /// [`GpuError`]; whether the device is lost is found out by asking it. Waiting polls the
    /// device, so callbacks of the host may run on the waiting thread.
    ///
    /// The device needs WebGPU's default limits, which [`Gpu::check_limits`] checks.
    pub fn borrow(device: wgpu::Device, queue: wgpu::Queue) -> Gpu {
        let info = device.adapter_info();
        let limits = device.limits();
        let timeout = driver::default_timeout(info.device_type);
        let compiler = Arc::new(Compiler::new(driver::bounds(&OpenOptions::default(), &info)));
        let (health, last, traffic, deferred) = Default::default();
        let software = info.device_type == wgpu::DeviceType::Cpu;
        let ray_stack = driver::ray_stack(&info);
        let planted_memory = Arc::new(AtomicU64::new(u64::MAX));
        Gpu {
            device,
            queue,
            info,
            limits,
            software,
            ray_stack,
            health,
            timeout,
            compiler,
            last,
            traffic,
            deferred,
            planted_memory,
        }
    }

    /// The same device under another name: browsers do not give it to wgpu.
    #[cfg(target_family = "wasm")]
    pub(crate) fn named(mut self, name: &str, options: &OpenOptions) -> Gpu {
        name.clone_into(&mut self.info.name);
        self.ray_stack = options.ray_stack.unwrap_or_else(|| driver::ray_stack(&self.info));
        self
    }

    /// The same device with another time-out.
    pub fn with_timeout(self, timeout: Duration) -> Gpu {
        Gpu { timeout, ..self }
    }

    /// The same device with the stacks of rays elsewhere; see [`OpenOptions::ray_stack`]. For borrowed devices, before anything is
    /// made of it.
    pub fn with_ray_stack(self, ray_stack: RayStack) -> Gpu {
        Gpu { ray_stack, ..self }
    }

    /// The same device with other limits on what its driver may take to compile; see
    /// [`OpenOptions::driver_time`] and [`OpenOptions::driver_memory`].
    pub fn with_driver_limits(self, time: Duration, memory: u64) -> Gpu {
        Gpu { compiler: Arc::new(Compiler::new(Bounds { time, memory })), ..self }
    }

    /// The same device, with this function called before the driver compiles a pipeline, in the
    /// same thread: for tests that simulate a driver which takes too much. It receives the
    /// pipeline's label.
    #[doc(hidden)]
    pub fn with_planted_driver(self, planted: impl Fn(&str) + Send + Sync + 'static) -> Gpu {
        let compiler = Compiler::new(*self.compiler.bounds()).planted(planted);
        Gpu { compiler: Arc::new(compiler), ..self }
    }

    /// From now on, buffers of more bytes are refused as by a driver that has no memory for them: for tests.
    #[doc(hidden)]
    pub fn plant_memory(&self, most: u64) {
        self.planted_memory.store(most, Ordering::Relaxed);
    }

    /// From now on, this is called whenever a buffer was made, with that buffer there: for tests that ask the device what it holds then. The first one
    /// stays.
    #[doc(hidden)]
    pub fn observe_buffers(&self, observer: impl Fn() + Send + Sync + 'static) {
        self.traffic.observe(observer);
    }

    /// Pipelines made so far, by this device and its clones.
    pub fn pipelines_made(&self) -> u64 {
        self.compiler.made()
    }

    /// From now on, until the returned value is dropped, the limit of time holds for all pipelines
    /// together.
    pub(crate) fn opening(&self) -> Opening<'_> {
        self.compiler.opening()
    }

    /// How long to wait before the device counts as hanging.
    pub fn timeout(&self) -> Duration {
        self.timeout
    }

    /// The device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// The adapter.
    pub fn info(&self) -> &wgpu::AdapterInfo {
        &self.info
    }

    /// Whether the adapter is software: it runs shaders on the CPU.
    pub fn is_software(&self) -> bool {
        self.software
    }

    /// Where rays keep their stacks.
    pub fn ray_stack(&self) -> RayStack {
        self.ray_stack
    }

    /// The parts of a shader as this device is given them.
    #[doc(hidden)]
    pub fn parts(&self, parts: Cow<'static, [Part]>) -> Cow<'static, [Part]> {
        let parts = if self.software { for_software(parts) } else { parts };
        match self.ray_stack {
            RayStack::Private => parts,
            RayStack::Workgroup => with_workgroup_stacks(parts),
        }
    }

    /// The same device, given as many workgroups as hardware is: for tools that count what kernels do there.
    #[doc(hidden)]
    pub fn as_hardware(self) -> Gpu {
        Gpu { software: false, ..self }
    }

    /// The limits of the device.
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// Whether kernels can be timed.
    pub fn has_timestamps(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Whether the device's limits suffice. An opened device has passed this already.
    ///
    /// # Errors
    /// The first limit that is worse than WebGPU's default.
    pub fn check_limits(&self) -> Result<(), GpuError> {
        needs::check(&self.limits)
    }

    /// Whether the device works.
    ///
    /// # Errors
    /// A lost device; the first error since the last check that no error scope caught. On borrowed
    /// devices such errors go to the host.
    pub fn check(&self) -> Result<(), GpuError> {
        self.health.check_lost(&self.device)?;
        self.health.take_uncaptured()
    }

    /// Runs calls of wgpu and returns the first error that they raise on this thread. wgpu reports
    /// nothing for calls on a lost device; [`Gpu::check`] does.
    ///
    /// A browser tells errors later: there this returns `Ok`, and the asynchronous call that the work is part of
    /// ends with the error.
    ///
    /// # Errors
    /// A lost device, no memory, or anything that wgpu or the driver refused.
    pub fn guard<R>(&self, work: impl FnOnce() -> R) -> Result<R, GpuError> {
        self.guard_as(work, |error| error)
    }

    /// As [`Gpu::guard`], with the error of what is refused made more precise.
    pub(crate) fn guard_as<R>(
        &self,
        work: impl FnOnce() -> R,
        precise: impl FnOnce(GpuError) -> GpuError + Send + 'static,
    ) -> Result<R, GpuError> {
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let out = work();
        let scopes = [validation, memory, internal];
        #[cfg(target_family = "wasm")]
        {
            let scopes = scopes.map(|scope| Box::pin(scope.pop()));
            self.deferred.add(Box::pin(async move {
                let mut first = None;
                for scope in scopes {
                    first = first.or(scope.await);
                }
                first.map(|error| precise(GpuError::from_wgpu(error)))
            }));
            Ok(out)
        }
        #[cfg(not(target_family = "wasm"))]
        {
            let errors = scopes.map(|scope| pollster::block_on(scope.pop()));
            let Some(error) = errors.into_iter().flatten().next() else { return Ok(out) };
            // A device that goes away leaves invalid objects, which are refused later.
            self.health.check_lost(&self.device)?;
            Err(precise(GpuError::from_wgpu(error)))
        }
    }

    /// Where a piece of work begins, for [`Gpu::settled`].
    pub(crate) fn mark(&self) -> Mark {
        self.deferred.mark()
    }

    /// Has everything since any mark refused with this error, as a browser may tell it.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn refuse_later(&self, error: GpuError) {
        self.deferred.refuse(error);
    }

    /// Has all work wait for this check, as it may in a browser.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn tell_later(&self, check: crate::device::deferred::Check) {
        self.deferred.delay(check);
    }

    /// Forgets what was refused.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn forget_refused(&self) {
        self.deferred.forget();
    }

    /// Whether it is known how all that was guarded since a mark went. Only in a browser it may not be.
    ///
    /// # Errors
    /// What was refused since.
    pub(crate) fn settled(&self, from: Mark) -> Result<bool, GpuError> {
        self.deferred.settled(from)
    }

    /// Waits until it is known how all that was guarded since a mark went.
    ///
    /// # Errors
    /// What was refused since; a lost device; a wait that is longer than the time-out, or not possible.
    pub(crate) async fn settle(&self, wait: Wait, from: Mark) -> Result<(), GpuError> {
        // Most often it is told at the next turn of the browser's loop, long before the next tick.
        for _ in 0..4 {
            if self.settled(from)? {
                return Ok(());
            }
            wait.turn().await;
        }
        let mut patience = Patience::new(self.timeout);
        while !self.settled(from)? {
            self.check()?;
            if patience.is_over() {
                return Err(patience.exceeded());
            }
            wait.pause(POLL_PAUSE, &Bell::default()).await?;
        }
        Ok(())
    }

    /// The error of work that failed, which is the loss of the device where there is one: a browser refuses what was under way
    /// before it tells the loss.
    #[cfg(target_family = "wasm")]
    pub(crate) async fn cause<E: From<GpuError>>(&self, error: E) -> E {
        for _ in 0..5 {
            super::web::tick().await;
            if let Err(lost @ GpuError::Lost { .. }) = self.health.check_lost(&self.device) {
                return lost.into();
            }
        }
        error
    }

    /// The error of work that failed.
    #[cfg(not(target_family = "wasm"))]
    pub(crate) async fn cause<E: From<GpuError>>(&self, error: E) -> E {
        error
    }

    /// A buffer of at least `bytes` bytes, a multiple of 4.
    ///
    /// # Errors
    /// More than the device's limits or its memory allow; a lost device.
    pub fn buffer(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let most = self.limits.max_storage_buffer_binding_size;
        // Where the buffer itself is too large, that is the error.
        let unbound = bytes > most && bytes <= self.limits.max_buffer_size;
        if usage.contains(wgpu::BufferUsages::STORAGE) && unbound {
            let (limit, what) = ("max_storage_buffer_binding_size", label.to_owned());
            return Err(GpuError::Limit { what, limit, needed: bytes, allowed: most });
        }
        self.long_buffer(label, bytes, usage)
    }

    /// As [`Gpu::buffer`], for a list that several bindings may hold.
    pub(crate) fn long_buffer(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let most = self.limits.max_buffer_size;
        let size = bytes.max(LEAST_BUFFER).checked_next_multiple_of(4);
        let size = size.filter(|size| *size <= most).ok_or_else(|| GpuError::Limit {
            what: label.to_owned(),
            limit: "max_buffer_size",
            needed: bytes,
            allowed: most,
        })?;
        let description =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        if size > self.planted_memory.load(Ordering::Relaxed) {
            return Err(GpuError::OutOfMemory { what: label.to_owned(), needed: size });
        }
        let what = label.to_owned();
        let precise = move |error| match error {
            GpuError::OutOfMemory { .. } => GpuError::OutOfMemory { what, needed: size },
            other => other,
        };
        let made = self.guard_as(|| self.device.create_buffer(&description), precise);
        self.health.check_lost(&self.device)?;
        self.traffic.buffer();
        made
    }

    /// Sends bytes to a buffer with the usage `COPY_DST`, ahead of the next submission, and counts them. What is
    /// refused goes to the error scopes of this thread.
    pub fn write(&self, buffer: &wgpu::Buffer, at: u64, bytes: &[u8]) {
        self.traffic.upload(bytes.len() as u64);
        self.queue.write_buffer(buffer, at, bytes);
    }

    /// Counts bytes that were copied to a mapped buffer for the host.
    pub fn note_readback(&self, bytes: u64) {
        self.traffic.readback(bytes);
    }

    /// What has crossed between host and device so far through this crate and the renderer, by this device and
    /// its clones: what is uploaded for single batches of rays is not counted.
    pub fn traffic(&self) -> Traffic {
        self.traffic.so_far()
    }

    /// Compiles a compute pipeline with an automatic layout.
    ///
    /// The driver compiles in a thread of its own, which is waited for within the limits of
    /// [`OpenOptions::driver_time`] and [`OpenOptions::driver_memory`]. Beyond them the thread is
    /// left to itself, since nothing can end it; as long as it runs, the same pipeline is refused
    /// at once.
    ///
    /// # Errors
    /// Text that is no valid WGSL for this device; a driver that takes too much; a lost device.
    pub fn pipeline(&self, label: &str, source: &str) -> Result<wgpu::ComputePipeline, GpuError> {
        self.compile(label, source, None)
    }

    /// Compiles a compute pipeline whose only bind group has this layout. As [`Gpu::pipeline`].
    ///
    /// # Errors
    /// As for [`Gpu::pipeline`].
    pub fn pipeline_with_layout(
        &self,
        label: &str,
        source: &str,
        layout: &wgpu::BindGroupLayout,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        self.compile(label, source, Some(layout))
    }

    /// Compiles within the limits of the driver.
    fn compile(
        &self,
        label: &str,
        source: &str,
        layout: Option<&wgpu::BindGroupLayout>,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        let (gpu, layout) = (self.clone(), layout.cloned());
        self.compiler.compile(label, source, move |label, source| {
            gpu.compile_unbounded(label, source, layout.as_ref())
        })
    }

    /// Compiles here and now, however long it takes.
    fn compile_unbounded(
        &self,
        label: &str,
        source: &str,
        layout: Option<&wgpu::BindGroupLayout>,
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        let shader = label.to_owned();
        let precise = move |error| match error {
            GpuError::Refused(reason) => GpuError::Shader { shader, reason },
            other => other,
        };
        let make = || {
            let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            let layout = layout.map(|layout| {
                self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(label),
                    bind_group_layouts: &[Some(layout)],
                    ..Default::default()
                })
            });
            self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(label),
                layout: layout.as_ref(),
                module: &module,
                entry_point: Some(splitplane_shaders::ENTRY_POINT),
                // Kernels write what they read; a test runs each with the memory of its workgroups full of other words.
                compilation_options: wgpu::PipelineCompilationOptions {
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        };
        let made = self.guard_as(make, precise);
        self.health.check_lost(&self.device)?;
        made
    }

    /// Submits commands.
    ///
    /// # Errors
    /// Commands that are refused; a lost device.
    pub fn submit(
        &self,
        commands: impl IntoIterator<Item = wgpu::CommandBuffer>,
    ) -> Result<wgpu::SubmissionIndex, GpuError> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let submitted = self.guard(|| self.queue.submit(commands));
        self.health.check_lost(&self.device)?;
        let submitted = submitted?;
        *last = Some(submitted.clone());
        Ok(submitted)
    }

    /// Runs the callbacks of finished work, without waiting. True when nothing is left to do.
    ///
    /// # Errors
    /// As for [`Gpu::check`].
    pub fn poll(&self) -> Result<bool, GpuError> {
        let polled = self.health.poll(&self.device, wgpu::PollType::Poll)?;
        self.check()?;
        Ok(polled.is_ok_and(|status| status.is_queue_empty()))
    }

    /// Becomes true, once polled, when all that was submitted so far is done.
    pub(crate) fn submitted_work_done(&self) -> (Arc<AtomicBool>, Bell) {
        let (done, bell) = <(Arc<AtomicBool>, Bell)>::default();
        let (told, rung) = (Arc::clone(&done), bell.clone());
        self.queue.on_submitted_work_done(move || {
            told.store(true, Ordering::Release);
            rung.ring();
        });
        (done, bell)
    }

    /// Waits until everything submitted through [`Gpu::submit`] so far is done.
    ///
    /// # Errors
    /// A lost device, or one that takes longer than the time-out; what [`Gpu::check`] finds.
    pub fn wait(&self) -> Result<(), GpuError> {
        // The submission is named, since wgpu panics when it waits for "the most recent" one while
        // another thread is submitting.
        self.wait_for(self.last_submission())
    }

    /// The last submission through [`Gpu::submit`], by this device and its clones.
    pub fn last_submission(&self) -> Option<wgpu::SubmissionIndex> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until a submission is done, or everything submitted so far when `None`.
    ///
    /// # Errors
    /// As for [`Gpu::wait`].
    pub fn wait_for(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        Wait::Blocking.check()?;
        self.check()?;
        // In one piece: wgpu panics, and forgets callbacks, when a wait runs out of time just before
        // another thread's submission or poll finds the queue empty.
        let wait =
            wgpu::PollType::Wait { submission_index: submission, timeout: Some(self.timeout) };
        let polled = self.health.poll(&self.device, wait)?;
        self.check()?;
        match polled {
            Ok(_) => Ok(()),
            Err(wgpu::PollError::Timeout) => {
                Err(GpuError::TimedOut { seconds: self.timeout.as_secs() })
            }
            Err(error) => Err(GpuError::Refused(error.to_string())),
        }
    }

    /// The first `bytes` bytes of a buffer that can be mapped for reading and is not mapped.
    ///
    /// # Errors
    /// As for [`Gpu::wait`]; a buffer that cannot be read.
    pub fn read_mapped(&self, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
        blocking(self.read_mapped_by(Wait::Blocking, self.mark(), buffer, bytes))
    }

    /// As [`Gpu::read_mapped`], for work that began at a mark.
    pub(crate) async fn read_mapped_by(
        &self,
        wait: Wait,
        from: Mark,
        buffer: &wgpu::Buffer,
        bytes: u64,
    ) -> Result<Vec<u8>, GpuError> {
        let size = buffer.size();
        let mapped = bytes.checked_next_multiple_of(4).filter(|mapped| *mapped <= size);
        let mapped = mapped.ok_or_else(|| {
            GpuError::Refused(format!("{bytes} bytes are to be read of a buffer of {size}"))
        })?;
        if mapped == 0 {
            return self.check().map(|()| Vec::new());
        }
        let ready = match self.map(wait, buffer, mapped).await {
            Ok(()) => self.settle(wait, from).await,
            // What was refused before is why.
            Err(error) => Err(self.settle(wait, from).await.err().unwrap_or(error)),
        };
        let out = ready.and_then(|()| {
            let view = buffer.get_mapped_range(..mapped);
            let view = view.map_err(|error| GpuError::Refused(error.to_string()))?;
            self.note_readback(mapped);
            host::copied(&view[..bytes as usize])
        });
        // Where mapping failed there may be nothing to undo.
        let unmapped = self.guard(|| buffer.unmap());
        let out = out?;
        unmapped.map(|()| out)
    }

    /// Maps the start of a buffer and waits until it is mapped.
    async fn map(&self, wait: Wait, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
        wait.check()?;
        let mut patience = Patience::new(self.timeout);
        let (send, receive) = mpsc::channel();
        let bell = Bell::default();
        let mapped = bell.clone();
        self.guard(|| {
            buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
                // The receiver is gone if waiting failed.
                let _ = send.send(result);
                mapped.ring();
            });
        })?;
        if wait.blocks() {
            self.wait()?;
        } else {
            // Others have their turn with every read, however fast the device is.
            self.poll()?;
            wait.pause(POLL_PAUSE, &bell).await?;
        }
        // The callback comes with the last submission that uses the buffer. That may be one of the
        // host's own, or another thread that polls may be about to call back.
        loop {
            match receive.try_recv() {
                Ok(Ok(())) => return Ok(()),
                Ok(Err(_)) => {
                    self.check()?;
                    return Err(GpuError::Refused("the buffer cannot be mapped".into()));
                }
                // The callback was forgotten in a panic of wgpu's: the buffer knows whether it is
                // mapped.
                Err(mpsc::TryRecvError::Disconnected) => return self.check(),
                Err(mpsc::TryRecvError::Empty) if patience.is_over() => {
                    return Err(patience.exceeded());
                }
                Err(mpsc::TryRecvError::Empty) => {
                    self.poll()?;
                    wait.pause(POLL_PAUSE, &bell).await?;
                }
            }
        }
    }
}

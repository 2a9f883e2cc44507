//! A build under way: submitted, and polled later.

mod finish;

pub use finish::DeviceBuild;

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use splitplane_core::backend::BuildOptions;
use splitplane_core::build::schedule;
use splitplane_core::cancel::go_on;
use splitplane_core::config::Planes;
use splitplane_core::error::BuildError;
use splitplane_core::kernel::{Buffer, TreeBuilder};
use splitplane_core::watch::{Progress, Stage, Watch};

use super::buffers::{Buffers, POOL_AT_START};
use super::capacities::Capacities;
use super::executor::{Build, WgpuExecutor, first_counters};
use super::middle_stage::MiddleStage;
use super::shared::{Pooled, Shared};
use super::source::Source;
use crate::device::deferred::Mark;
use crate::device::gpu::Gpu;
use crate::device::patience::Patience;
use crate::device::profile::Profile;
use crate::device::wait::{Bell, Wait, blocking};
use crate::device::{LoopControl, Pipelines};
use crate::error::GpuError;

/// The device work of a build.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Submissions: one for a build that fits its capacities.
    pub submissions: u32,
    /// How often the host waited for bytes from the device.
    pub readbacks: u32,
    /// Dispatches.
    pub dispatches: u32,
    /// Workgroups of the largest dispatch of the schedule.
    pub most_workgroups: u32,
    /// Builds restarted with greater capacities, or without a middle stage that was void.
    pub repeats: u32,
    /// What became of the middle stage.
    pub middle_stage: MiddleStage,
}

/// A build that was submitted and may not be done. Old trees can be queried meanwhile: no buffer of
/// theirs is touched.
#[derive(Debug)]
pub struct PendingBuild {
    shared: Arc<Shared>,
    buffers: Option<Buffers>,
    options: BuildOptions<'static>,
    planes: Planes,
    capacities: Capacities,
    first_index: u32,
    tree_to_host: bool,
    /// The copy of a mesh that is on the device; goes with the first submission.
    mesh_copy: Option<wgpu::CommandBuffer>,
    /// Levels recorded beyond those of the last such build.
    spare_levels: u32,
    swapped: bool,
    mapped: Arc<AtomicU8>,
    /// Rung when the mapping is reported.
    bell: Bell,
    /// Where it begins, in the order of what the device checks.
    from: Mark,
    profile: Option<Profile<TreeBuilder>>,
    effort: Effort,
}

/// States of the mapping that a callback reports.
const WAITING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

impl PendingBuild {
    /// Uploads the mesh, or has it copied, and submits the build.
    pub(crate) fn submit(
        shared: Arc<Shared>,
        source: &Source<'_>,
        options: &BuildOptions<'_>,
        tree_to_host: bool,
        profiled: bool,
    ) -> Result<PendingBuild, BuildError> {
        options.config.validate()?;
        let preset = options.config.preset();
        let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
        let gpu = &shared.gpu;
        let from = gpu.mark();
        if let Source::Device(mesh) = source {
            mesh.check().map_err(|reason| BuildError::InvalidMesh { reason })?;
        }
        let triangles = source.triangles();
        let [position_bytes, index_bytes] = source.bytes();
        let pooled = shared.take_buffers();
        let was_pooled = pooled.is_some();
        let input_bytes = position_bytes + index_bytes;
        let estimate = Capacities::estimate(triangles, &options.config).with_middle_stage();
        let mut estimate = Capacities { input_bytes, ..estimate };
        let mut capacities = estimate;
        let mut levels = options.config.max_depth + 1;
        let mut spare_levels = 0;
        let mut effort = Effort::default();
        if estimate.middle {
            effort.middle_stage = MiddleStage::Finished;
        }
        let buffers = match pooled {
            Some(pooled) => {
                // The capacities that an earlier build needed are there already.
                capacities = capacities.union(pooled.capacities);
                capacities.triangles = triangles;
                if (pooled.triangles, pooled.config) == (triangles, options.config) {
                    spare_levels = pooled.spare_levels;
                    levels = levels.min(pooled.levels + spare_levels);
                    capacities.by_halves = pooled.capacities.by_halves;
                    // Where the middle stage could not finish such a build, the next one does without.
                    if pooled.middle_was_void && estimate.middle {
                        estimate = estimate.without_middle_stage();
                        capacities = capacities.without_middle_stage();
                        effort.middle_stage = MiddleStage::KnownVoid;
                    }
                }
                pooled.buffers
            }
            None => Buffers::new(gpu)?,
        };
        let mut pending = PendingBuild {
            profile: profiled.then(|| Profile::new(gpu)).flatten(),
            buffers: Some(buffers),
            options: options.unwatched(),
            capacities,
            planes,
            first_index: source.first_index(),
            tree_to_host,
            mesh_copy: None,
            spare_levels,
            swapped: false,
            mapped: Arc::new(AtomicU8::new(WAITING)),
            bell: Bell::default(),
            from,
            effort,
            shared,
        };
        match pending.reserve(None) {
            // Buffers of a larger scene: without them the limit may suffice.
            Err(BuildError::OutOfMemory { .. }) if was_pooled => {
                pending.buffers = Some(Buffers::new(&pending.shared.gpu)?);
                pending.capacities = estimate;
                pending.effort = effort;
                pending.reserve(None)?;
            }
            reserved => reserved?,
        }
        // A root that is handed over is no level's work but one.
        if triangles <= pending.capacities.hand_over_limit(&options.config) {
            levels = 1;
        }
        let shared = Arc::clone(&pending.shared);
        guarded(&shared.gpu, || {
            let buffers = pending.buffers.as_mut().expect("until finished");
            buffers.upload(&shared.gpu, &pending.capacities, source)?;
            if matches!(source, Source::Device(_)) {
                // Ahead of the build, so that a repeat need not do it again.
                let mut encoder = shared.gpu.device().create_command_encoder(&Default::default());
                buffers.copy_mesh(&mut encoder, source);
                pending.mesh_copy = Some(encoder.finish());
            }
            pending.begin(levels)
        })?;
        Ok(pending)
    }

    /// Allocates, within what device and caller allow.
    fn reserve(&mut self, needed: Option<&Capacities>) -> Result<(), BuildError> {
        let gpu = &self.shared.gpu;
        let limits = gpu.device().limits();
        let before = self.capacities;
        self.capacities = before.within(&limits, needed, &self.options.config)?;
        if before.middle && !self.capacities.middle {
            let why = self.capacities.too_long_for_middle_stage(&limits);
            self.effort.middle_stage = why.unwrap_or_default();
        }
        if let Some(limit) = self.options.max_memory {
            if self.needed_bytes() > limit {
                // This only costs time: subtrees that are not kept are built twice.
                self.capacities.subtrees = 0;
            }
            if self.capacities.middle && self.needed_bytes() > limit {
                let needed = self.needed_bytes();
                self.effort.middle_stage = MiddleStage::OutOfMemory { needed, limit };
                self.capacities = self.capacities.without_middle_stage();
            }
            let needed = self.needed_bytes();
            if needed > limit {
                return Err(BuildError::OutOfMemory { needed, limit });
            }
        }
        let buffers = self.buffers.as_mut().expect("until finished");
        Ok(buffers.reserve(gpu, &self.capacities, self.tree_to_host)?)
    }

    /// Bytes of all buffers, and of the copies of tree and corners that the host will get.
    fn needed_bytes(&self) -> u64 {
        let buffers = self.buffers.as_ref().expect("until finished");
        let on_host = if self.tree_to_host {
            let c = &self.capacities;
            [Buffer::Nodes, Buffer::LeafReferences, Buffer::Triangles].map(|b| c.bytes_of(b))
        } else {
            [0; 3]
        };
        buffers.bytes_with(&self.capacities, self.tree_to_host) + on_host.iter().sum::<u64>()
    }

    /// Records and submits a build from its start.
    fn begin(&mut self, levels: u32) -> Result<(), BuildError> {
        let shared = Arc::clone(&self.shared);
        let buffers = self.buffers.as_mut().expect("until finished");
        let parameters = self.capacities.parameters(&self.options.config, self.first_index);
        buffers.write_parameters(&shared.gpu, &self.capacities, &parameters);
        let counters = first_counters(self.capacities.triangles);
        shared.gpu.write(buffers.get(Buffer::Counters), 0, bytemuck::bytes_of(&counters));
        shared.gpu.write(buffers.get(Buffer::MiddleNodes), 0, &POOL_AT_START);
        self.record(levels, true)
    }

    /// Records the schedule, all of it or the rest, and requests what must be read back.
    fn record(&mut self, levels: u32, from_start: bool) -> Result<(), BuildError> {
        let shared = Arc::clone(&self.shared);
        let (gpu, pipelines): (&Gpu, &Pipelines) = (&shared.gpu, &shared.pipelines);
        let buffers = self.buffers.as_mut().expect("until finished");
        let mut limits = buffers.limits.take();
        let build = Build::new(gpu, buffers, self.capacities, levels, from_start);
        let mut executor = WgpuExecutor::new(gpu, pipelines, build, LoopControl::Recorded)
            .limited(shared.max_workgroups());
        if let Some(profile) = &mut self.profile {
            executor = executor.profiled(profile);
        }
        if from_start {
            schedule::build(&mut executor, self.planes)?;
        } else {
            executor = executor.resumed(self.swapped);
            schedule::resume(&mut executor, self.planes)?;
        }
        let triangles = self.capacities.triangles;
        if triangles > 0 {
            executor.record_limits(&shared.queries, triangles, &mut limits)?;
        }
        executor.read_back(self.tree_to_host);
        executor.submit_after(self.mesh_copy.take())?;
        self.effort.dispatches += executor.dispatches();
        self.effort.most_workgroups = self.effort.most_workgroups.max(executor.most_workgroups());
        self.effort.submissions += 1;
        self.swapped = executor.swapped();
        self.mapped = Arc::new(AtomicU8::new(WAITING));
        let (mapped, bell) = (Arc::clone(&self.mapped), self.bell.clone());
        let buffers = self.buffers.as_mut().expect("until finished");
        buffers.limits = limits;
        buffers.readback.map_async(wgpu::MapMode::Read, .., move |result| {
            mapped.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
            bell.ring();
        });
        Ok(())
    }

    /// The tree if the device is done; `None` if it is not, or if it turned out that more must be
    /// submitted, which this does. Never waits.
    ///
    /// # Errors
    /// The device's, or a limit that binds. After an error, and after the tree was given, there is
    /// nothing more to ask for.
    ///
    /// # Panics
    /// After the tree was given.
    pub fn poll(&mut self) -> Result<Option<DeviceBuild>, BuildError> {
        let gpu = Arc::clone(&self.shared.gpu);
        gpu.poll()?;
        let is_settled = gpu.settled(self.from)?;
        match self.mapped.load(Ordering::Acquire) {
            _ if !is_settled => Ok(None),
            // Only the callback holds the other reference; when wgpu has forgotten it, the buffer
            // itself knows whether it is mapped.
            WAITING if Arc::strong_count(&self.mapped) > 1 => Ok(None),
            WAITING | MAPPED => guarded(&gpu, || self.look()),
            _ => {
                gpu.check()?;
                Err(GpuError::Refused("what the build wrote cannot be read".into()).into())
            }
        }
    }

    /// Waits until the device is done.
    ///
    /// # Errors
    /// As for [`PendingBuild::poll`]; a device that takes longer than its time-out. After a
    /// time-out the build may still be polled.
    ///
    /// # Panics
    /// After the tree was given.
    pub fn wait(&mut self) -> Result<DeviceBuild, BuildError> {
        blocking(self.wait_by(Wait::Blocking, None))
    }

    /// As [`PendingBuild::wait`], without blocking. Dropped before its end, it leaves the build as it is.
    ///
    /// # Errors
    /// As for [`PendingBuild::wait`].
    ///
    /// # Panics
    /// After the tree was given.
    pub async fn wait_async(&mut self) -> Result<DeviceBuild, BuildError> {
        self.wait_by(Wait::Yielding, None).await
    }

    /// As [`PendingBuild::wait`], but calls the watch meanwhile, which may cancel it.
    pub(crate) fn wait_watched(self, watch: Option<&dyn Watch>) -> Result<DeviceBuild, BuildError> {
        blocking(self.wait_watched_by(Wait::Blocking, watch))
    }

    /// The same in either way of waiting.
    pub(crate) async fn wait_watched_by(
        mut self,
        wait: Wait,
        watch: Option<&dyn Watch>,
    ) -> Result<DeviceBuild, BuildError> {
        let built = self.wait_by(wait, watch).await;
        if let Err(BuildError::Cancelled { .. }) = built {
            self.cancel();
        }
        built
    }

    async fn wait_by(
        &mut self,
        wait: Wait,
        watch: Option<&dyn Watch>,
    ) -> Result<DeviceBuild, BuildError> {
        match self.wait_until_done(wait, watch).await {
            Err(error @ BuildError::Device(_)) => Err(self.shared.gpu.cause(error).await),
            built => built,
        }
    }

    async fn wait_until_done(
        &mut self,
        wait: Wait,
        watch: Option<&dyn Watch>,
    ) -> Result<DeviceBuild, BuildError> {
        wait.check()?;
        let gpu = Arc::clone(&self.shared.gpu);
        let progress = Progress { stage: Stage::Device, done: 0, total: 0 };
        let in_one_piece = wait.blocks() && watch.is_none();
        let mut patience = Patience::new(gpu.timeout());
        loop {
            go_on(watch, progress)?;
            let submissions = self.effort.submissions;
            if in_one_piece {
                gpu.wait()?;
            }
            if let Some(built) = self.poll()? {
                return Ok(built);
            }
            // More was submitted, or another thread is about to call back.
            if self.effort.submissions > submissions {
                patience = Patience::new(gpu.timeout());
            } else if patience.is_over() {
                return Err(patience.exceeded().into());
            }
            let pause = if in_one_piece { Duration::ZERO } else { POLL_INTERVAL };
            wait.pause(pause, &self.bell).await?;
        }
    }

    /// Cancels the build. What was submitted runs to its end, unseen; the next build uses the
    /// buffers, and its commands follow in the queue. Dropping a build cancels it too and drops its
    /// buffers.
    pub fn cancel(mut self) {
        let Some(buffers) = self.buffers.take() else { return };
        // Whether it is mapped, waits to be, or neither: then there is nothing to undo, and wgpu says so.
        let unmapped = self.shared.gpu.guard(|| buffers.readback.unmap());
        // Where a browser has not told whether they are any good, they go.
        if unmapped.is_ok() && self.shared.gpu.settled(self.from) == Ok(true) {
            let BuildOptions { config, .. } = self.options;
            let (capacities, levels) = (self.capacities, config.max_depth + 1);
            let triangles = self.capacities.triangles;
            self.shared.keep_buffers(Pooled {
                buffers,
                capacities,
                triangles,
                config,
                levels,
                middle_was_void: self.middle_was_void(),
                spare_levels: self.spare_levels,
            });
        }
    }

    /// Whether the middle stage was void, now or before.
    fn middle_was_void(&self) -> bool {
        matches!(self.effort.middle_stage, MiddleStage::Void | MiddleStage::KnownVoid)
    }

    /// The device work so far.
    pub fn effort(&self) -> Effort {
        self.effort
    }
}

/// Runs calls of wgpu; what it refuses meanwhile becomes an error here and does not reach the
/// callback of a host.
fn guarded<T>(gpu: &Gpu, work: impl FnOnce() -> Result<T, BuildError>) -> Result<T, BuildError> {
    gpu.guard(work)?
}

/// Interval between two calls of the watch.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

//! Batches of rays from host memory, in slices.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Acquire;
use std::time::Duration;

use splitplane_core::layout::BatchUniform;
use splitplane_core::ray::{QueryOptions, Ray};
use splitplane_core::watch::{Progress, Stage, Watch};

use super::asked::Asked;
use super::error::DeviceQueryError;
use super::layout::RAY_BYTES;
use super::pipelines::Queries;
use super::record::QueryBuffers;
use super::slices::SliceRays;
use super::staging::Staging;
use super::tree::DeviceTree;
use crate::device::clock::Instant;
use crate::device::deferred::Mark;
use crate::device::patience::Patience;
use crate::device::scope::checked;
use crate::device::wait::{Bell, Wait};
use crate::error::GpuError;

/// Interval between two calls of the watch.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// A slice that was submitted.
struct Pending {
    set: Staging,
    rays: Range<usize>,
    since: Instant,
    /// Whether the device is done with it, and who is told then, if there is a watch.
    done: Option<(Arc<AtomicBool>, Bell)>,
}

impl Queries {
    /// Most bytes of a buffer under the limits of the device.
    pub(super) fn buffer_limit(&self) -> u64 {
        let limits = self.gpu().device().limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Most rays of a slice under the limits of the device.
    fn slice_limit(&self, asked: Asked) -> u32 {
        (self.buffer_limit() / asked.result_bytes().max(asked.scratch_bytes()).max(RAY_BYTES))
            .clamp(1, u64::from(SliceRays::MOST)) as u32
    }

    /// Traces slices two deep: while the device works on one, the next one is submitted. `answer` gets
    /// the places of a slice's rays and the bytes that the kernel wrote for them.
    #[expect(clippy::too_many_arguments, reason = "what a batch is, and how it is waited for")]
    pub(super) async fn trace_slices(
        &self,
        wait: Wait,
        tree: &DeviceTree,
        rays: &[Ray],
        options: &QueryOptions<'_>,
        asked: Asked,
        watch: Option<&dyn Watch>,
        mut answer: impl FnMut(Range<usize>, &[u8]) -> Result<(), DeviceQueryError>,
    ) -> Result<(), DeviceQueryError> {
        let ask = |done: usize| go_on(watch, done, rays.len());
        wait.check()?;
        let from = self.gpu().mark();
        let most = self.slice_limit(asked);
        let mut size = self.slice_rays.first(most);
        let mut next = 0;
        let mut pending: Option<Pending> = None;
        let mut answered = 0;
        ask(answered)?;
        while next < rays.len() || pending.is_some() {
            let slice = next..rays.len().min(next + size as usize);
            next = slice.end;
            let uploaded = if slice.is_empty() {
                None
            } else {
                Some(self.upload_slice(&rays[slice.clone()], options, asked, most)?)
            };
            if let (Some(_), Some(pending)) = (watch, &pending) {
                self.watch_slice(wait, pending, || ask(answered)).await?;
            }
            let done = match pending.take() {
                Some(slice) => Some(self.await_slice(wait, from, slice, asked).await?),
                None => None,
            };
            if let Some((_, _, took)) = &done {
                size = SliceRays::after(size, *took, most);
            }
            if let Some(set) = uploaded {
                self.submit_slice(tree, &set, slice.len() as u32, options, asked)?;
                let done = watch.map(|_| self.gpu().submitted_work_done());
                pending = Some(Pending { set, rays: slice, since: Instant::now(), done });
            }
            // Copied while the device works on the next slice.
            if let Some((range, bytes, _)) = done {
                answered = range.end;
                answer(range, &bytes)?;
                ask(answered)?;
            }
        }
        self.slice_rays.keep(size);
        Ok(())
    }

    fn upload_slice(
        &self,
        rays: &[Ray],
        options: &QueryOptions<'_>,
        asked: Asked,
        most: u32,
    ) -> Result<Staging, GpuError> {
        checked(self.gpu(), "the upload of rays", || {
            let count = rays.len() as u32;
            let each = [asked.result_bytes(), asked.scratch_bytes()];
            let set = self.staging.take(self.gpu(), count, most, each)?;
            let queue = self.gpu().queue();
            let room = asked.room();
            let batch = BatchUniform { room, ..BatchUniform::new(count, options) };
            queue.write_buffer(&set.batch, 0, bytemuck::bytes_of(&batch));
            queue.write_buffer(&set.rays, 0, bytemuck::cast_slice(rays));
            Ok(set)
        })
    }

    fn submit_slice(
        &self,
        tree: &DeviceTree,
        set: &Staging,
        count: u32,
        options: &QueryOptions<'_>,
        asked: Asked,
    ) -> Result<(), GpuError> {
        let gpu = self.gpu();
        checked(gpu, "a batch of rays", || {
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            let buffers = QueryBuffers {
                rays: &set.rays,
                results: &set.results,
                scratch: set.scratch.as_ref(),
                batch: &set.batch,
                deferred: &set.deferred,
            };
            self.dispatch(&mut encoder, tree, &buffers, count, options, asked)?;
            let bytes = u64::from(count) * asked.result_bytes();
            encoder.copy_buffer_to_buffer(&set.results, 0, &set.readback, 0, bytes);
            gpu.submit([encoder.finish()])?;
            Ok(())
        })
    }

    /// Calls a watch until a slice is done, or its time is up. When the watch cancels the batch,
    /// the slice's buffers are freed once the device has finished with them.
    async fn watch_slice(
        &self,
        wait: Wait,
        slice: &Pending,
        ask: impl Fn() -> Result<(), DeviceQueryError>,
    ) -> Result<(), DeviceQueryError> {
        let Some((done, bell)) = &slice.done else { return Ok(()) };
        let gpu = self.gpu();
        let mut patience = Patience::new(gpu.timeout());
        while !done.load(Acquire) && !patience.is_over() {
            ask()?;
            wait.pause(POLL_INTERVAL, bell).await?;
            gpu.poll()?;
        }
        Ok(())
    }

    /// Waits for a slice. Returns its place, its answers, and how long it took.
    async fn await_slice(
        &self,
        wait: Wait,
        from: Mark,
        slice: Pending,
        asked: Asked,
    ) -> Result<(Range<usize>, Vec<u8>, Duration), GpuError> {
        let bytes = slice.rays.len() as u64 * asked.result_bytes();
        let gpu = self.gpu();
        let answers = gpu.read_mapped_by(wait, from, &slice.set.readback, bytes).await?;
        let took = slice.since.elapsed();
        self.staging.keep(slice.set);
        Ok((slice.rays, answers, took))
    }
}

/// Calls a watch, if there is one; returns whether to continue.
pub(super) fn go_on(
    watch: Option<&dyn Watch>,
    done: usize,
    total: usize,
) -> Result<(), DeviceQueryError> {
    let (done, total) = (done as u64, total as u64);
    let progress = Progress { stage: Stage::Rays, done, total };
    match watch.is_some_and(|watch| watch.progress(&progress).is_break()) {
        true => Err(DeviceQueryError::Cancelled { done, total }),
        false => Ok(()),
    }
}

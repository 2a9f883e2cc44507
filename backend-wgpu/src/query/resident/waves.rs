//! Batches of rays with a scene that is on the device: waves, several of them in a submission.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use splitplane_core::kernel::{QueryBuffer, QueryKernel, QueryUniform, RayQueries, Slot};
use splitplane_core::layout::{SceneBatch, culling_bits};
use splitplane_core::ray::Ray;
use splitplane_core::scene::{SceneHit, SceneOptions};
use splitplane_core::watch::Watch;
use splitplane_shaders::TriangleTest;

use super::held::HeldScene;
use crate::device::clock::Instant;
use crate::device::kernel_set::Bound;
use crate::device::once;
use crate::device::scope::checked;
use crate::device::wait::Wait;
use crate::error::GpuError;
use crate::query::batch::go_on;
use crate::query::error::DeviceQueryError;
use crate::query::layout::{DEFERRED_USAGE, RAY_BYTES};
use crate::query::pipelines::{Queries, QueryVariant};
use crate::query::slices::SliceRays;

/// Bytes of a hit.
const HIT_BYTES: u64 = size_of::<SceneHit>() as u64;
/// Bytes of the counts: instances entered in the submission, rays that are done.
const COUNT_BYTES: u64 = 8;
/// Bytes of one of them.
const WORD: u64 = 4;
/// Waves of the first submission of a slice, and at most of a later one.
const FIRST_WAVES: usize = 8;
const MOST_WAVES: usize = 64;
/// Hits of no more bytes are copied with the counts of every submission, which takes less time than to ask for them once all are
/// there.
const COPIED_ALONG: u64 = 1 << 17;

/// Device memory of one slice.
#[derive(Debug)]
struct Memory {
    rays: u32,
    way: u32,
    batch: wgpu::Buffer,
    given: wgpu::Buffer,
    hits: wgpu::Buffer,
    ways: wgpu::Buffer,
    deferred: wgpu::Buffer,
    counts: wgpu::Buffer,
    /// Counts, then hits.
    readback: wgpu::Buffer,
}

impl Memory {
    fn new(queries: &Queries, rays: u32, way: u32) -> Result<Memory, GpuError> {
        use wgpu::BufferUsages as Usage;
        let gpu = queries.gpu();
        let (n, storage) = (u64::from(rays), Usage::STORAGE | Usage::COPY_DST);
        let uniform = Usage::UNIFORM | Usage::COPY_DST;
        let (written, read) = (Usage::STORAGE | Usage::COPY_SRC, Usage::MAP_READ | Usage::COPY_DST);
        Ok(Memory {
            rays,
            way,
            batch: gpu.buffer("scene batch", size_of::<SceneBatch>() as u64, uniform)?,
            given: gpu.buffer("rays", n * RAY_BYTES, storage)?,
            hits: gpu.buffer("hits with a scene", n * HIT_BYTES, written)?,
            ways: gpu.buffer("ways through a scene", way_bytes(rays, way), storage)?,
            deferred: gpu.buffer(
                "deferred rays",
                QueryKernel::deferred_bytes(rays),
                DEFERRED_USAGE,
            )?,
            counts: gpu.buffer("counts of waves", COUNT_BYTES, written | Usage::COPY_DST)?,
            readback: gpu.buffer("hits, read back", COUNT_BYTES + n * HIT_BYTES, read)?,
        })
    }
}

/// Bytes of the ways of so many rays: never none, since every ray says what it has entered.
fn way_bytes(rays: u32, way: u32) -> u64 {
    4 * u64::from(rays) * u64::from(way.max(2))
}

/// The memory of the last slice, for the next one.
#[derive(Debug, Default)]
pub(super) struct WaveMemory(Mutex<Option<Memory>>);

impl WaveMemory {
    fn take(&self, queries: &Queries, rays: u32, way: u32, most: u32) -> Result<Memory, GpuError> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        match kept.filter(|kept| kept.rays >= rays && kept.way >= way) {
            Some(kept) => Ok(kept),
            None => Memory::new(queries, rays.next_power_of_two().min(most.max(rays)), way),
        }
    }

    fn keep(&self, memory: Memory) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(memory);
    }
}

/// Records a copy of the hits to the host, behind the counts.
fn copy_hits(encoder: &mut wgpu::CommandEncoder, memory: &Memory, bytes: u64) {
    encoder.copy_buffer_to_buffer(&memory.hits, 0, &memory.readback, COUNT_BYTES, bytes);
}

/// What a batch is answered with.
pub(super) struct Waves<'a> {
    pub(super) queries: &'a Queries,
    pub(super) scene: &'a HeldScene,
    pub(super) memory: &'a WaveMemory,
    pub(super) options: &'a SceneOptions<'a>,
    /// Whether any hit will do.
    pub(super) any: bool,
}

impl Waves<'_> {
    /// Answers all rays. `take` gets the places of a slice's rays and the bytes of their hits. Returns how many instances were entered.
    pub(super) async fn answer(
        &self,
        wait: Wait,
        rays: &[Ray],
        watch: Option<&dyn Watch>,
        mut take: impl FnMut(Range<usize>, &[u8]) -> Result<(), DeviceQueryError>,
    ) -> Result<u64, DeviceQueryError> {
        let each = RAY_BYTES.max(way_bytes(1, self.scene.way)).max(HIT_BYTES);
        let most = (self.queries.buffer_limit().saturating_sub(COUNT_BYTES) / each)
            .clamp(1, u64::from(SliceRays::MOST)) as u32;
        let mut size = self.queries.slice_rays.first(most);
        let (mut next, mut entered) = (0, 0);
        wait.check()?;
        go_on(watch, 0, rays.len())?;
        while next < rays.len() {
            let slice = next..rays.len().min(next + size as usize);
            let since = Instant::now();
            let count = slice.len() as u32;
            let memory = self.memory.take(self.queries, count, self.scene.way, most)?;
            let ask = || go_on(watch, next, rays.len());
            let keep = |hits: &[u8]| take(slice.clone(), hits);
            entered += self.answer_slice(wait, &memory, &rays[slice.clone()], ask, keep).await?;
            self.memory.keep(memory);
            size = SliceRays::after(size, since.elapsed(), most);
            next = slice.end;
            go_on(watch, next, rays.len())?;
        }
        self.queries.slice_rays.keep(size);
        Ok(entered)
    }

    async fn answer_slice(
        &self,
        wait: Wait,
        memory: &Memory,
        rays: &[Ray],
        go_on: impl Fn() -> Result<(), DeviceQueryError>,
        take: impl FnOnce(&[u8]) -> Result<(), DeviceQueryError>,
    ) -> Result<u64, DeviceQueryError> {
        let (gpu, count) = (self.queries.gpu(), rays.len() as u32);
        let from = gpu.mark();
        checked(gpu, "the upload of rays", || {
            gpu.write(&memory.batch, 0, bytemuck::bytes_of(&self.uniform(count)));
            gpu.write(&memory.given, 0, bytemuck::cast_slice(rays));
            Ok(())
        })?;
        // A ray enters each instance once, and the last wave finds that there is none left.
        let mut left = self.scene.names() + 1;
        let (mut waves, mut first) = (FIRST_WAVES, true);
        let hit_bytes = u64::from(count) * HIT_BYTES;
        // Each submission counts from zero: in so few waves no count outgrows a word.
        let mut entered = 0;
        loop {
            let now = waves.min(left);
            self.submit(memory, count, now, first)?;
            let counts = gpu.read_mapped_by(wait, from, &memory.readback, COUNT_BYTES).await?;
            let word = |at: usize| u32::from_ne_bytes([0, 1, 2, 3].map(|k| counts[4 * at + k]));
            entered += u64::from(word(0));
            if word(1) == count {
                if hit_bytes > COPIED_ALONG {
                    checked(gpu, "hits with a scene", || {
                        let mut encoder = gpu.device().create_command_encoder(&Default::default());
                        copy_hits(&mut encoder, memory, hit_bytes);
                        gpu.submit([encoder.finish()])?;
                        Ok(())
                    })?;
                }
                let bytes = COUNT_BYTES + hit_bytes;
                let all = gpu.read_mapped_by(wait, from, &memory.readback, bytes).await?;
                take(&all[COUNT_BYTES as usize..])?;
                return Ok(entered);
            }
            left -= now;
            if left == 0 {
                let done = word(1);
                let what = format!("{done} of {count} rays have come to their end in a scene");
                return Err(GpuError::Refused(what).into());
            }
            (waves, first) = ((2 * waves).min(MOST_WAVES), false);
            go_on()?;
        }
    }

    fn uniform(&self, count: u32) -> SceneBatch {
        let SceneOptions { culling, mask, ignore, .. } = *self.options;
        SceneBatch {
            count,
            culling: culling_bits(culling),
            mask,
            ignored_instance: ignore.map_or(u32::MAX, |own| own.instance.0),
            ignored_triangle: ignore.map_or(0, |own| own.triangle),
            any: u32::from(self.any),
            zero: 0,
            way: self.scene.way,
        }
    }

    /// Submits waves, and copies to the host: of counts, and of hits where these are few.
    fn submit(
        &self,
        memory: &Memory,
        count: u32,
        waves: usize,
        first: bool,
    ) -> Result<(), GpuError> {
        let gpu = self.queries.gpu();
        checked(gpu, "waves of rays", || {
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            if first {
                // No ray has begun.
                encoder.clear_buffer(&memory.ways, 0, Some(way_bytes(count, 2)));
                encoder.clear_buffer(&memory.counts, 0, None);
            } else {
                encoder.clear_buffer(&memory.counts, 0, Some(WORD));
            }
            for _ in 0..waves {
                self.record(&mut encoder, memory, count)?;
            }
            encoder.copy_buffer_to_buffer(&memory.counts, 0, &memory.readback, 0, COUNT_BYTES);
            let bytes = u64::from(count) * HIT_BYTES;
            if bytes <= COPIED_ALONG {
                copy_hits(&mut encoder, memory, bytes);
            }
            gpu.submit([encoder.finish()])?;
            Ok(())
        })
    }

    /// Records a wave.
    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        count: u32,
    ) -> Result<(), GpuError> {
        let [box_nodes, instances, nodes, references, triangles, shapes] = &self.scene.buffers;
        let whole = wgpu::Buffer::as_entire_buffer_binding;
        let find = |bound: &Bound<RayQueries>| match bound.slot {
            Slot::Uniform(QueryUniform::SceneBatch) => Some(whole(&memory.batch)),
            Slot::Uniform(_) => None,
            Slot::Storage(binding) => Some(whole(match binding.buffer {
                QueryBuffer::BoxNodes => box_nodes,
                QueryBuffer::Instances => instances,
                QueryBuffer::Nodes => nodes,
                QueryBuffer::LeafReferences => references,
                QueryBuffer::Triangles => triangles,
                QueryBuffer::Shapes => shapes,
                QueryBuffer::Rays => &memory.given,
                QueryBuffer::SceneHits => &memory.hits,
                QueryBuffer::Ways => &memory.ways,
                QueryBuffer::Deferred => &memory.deferred,
                QueryBuffer::WaveCounts => &memory.counts,
                _ => return None,
            })),
        };
        let variant = QueryVariant { test: TriangleTest::Watertight, by_halves: false };
        let kernels = if self.scene.masked { QueryKernel::MASKED_WAVE } else { QueryKernel::WAVE };
        let shapes = self.scene.has_shapes.then_some(QueryKernel::TraceShapes);
        for kernel in kernels.into_iter().chain(shapes) {
            let gpu = self.queries.gpu();
            once::record(gpu, &self.queries.pipelines, encoder, (kernel, &variant), count, find)?;
        }
        Ok(())
    }
}

// A ray enters an instance a wave at most, so the instances that are entered in one submission can be counted in a word.
const _: () = assert!(SliceRays::MOST as u64 * (MOST_WAVES as u64) < u32::MAX as u64);

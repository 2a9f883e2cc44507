//! Batches of queries to points, in slices.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Acquire;
use std::time::Duration;

use rayon::prelude::*;
use splitplane_core::error::{QueryError, check_bytes};
use splitplane_core::kernel::{PointQueries, PointQueryBuffer, PointQueryKernel, Slot};
use splitplane_core::layout::PointBatch;
use splitplane_core::points::nearest::NearestOptions;
use wgpu::BufferUsages as Usage;

use super::super::settle::Asking;
use super::super::slices::SliceRays;
use super::device::padded;
use super::tree::WgpuPointTree;
use crate::device::clock::Instant;
use crate::device::kernel_set::Bound;
use crate::device::once;
use crate::device::scope::checked;
use crate::device::wait::Wait;
use crate::error::GpuError;

/// Interval between two calls of the watch.
const POLL_INTERVAL: Duration = Duration::from_micros(500);
/// Fewest queries of a slice, where memory allows no more.
const LEAST_SLICE: usize = 64;
/// A coordinate of a query on a device is at most this many units: then no distance overflows.
const MOST_UNITS: f32 = (1u64 << 62) as f32;

/// What a batch asks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked<'a> {
    pub(super) kernel: PointQueryKernel,
    /// Points that are kept for each query.
    pub(super) room: u32,
    /// Bits of the greatest squared distance that counts.
    pub(super) reach: u32,
    /// Which points count, where not all do.
    pub(super) allowed: Option<&'a wgpu::Buffer>,
}

impl Asked<'_> {
    /// Bytes of what comes back for a query.
    fn result_bytes(&self) -> u64 {
        match self.kernel {
            PointQueryKernel::CountWithin => 4,
            _ => 8 * u64::from(self.room),
        }
    }
}

/// The buffers of a slice.
struct Staging {
    capacity: usize,
    uniform: wgpu::Buffer,
    queries: wgpu::Buffer,
    results: wgpu::Buffer,
    readback: wgpu::Buffer,
}

/// A slice that was submitted.
struct Pending {
    set: Staging,
    queries: Range<usize>,
    since: Instant,
    /// Whether the device is done with it, if there is a watch.
    done: Option<Arc<AtomicBool>>,
}

impl<const N: usize> WgpuPointTree<N> {
    /// A query in the tree's unit, if the device can answer it.
    pub(super) fn on_device(&self, query: [f32; N]) -> Option<[f32; 4]> {
        let units = self.tree().in_units(query);
        units.iter().all(|x| x.abs() <= MOST_UNITS).then(|| padded(units))
    }

    /// The points that count, a bit each, in device memory; `None` where all do.
    pub(super) fn allowed(
        &self,
        options: &NearestOptions<'_>,
    ) -> Result<Option<wgpu::Buffer>, QueryError> {
        let Some(filter) = options.filter else { return Ok(None) };
        let indices = self.tree().indices();
        check_bytes(indices.len().div_ceil(8) as u64, options.max_memory)?;
        let word = |places: &[u32]| {
            let bits = places.iter().enumerate();
            bits.fold(0u32, |word, (bit, &index)| word | u32::from(filter(index)) << bit)
        };
        let words: Vec<u32> = indices.par_chunks(32).map(word).collect();
        let gpu = self.queries().gpu();
        let made = checked(gpu, "a filter of points", || {
            let bytes = (4 * words.len() as u64).next_multiple_of(16).max(16);
            let buffer =
                gpu.buffer("a filter of points", bytes, Usage::STORAGE | Usage::COPY_DST)?;
            if !words.is_empty() {
                gpu.write(&buffer, 0, bytemuck::cast_slice(&words));
            }
            Ok(buffer)
        })?;
        Ok(Some(made))
    }

    /// Whether a filter is worth asking for every point, for so many queries; else the host asks it for those that it visits.
    pub(super) fn filter_is_worth_it(&self, queries: usize, options: &NearestOptions<'_>) -> bool {
        options.filter.is_none() || queries >= self.tree().len() / 64
    }

    /// Most queries of a slice, by the device's limits and the caller's.
    fn most_queries(&self, each: u64, max_memory: Option<u64>) -> Result<usize, QueryError> {
        check_bytes(2 * each, max_memory)?;
        let by_device = self.queries().buffer_limit() / each;
        let by_caller = max_memory.map_or(u64::MAX, |most| most / (2 * each));
        Ok(by_device.min(by_caller).clamp(1, u64::from(SliceRays::MOST)) as usize)
    }

    /// Answers queries two slices deep: while the device works on one, the next one is submitted. `answer` gets the places of a
    /// slice's queries and the bytes that the kernel wrote for them.
    pub(super) fn ask_slices(
        &self,
        queries: &[[f32; N]],
        asked: &Asked<'_>,
        max_memory: Option<u64>,
        asking: &Asking<'_>,
        mut answer: impl FnMut(Range<usize>, &[u8]) -> Result<(), QueryError>,
    ) -> Result<(), QueryError> {
        Wait::Blocking.check()?;
        let most = self.most_queries(asked.result_bytes().max(16), max_memory)?;
        let mut size = self.slices().first(most as u32);
        let (mut next, mut pending) = (0, None);
        // Sets whose work is done.
        let mut free: Vec<Staging> = Vec::new();
        asking.check()?;
        while next < queries.len() || pending.is_some() {
            let slice = next..queries.len().min(next + size as usize);
            next = slice.end;
            let uploaded = match slice.is_empty() {
                true => None,
                false => {
                    let kept = free.pop().filter(|set| set.capacity >= slice.len());
                    Some(self.upload_slice(&queries[slice.clone()], asked, most, kept)?)
                }
            };
            if let Some(pending) = &pending {
                self.watch_slice(pending, asking)?;
            }
            let done = match pending.take() {
                None => None,
                Some(Pending { set, queries, since, .. }) => {
                    let bytes = queries.len() as u64 * asked.result_bytes();
                    let words = self.queries().gpu().read_mapped(&set.readback, bytes)?;
                    size = SliceRays::after(size, since.elapsed(), most as u32);
                    free.push(set);
                    Some((queries, words))
                }
            };
            if let Some(set) = uploaded {
                self.submit_slice(&set, slice.len() as u32, asked)?;
                let done = asking.watch().map(|_| self.queries().gpu().submitted_work_done().0);
                pending = Some(Pending { set, queries: slice, since: Instant::now(), done });
            }
            if let Some((range, words)) = done {
                answer(range, &words)?;
                asking.check()?;
            }
        }
        self.slices().keep(size);
        Ok(())
    }

    /// The queries of a slice as the device has them, at least one: those that it cannot answer count as the origin.
    pub(super) fn write_queries(
        &self,
        queries: &[[f32; N]],
        to: &wgpu::Buffer,
    ) -> Result<(), GpuError> {
        let mut words = crate::device::host::room(queries.len(), "queries to send")?;
        words.extend(queries.iter().map(|&query| self.on_device(query).unwrap_or_default()));
        self.queries().gpu().write(to, 0, bytemuck::cast_slice(&words));
        Ok(())
    }

    /// What the kernels are told.
    pub(super) fn uniform(&self, count: u32, asked: &Asked<'_>) -> PointBatch {
        let device = self.device();
        PointBatch {
            count,
            room: asked.room,
            points: device.count,
            height: device.height,
            reach: asked.reach,
            filtered: u32::from(asked.allowed.is_some()),
            zero: 0,
            padding: 0,
            lower: device.bounds[0],
            upper: device.bounds[1],
        }
    }

    fn upload_slice(
        &self,
        queries: &[[f32; N]],
        asked: &Asked<'_>,
        most: usize,
        kept: Option<Staging>,
    ) -> Result<Staging, QueryError> {
        let gpu = self.queries().gpu();
        let set = checked(gpu, "the upload of queries", || {
            let set = match kept {
                Some(set) => set,
                None => {
                    let capacity = queries.len().max(LEAST_SLICE).min(most.max(queries.len()));
                    let bytes = capacity as u64 * asked.result_bytes();
                    let storage = Usage::STORAGE | Usage::COPY_DST;
                    let uniform = Usage::UNIFORM | Usage::COPY_DST;
                    let read = Usage::MAP_READ | Usage::COPY_DST;
                    let words = size_of::<PointBatch>() as u64;
                    Staging {
                        capacity,
                        uniform: gpu.buffer("a batch of queries", words, uniform)?,
                        queries: gpu.buffer("queries", 16 * capacity as u64, storage)?,
                        results: gpu.buffer("points found", bytes, storage | Usage::COPY_SRC)?,
                        readback: gpu.buffer("points found, read back", bytes, read)?,
                    }
                }
            };
            let uniform = self.uniform(queries.len() as u32, asked);
            gpu.write(&set.uniform, 0, bytemuck::bytes_of(&uniform));
            self.write_queries(queries, &set.queries)?;
            Ok(set)
        })?;
        Ok(set)
    }

    fn submit_slice(&self, set: &Staging, count: u32, asked: &Asked<'_>) -> Result<(), GpuError> {
        let gpu = self.queries().gpu();
        checked(gpu, "a batch of queries", || {
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            let buffers = [&set.uniform, &set.queries];
            self.record(&mut encoder, buffers, count, asked, |buffer| match buffer {
                PointQueryBuffer::Found | PointQueryBuffer::Counts => Some(&set.results),
                _ => None,
            })?;
            let bytes = u64::from(count) * asked.result_bytes();
            encoder.copy_buffer_to_buffer(&set.results, 0, &set.readback, 0, bytes);
            gpu.submit([encoder.finish()])?;
            Ok(())
        })
    }

    /// Records the kernel of a batch; `others` are the buffers of its results.
    pub(super) fn record<'a>(
        &'a self,
        encoder: &mut wgpu::CommandEncoder,
        [uniform, queries]: [&'a wgpu::Buffer; 2],
        count: u32,
        asked: &Asked<'a>,
        others: impl Fn(PointQueryBuffer) -> Option<&'a wgpu::Buffer>,
    ) -> Result<(), GpuError> {
        let device = self.device();
        let find = |bound: &Bound<PointQueries>| {
            let buffer = match bound.slot {
                Slot::Uniform(_) => Some(uniform),
                Slot::Storage(binding) => match binding.buffer {
                    PointQueryBuffer::Nodes => Some(&device.nodes),
                    PointQueryBuffer::Points => Some(&device.points),
                    PointQueryBuffer::Indices => Some(&device.indices),
                    PointQueryBuffer::Allowed => Some(asked.allowed.unwrap_or(&device.unfiltered)),
                    PointQueryBuffer::Queries => Some(queries),
                    other => others(other),
                },
            };
            buffer.map(wgpu::Buffer::as_entire_buffer_binding)
        };
        let (gpu, pipelines) = (self.queries().gpu(), &self.queries().pipelines);
        once::record(gpu, pipelines, encoder, (asked.kernel, &()), count, find)
    }

    /// Calls a watch until a slice is done, or its time is up.
    fn watch_slice(&self, slice: &Pending, asking: &Asking<'_>) -> Result<(), QueryError> {
        match &slice.done {
            None => Ok(()),
            Some(done) => self.watch_until(done, slice.since, asking),
        }
    }

    pub(super) fn watch_until(
        &self,
        done: &AtomicBool,
        since: Instant,
        asking: &Asking<'_>,
    ) -> Result<(), QueryError> {
        let gpu = self.queries().gpu();
        while !done.load(Acquire) && since.elapsed() < gpu.timeout() {
            asking.check()?;
            std::thread::sleep(POLL_INTERVAL);
            gpu.poll()?;
        }
        Ok(())
    }
}

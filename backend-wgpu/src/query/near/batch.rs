//! Batches of queries for what is near, in slices.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Acquire;
use std::time::Duration;

use splitplane_core::aabb::Aabb;
use splitplane_core::error::QueryError;
use splitplane_core::kernel::{NearBuffer, NearKernel, NearQueries, Slot};
use splitplane_core::layout::NearBatch;
use wgpu::BufferUsages as Usage;

use super::super::accelerator::WgpuAccelerator;
use super::super::pipelines::Queries;
use super::super::settle::Asking;
use super::super::slices::SliceRays;
use super::super::tree::can_be_bound;
use crate::device::clock::Instant;
use crate::device::gpu::Gpu;
use crate::device::halves::{binding_limit, half};
use crate::device::kernel_set::{Bound, with_continued};
use crate::device::once;
use crate::device::scope::checked;
use crate::device::wait::Wait;
use crate::device::{DeviceSet, Text};
use crate::error::GpuError;

/// Interval between two calls of the watch.
const POLL_INTERVAL: Duration = Duration::from_micros(500);
/// Fewest queries of a slice for which room is made, where what comes back of each is short.
const LEAST_SLICE: usize = 64;
/// Bytes of what is short.
const SHORT: u64 = 256;

impl DeviceSet for NearQueries {
    /// Whether the triangles go on in a second binding.
    type Variant = bool;

    fn text(kernel: NearKernel, _by_halves: &bool) -> Text {
        let shader = &splitplane_shaders::NEAR[kernel as usize];
        Text { name: shader.name, parts: shader.parts.into() }
    }

    fn bindings(kernel: NearKernel, by_halves: &bool) -> Vec<Bound<NearQueries>> {
        with_continued::<NearQueries>(kernel, |buffer| {
            *by_halves && buffer == NearBuffer::Triangles
        })
    }
}

/// What a batch asks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub(super) kernel: NearKernel,
    /// Words of what is written for a query.
    pub(super) room: u32,
    /// Rows of four floats of a query.
    pub(super) rows: usize,
    /// A triangle to ignore.
    pub(super) ignore: Option<u32>,
    /// Whether one triangle that is certainly met is enough.
    pub(super) any: bool,
}

impl Asked {
    /// Bytes of what comes back for a query.
    fn result_bytes(&self) -> u64 {
        4 * u64::from(self.room)
    }

    /// Bytes of a query.
    fn query_bytes(&self) -> u64 {
        16 * self.rows as u64
    }

    /// Most queries of a slice, where a buffer may have so many bytes.
    fn most(&self, buffer_limit: u64) -> u32 {
        let each = self.result_bytes().max(self.query_bytes());
        (buffer_limit / each).clamp(1, u64::from(SliceRays::MOST)) as u32
    }

    /// For how many queries room is made for a slice of `count`: later slices of short answers find room, long answers take what they need.
    fn room_for(&self, count: usize, buffer_limit: u64) -> usize {
        match self.is_short() {
            true => count.max(LEAST_SLICE.min(self.most(buffer_limit) as usize)),
            false => count,
        }
    }

    /// Whether what comes back of a query is short.
    fn is_short(&self) -> bool {
        self.result_bytes() <= SHORT
    }
}

/// What is sent of the queries of a slice.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// The same number of rows for each.
    pub(super) queries: Vec<[f32; 4]>,
    /// Half-spaces of volumes.
    pub(super) more: Vec<[f32; 4]>,
}

/// The buffers of a slice.
struct Staging {
    capacity: usize,
    uniform: wgpu::Buffer,
    queries: wgpu::Buffer,
    more: wgpu::Buffer,
    found: wgpu::Buffer,
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

/// What kernels are told of a batch.
fn uniform(count: usize, asked: &Asked, bounds: &Aabb) -> NearBatch {
    NearBatch {
        count: count as u32,
        ignore: asked.ignore.unwrap_or(u32::MAX),
        room: asked.room,
        any: u32::from(asked.any),
        lower: bounds.lo,
        zero: 0,
        upper: bounds.hi,
        padding: 0,
    }
}

impl Staging {
    fn new(gpu: &Gpu, capacity: usize, more: usize, asked: &Asked) -> Result<Staging, GpuError> {
        let storage = Usage::STORAGE | Usage::COPY_DST;
        let words = size_of::<NearBatch>() as u64;
        let queries = capacity as u64 * asked.query_bytes();
        let found = capacity as u64 * asked.result_bytes();
        Ok(Staging {
            capacity,
            uniform: gpu.buffer("a batch of queries", words, Usage::UNIFORM | Usage::COPY_DST)?,
            queries: gpu.buffer("queries", queries, storage)?,
            more: gpu.buffer("half-spaces", more as u64, storage)?,
            found: gpu.buffer("triangles found", found, storage | Usage::COPY_SRC)?,
            readback: gpu.buffer(
                "triangles found, read back",
                found,
                Usage::MAP_READ | Usage::COPY_DST,
            )?,
        })
    }
}

impl WgpuAccelerator {
    /// Answers queries two slices deep: while the device works on one, the next one is submitted. `rows` gives the rows of a slice's
    /// queries; `answer` gets their places and the bytes that the kernel wrote for them.
    pub(super) fn ask_near(
        &self,
        queries: usize,
        asked: &Asked,
        asking: &Asking<'_>,
        rows: impl Fn(Range<usize>) -> Result<Rows, GpuError>,
        mut answer: impl FnMut(Range<usize>, &[u8]) -> Result<(), QueryError>,
    ) -> Result<(), QueryError> {
        Wait::Blocking.check()?;
        let most = asked.most(self.queries.buffer_limit());
        let mut size = self.queries.near_slices.first(most);
        let (mut next, mut pending) = (0, None);
        // Sets whose work is done.
        let mut free: Vec<Staging> = Vec::new();
        asking.check()?;
        while next < queries || pending.is_some() {
            let slice = next..queries.min(next + size as usize);
            next = slice.end;
            let uploaded = match slice.is_empty() {
                true => None,
                false => {
                    let kept = free.pop().filter(|set| set.capacity >= slice.len());
                    Some(self.upload_near(&rows(slice.clone())?, slice.len(), asked, kept)?)
                }
            };
            if let Some(pending) = &pending {
                self.watch_near(pending, asking)?;
            }
            let done = match pending.take() {
                None => None,
                Some(Pending { set, queries, since, .. }) => {
                    let bytes = queries.len() as u64 * asked.result_bytes();
                    let words = self.queries.gpu().read_mapped(&set.readback, bytes)?;
                    size = SliceRays::after(size, since.elapsed(), most);
                    free.push(set);
                    Some((queries, words))
                }
            };
            if let Some(set) = uploaded {
                self.submit_near(&set, slice.len() as u32, asked)?;
                let done = asking.watch().map(|_| self.queries.gpu().submitted_work_done().0);
                pending = Some(Pending { set, queries: slice, since: Instant::now(), done });
            }
            if let Some((range, words)) = done {
                answer(range, &words)?;
                asking.check()?;
            }
        }
        if asked.is_short() {
            self.queries.near_slices.keep(size);
        }
        Ok(())
    }

    fn upload_near(
        &self,
        rows: &Rows,
        count: usize,
        asked: &Asked,
        kept: Option<Staging>,
    ) -> Result<Staging, GpuError> {
        let gpu = self.queries.gpu();
        checked(gpu, "the upload of queries", || {
            let more = size_of_val(&rows.more[..]).max(16);
            let set = match kept.filter(|set| set.more.size() >= more as u64) {
                Some(set) => set,
                None => {
                    can_be_bound(gpu, "the half-spaces of volumes", more as u64)?;
                    let room = asked.room_for(count, self.queries.buffer_limit());
                    Staging::new(gpu, room, more.next_power_of_two(), asked)?
                }
            };
            let uniform = uniform(count, asked, self.device.bounds());
            gpu.write(&set.uniform, 0, bytemuck::bytes_of(&uniform));
            gpu.write(&set.queries, 0, bytemuck::cast_slice(&rows.queries));
            if !rows.more.is_empty() {
                gpu.write(&set.more, 0, bytemuck::cast_slice(&rows.more));
            }
            Ok(set)
        })
    }

    fn submit_near(&self, set: &Staging, count: u32, asked: &Asked) -> Result<(), GpuError> {
        let gpu = self.queries.gpu();
        checked(gpu, "a batch of queries", || {
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            let buffers = [&set.uniform, &set.queries, &set.more, &set.found];
            self.record_near(&mut encoder, buffers, count, asked)?;
            let bytes = u64::from(count) * asked.result_bytes();
            encoder.copy_buffer_to_buffer(&set.found, 0, &set.readback, 0, bytes);
            gpu.submit([encoder.finish()])?;
            Ok(())
        })
    }

    /// Records the kernel of a batch.
    fn record_near(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        [uniform, queries, more, found]: [&wgpu::Buffer; 4],
        count: u32,
        asked: &Asked,
    ) -> Result<(), GpuError> {
        let (gpu, device) = (self.queries.gpu(), &self.device);
        let triangles = device.triangles();
        let by_halves = triangles.size() > binding_limit(gpu.limits()).0;
        let find = |bound: &Bound<NearQueries>| {
            let buffer = match bound.slot {
                Slot::Uniform(_) => uniform,
                Slot::Storage(binding) => match binding.buffer {
                    NearBuffer::Nodes => device.nodes(),
                    NearBuffer::LeafReferences => device.leaf_references(),
                    NearBuffer::Triangles if by_halves => {
                        return Some(half(triangles, triangles.size(), bound.part == 1, 0));
                    }
                    NearBuffer::Triangles => triangles,
                    NearBuffer::NearPoints | NearBuffer::Volumes => queries,
                    NearBuffer::HalfSpaces => more,
                    NearBuffer::Found => found,
                },
            };
            Some(buffer.as_entire_buffer_binding())
        };
        let pipelines = &self.queries.pipelines;
        once::record(gpu, pipelines, encoder, (asked.kernel, &by_halves), count, find)
    }

    /// Calls a watch until a slice is done, or its time is up.
    fn watch_near(&self, slice: &Pending, asking: &Asking<'_>) -> Result<(), QueryError> {
        let Some(done) = &slice.done else { return Ok(()) };
        let gpu = self.queries.gpu();
        while !done.load(Acquire) && slice.since.elapsed() < gpu.timeout() {
            asking.check()?;
            std::thread::sleep(POLL_INTERVAL);
            gpu.poll()?;
        }
        Ok(())
    }
}

impl Queries {
    /// Gives a kernel of queries for what is near another text: for tests that plant faults.
    #[doc(hidden)]
    pub fn replace_near_kernel(&self, kernel: NearKernel, source: Option<String>) {
        self.pipelines.replace::<NearQueries>(kernel, source);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No slice takes more than a buffer may have, however long its answers are.
    #[test]
    fn room_is_within_what_a_buffer_may_have() {
        let limit = 128 << 20;
        for room in [16, 64, 65, 1 << 16, 600_001, 1 << 20] {
            let kernel = NearKernel::OverlappedTriangles;
            let asked = Asked { kernel, room, rows: 4, ignore: None, any: false };
            let most = asked.most(limit) as usize;
            for count in [1, 2, most.min(20), most] {
                let made = asked.room_for(count.min(most), limit);
                assert!(made >= count.min(most) && made as u64 * asked.result_bytes() <= limit);
            }
        }
        let asked = |room| Asked {
            kernel: NearKernel::OverlappedTriangles,
            room,
            rows: 4,
            ignore: None,
            any: false,
        };
        assert_eq!([asked(16).room_for(1, limit), asked(600_001).room_for(1, limit)], [64, 1]);
    }
}

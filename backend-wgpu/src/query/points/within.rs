//! The points within a radius, as a device finds them: it counts them, and then lists those of a run of queries at a time.

use std::ops::Range;

use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::kernel::{PointQueryBuffer, PointQueryKernel};
use splitplane_core::layout::PointBatch;
use splitplane_core::points::lists::NeighbourLists;
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop, within};
use wgpu::BufferUsages as Usage;

use super::super::settle::Asking;
use super::batch::Asked;
use super::nearest::words_of;
use super::tree::WgpuPointTree;
use crate::device::clock::Instant;
use crate::device::readback::read;
use crate::device::scope::checked;

/// Most keys of a run, and most queries.
const MOST_KEYS: u64 = 1 << 20;
const MOST_QUERIES: usize = 1 << 16;

impl<const N: usize> WgpuPointTree<N> {
    /// The points within [`NearestOptions::max_distance`] of a query, least (distance, index) first; k does not count. The host finds them: a
    /// round trip to the device takes longer.
    ///
    /// # Errors
    /// More memory than allowed, or than the system has.
    pub fn within(
        &self,
        query: [f32; N],
        options: &NearestOptions<'_>,
    ) -> Result<Vec<Neighbour>, QueryError> {
        within(self.tree(), query, options)
    }

    /// The points within [`NearestOptions::max_distance`] of each query of a batch, found on the device. Which queries the host answers is said at
    /// [`WgpuPointTree::nearest`]; besides these, those that find more than a million points.
    ///
    /// # Errors
    /// More memory than allowed or than the system has, a watch that cancels the batch, or a device that fails.
    pub fn within_each(
        &self,
        queries: &[[f32; N]],
        options: &NearestOptions<'_>,
    ) -> Result<NeighbourLists, QueryError> {
        let asking = &Asking::new(options.watch, queries.len());
        asking.check()?;
        let mut lists = NeighbourLists::default();
        let stop = first_stop(self.tree().unit(), [0.0; N], options.max_distance);
        let on_device =
            stop > 0 && !self.tree().is_empty() && self.filter_is_worth_it(queries.len(), options);
        if !on_device {
            for &query in queries {
                asking.check()?;
                self.push_on_host(query, &mut lists, options)?;
                asking.advance(1);
            }
            asking.check()?;
            return Ok(lists);
        }
        let allowed = self.allowed(options)?;
        let reach = (stop >> 32) as u32;
        let asked = Asked {
            kernel: PointQueryKernel::CountWithin,
            room: 1,
            reach,
            allowed: allowed.as_ref(),
        };
        let counts = self.count_within(queries, &asked, options, asking)?;
        let asked = Asked { kernel: PointQueryKernel::ListWithin, ..asked };
        let mut next = 0;
        while next < queries.len() {
            let run = self.next_run(&counts, next, options);
            self.list_run(queries, &counts, run.clone(), &asked, &mut lists, options, asking)?;
            asking.advance(run.len());
            asking.check()?;
            next = run.end;
        }
        Ok(lists)
    }

    /// How many points are within reach of each query, or [`PointBatch::ENDED_EARLY`] where the host must say.
    fn count_within(
        &self,
        queries: &[[f32; N]],
        asked: &Asked<'_>,
        options: &NearestOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<Vec<u32>, QueryError> {
        let mut counts: Vec<u32> = Vec::new();
        let needed = 4 * queries.len() as u64;
        check_bytes(needed, options.max_memory)?;
        counts.try_reserve_exact(queries.len()).map_err(|_| refused(needed))?;
        self.ask_slices(queries, asked, options.max_memory, asking, |range, bytes| {
            let own = queries[range].iter().zip(bytes.chunks_exact(4));
            counts.extend(own.map(|(&query, word)| match self.on_device(query) {
                Some(_) => bytemuck::pod_read_unaligned(word),
                None => PointBatch::ENDED_EARLY,
            }));
            Ok(())
        })?;
        Ok(counts)
    }

    /// Keys that a count takes on the device; none where the host answers.
    fn keys_of(&self, count: u32) -> u64 {
        let fits = u64::from(count) <= MOST_KEYS.min(self.queries().buffer_limit() / 8);
        if fits && count <= self.device().count { u64::from(count) } else { 0 }
    }

    /// The queries from `first` on whose lists are made together.
    fn next_run(&self, counts: &[u32], first: usize, options: &NearestOptions<'_>) -> Range<usize> {
        let by_caller = options.max_memory.map_or(u64::MAX, |most| most / 64);
        let most = MOST_KEYS.min(self.queries().buffer_limit() / 8).min(by_caller);
        let (mut end, mut keys) = (first, 0);
        while end < counts.len() && end - first < MOST_QUERIES {
            keys += self.keys_of(counts[end]);
            if keys > most && end > first {
                break;
            }
            end += 1;
        }
        first..end
    }

    /// Lists the points of the queries of a run.
    #[expect(clippy::too_many_arguments, reason = "a batch, a part of it, and what it adds to")]
    fn list_run(
        &self,
        queries: &[[f32; N]],
        counts: &[u32],
        run: Range<usize>,
        asked: &Asked<'_>,
        lists: &mut NeighbourLists,
        options: &NearestOptions<'_>,
        asking: &Asking<'_>,
    ) -> Result<(), QueryError> {
        let mut starts = Vec::new();
        let refuse = |_| refused(4 * run.len() as u64);
        starts.try_reserve_exact(run.len() + 1).map_err(refuse)?;
        let mut keys = 0;
        for &count in &counts[run.clone()] {
            starts.push(keys as u32);
            keys += self.keys_of(count);
        }
        starts.push(keys as u32);
        // Keys as they come back, and the records of them.
        check_bytes(lists.bytes() + 24 * keys, options.max_memory)?;
        let [found, again] = self.ask_run(&queries[run.clone()], &starts, asked, asking)?;
        let mut own = Vec::new();
        for (at, place) in run.enumerate() {
            let (start, end) = (starts[at] as usize, starts[at + 1] as usize);
            let said = bytemuck::pod_read_unaligned::<u32>(&again[4 * at..4 * at + 4]);
            own.clear();
            let bytes = &found[8 * start..8 * end];
            own.try_reserve(end - start).map_err(|_| refused(8 * keys))?;
            own.extend(bytes.chunks_exact(8).map(|pair| {
                let [squared, index] = words_of(pair);
                u64::from(squared) << 32 | u64::from(index)
            }));
            own.sort_unstable();
            let given = self.tree().report().points;
            let is_known = own.iter().all(|&key| (key as u32) < given);
            if counts[place] == said && said as usize == end - start && is_known {
                let unit = self.tree().unit();
                let list = own.iter().map(|&key| Neighbour::of(unit, key));
                lists.push(list, options.max_memory)?;
                continue;
            }
            let is_near = self.on_device(queries[place]).is_some();
            lists.report.unfinished += u64::from(is_near && said == PointBatch::ENDED_EARLY);
            asking.check()?;
            self.push_on_host(queries[place], lists, options)?;
        }
        Ok(())
    }

    /// The keys of a run, and how many of each query there are.
    fn ask_run(
        &self,
        queries: &[[f32; N]],
        starts: &[u32],
        asked: &Asked<'_>,
        asking: &Asking<'_>,
    ) -> Result<[Vec<u8>; 2], QueryError> {
        let gpu = self.queries().gpu();
        let (count, keys) = (queries.len(), u64::from(starts[queries.len()]));
        let (counts, found, done) =
            checked(gpu, "lists of points", || {
                let storage = Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC;
                let uniform = Usage::UNIFORM | Usage::COPY_DST;
                let uniform =
                    gpu.buffer("a batch of queries", size_of::<PointBatch>() as u64, uniform)?;
                let own = gpu.buffer("queries", 16 * count as u64, storage)?;
                let begin = gpu.buffer("starts of lists", 4 * starts.len() as u64, storage)?;
                let found = gpu.buffer("points found", (8 * keys).max(8), storage)?;
                let counts = gpu.buffer("numbers of points", 4 * count as u64, storage)?;
                let words = self.uniform(count as u32, asked);
                gpu.write(&uniform, 0, bytemuck::bytes_of(&words));
                gpu.write(&begin, 0, bytemuck::cast_slice(starts));
                self.write_queries(queries, &own)?;
                let mut encoder = gpu.device().create_command_encoder(&Default::default());
                self.record(&mut encoder, [&uniform, &own], count as u32, asked, |buffer| {
                    match buffer {
                        PointQueryBuffer::Found => Some(&found),
                        PointQueryBuffer::Counts => Some(&counts),
                        PointQueryBuffer::Starts => Some(&begin),
                        _ => None,
                    }
                })?;
                gpu.submit([encoder.finish()])?;
                Ok((counts, found, asking.watch().map(|_| gpu.submitted_work_done().0)))
            })?;
        if let Some(done) = done {
            self.watch_until(&done, Instant::now(), asking)?;
        }
        let found = read(gpu, &found, 0, 8 * keys)?;
        Ok([found, read(gpu, &counts, 0, 4 * count as u64)?])
    }

    /// The reference answers a query.
    fn push_on_host(
        &self,
        query: [f32; N],
        lists: &mut NeighbourLists,
        options: &NearestOptions<'_>,
    ) -> Result<(), QueryError> {
        let left = options.max_memory.map(|most| most.saturating_sub(lists.bytes()));
        let within_left = NearestOptions { watch: None, max_memory: left, ..*options };
        let list = self.within(query, &within_left)?;
        lists.push(list.into_iter(), options.max_memory)?;
        lists.report.answered_by_cpu += 1;
        Ok(())
    }
}

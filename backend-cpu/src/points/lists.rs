//! All points within a radius: of one query, and of many under one limit of memory.

use core::sync::atomic::{AtomicU64, Ordering::Relaxed};

use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::points::lists::NeighbourLists;
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop};
use splitplane_core::watch::Stage;
use splitplane_float_state::standard;

use super::search::{NO_FRAMES, Visitor};
use super::tree::CpuPointTree;
use crate::cancel::{ProgressMeter, UNWATCHED};
use crate::parallel::{Parallel, ParallelSlice};

/// Most queries that are answered side by side. Their lists wait for one another.
const TOGETHER: usize = 1024;
/// Bytes of a key and its record, both of which are held while a list is finished.
const RECORD: u64 = (size_of::<u64>() + size_of::<Neighbour>()) as u64;
/// Bytes of a record.
const NEIGHBOUR: u64 = size_of::<Neighbour>() as u64;
/// Records by which a list that shares a limit grows, at least.
const STEP: u64 = 32;

/// Bytes that the caller of [`CpuPointTree::for_each_within`] keeps of the lists. They count against the limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeptBytes {
    /// Of each list, however long.
    pub list: u64,
    /// Of each point in a list.
    pub neighbour: u64,
}

impl KeptBytes {
    fn of(self, found: &[Neighbour]) -> u64 {
        self.list.saturating_add(self.neighbour.saturating_mul(found.len() as u64))
    }
}

impl<const N: usize> CpuPointTree<N> {
    /// The points within [`NearestOptions::max_distance`] of a query, least (distance, index) first; k does not count.
    ///
    /// # Errors
    /// More memory than allowed, or than the system has.
    pub fn within(
        &self,
        query: [f32; N],
        options: &NearestOptions<'_>,
    ) -> Result<Vec<Neighbour>, QueryError> {
        self.list(query, options, Alone(options.max_memory), &UNWATCHED)
    }

    /// The points within [`NearestOptions::max_distance`] of each query, as [`CpuPointTree::within`] finds them. `keep` is shown one
    /// list after the other, in the order of the queries, by the calling thread; the pool's threads find them.
    ///
    /// Lists that are found wait for those before them. [`NearestOptions::max_memory`] is for all of them together, and for what `keep`
    /// stores, which is said by `kept`. Where they have no room beside one another fewer are found at a time. So whether the limit
    /// suffices depends on no thread: it is exceeded when one list beside what was kept before it exceeds it.
    ///
    /// ```
    /// use splitplane_cpu::{CpuPointTree, KeptBytes};
    /// use splitplane_core::error::QueryError;
    /// use splitplane_core::points::{build::PointOptions, nearest::NearestOptions};
    ///
    /// let points = [[0.0], [1.0], [4.0]];
    /// let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
    /// let options = NearestOptions { max_distance: 3.0, ..NearestOptions::default() };
    /// let mut counts = Vec::new();
    /// tree.for_each_within(&points, &options, KeptBytes { list: 8, neighbour: 0 }, |found| {
    ///     counts.push(found.len());
    ///     Ok::<(), QueryError>(())
    /// })
    /// .unwrap();
    /// assert_eq!(counts, [2, 3, 2]);
    /// ```
    ///
    /// # Errors
    /// What `keep` returns, more memory than allowed or than the system has, or a watch that cancels the batch.
    pub fn for_each_within<E: From<QueryError>>(
        &self,
        queries: &[[f32; N]],
        options: &NearestOptions<'_>,
        kept: KeptBytes,
        mut keep: impl FnMut(&[Neighbour]) -> Result<(), E>,
    ) -> Result<(), E> {
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, queries.len() as u64);
        let limit = options.max_memory;
        let (mut left, mut together, mut held) = (queries, TOGETHER, 0u64);
        while !left.is_empty() {
            meter.check_batch()?;
            let few = &left[..together.min(left.len())];
            let budget = Budget::new(limit.map(|limit| limit.saturating_sub(held)));
            let find = |query: &[f32; N]| self.list(*query, options, Shared::of(&budget), meter);
            let lists: Vec<Result<Vec<Neighbour>, QueryError>> = few.par_iter().collect(find);
            meter.check_batch()?;
            let mut done = 0;
            for list in lists {
                let Ok(list) = list else { break };
                // By itself it must have room too, as if the pool had one thread.
                let alone = RECORD * list.len() as u64;
                if check_bytes(held.saturating_add(alone), limit).is_err()
                    || !budget.take(kept.of(&list))
                {
                    break;
                }
                keep(&list)?;
                held = held.saturating_add(kept.of(&list));
                budget.give(NEIGHBOUR * list.len() as u64);
                done += 1;
            }
            meter.advance(done as u64);
            if done == few.len() {
                together = (2 * together).min(TOGETHER);
                left = &left[done..];
                continue;
            }
            // Those behind it are gone by now, so this one may take all that is left.
            let alone = Alone(limit.map(|limit| limit.saturating_sub(held)));
            let list = self.list(left[done], options, alone, meter);
            let list = list.map_err(|error| beside(error, held, limit))?;
            // A list that was given up is no answer.
            meter.check_batch()?;
            let own = NEIGHBOUR * list.len() as u64;
            held = held.saturating_add(kept.of(&list));
            check_bytes(held.saturating_add(own), limit)?;
            keep(&list)?;
            meter.advance(1);
            together = done.max(1);
            left = &left[done + 1..];
        }
        meter.finish_stage();
        Ok(meter.check_batch()?)
    }

    /// The points within [`NearestOptions::max_distance`] of each query, least (distance, index) first; k does not count.
    ///
    /// # Errors
    /// More memory than allowed, or than the system has, or a watch that cancels the batch.
    pub fn within_each(
        &self,
        queries: &[[f32; N]],
        options: &NearestOptions<'_>,
    ) -> Result<NeighbourLists, QueryError> {
        let mut lists = NeighbourLists::default();
        let kept = KeptBytes { list: size_of::<usize>() as u64, neighbour: NEIGHBOUR };
        self.for_each_within(queries, options, kept, |found| {
            lists.push(found.iter().copied(), options.max_memory)
        })?;
        Ok(lists)
    }

    fn list(
        &self,
        query: [f32; N],
        options: &NearestOptions<'_>,
        room: impl Room,
        meter: &ProgressMeter<'_>,
    ) -> Result<Vec<Neighbour>, QueryError> {
        if meter.is_cancelled() {
            return Ok(Vec::new());
        }
        standard(|| self.list_in_state(query, options, room, meter))
    }

    fn list_in_state(
        &self,
        query: [f32; N],
        options: &NearestOptions<'_>,
        room: impl Room,
        meter: &ProgressMeter<'_>,
    ) -> Result<Vec<Neighbour>, QueryError> {
        let stop = first_stop(self.tree().unit(), query, options.max_distance);
        let filter = options.filter;
        let mut list =
            List { stop, keys: Vec::new(), filter, room, failed: None, visits: 0, meter };
        self.search(query, &mut list, &mut { NO_FRAMES });
        meter.record_work(1 + list.visits % BETWEEN_CHECKS);
        if let Some(error) = list.failed {
            return Err(error);
        }
        // A long list that was given up need not be sorted.
        if meter.is_cancelled() {
            return Ok(Vec::new());
        }
        list.keys.sort_unstable();
        let mut found = Vec::new();
        let bytes = list.keys.len() as u64 * RECORD;
        found.try_reserve_exact(list.keys.len()).map_err(|_| refused(bytes))?;
        found.extend(list.keys.iter().map(|&key| Neighbour::of(self.tree().unit(), key)));
        list.room.keep(found.len() as u64 * NEIGHBOUR);
        Ok(found)
    }
}

/// The error of a list as one of the batch: `held` bytes are kept beside it.
fn beside(error: QueryError, held: u64, limit: Option<u64>) -> QueryError {
    match (error, limit) {
        (QueryError::OutOfMemory { needed, limit: own }, Some(limit)) if needed > own => {
            QueryError::OutOfMemory { needed: needed.saturating_add(held), limit }
        }
        (QueryError::OutOfMemory { needed, .. }, _) => refused(needed.saturating_add(held)),
        (error, _) => error,
    }
}

/// The memory that a list may take.
trait Room {
    /// Room for one record more than so many.
    fn grow(&mut self, records: u64) -> Result<(), QueryError>;
    /// From now on it holds so many bytes.
    fn keep(&mut self, bytes: u64);
}

/// A list has its limit for itself.
struct Alone(Option<u64>);

impl Room for Alone {
    #[inline(always)]
    fn grow(&mut self, records: u64) -> Result<(), QueryError> {
        check_bytes((records + 1) * RECORD, self.0)
    }
    fn keep(&mut self, _: u64) {}
}

/// What is left of a limit, for lists that grow at the same time.
struct Budget(Option<AtomicU64>);

impl Budget {
    fn new(left: Option<u64>) -> Budget {
        Budget(left.map(AtomicU64::new))
    }

    fn take(&self, bytes: u64) -> bool {
        let taken = |left: u64| left.checked_sub(bytes);
        self.0.as_ref().is_none_or(|left| left.fetch_update(Relaxed, Relaxed, taken).is_ok())
    }

    fn give(&self, bytes: u64) {
        if let Some(left) = &self.0 {
            left.fetch_add(bytes, Relaxed);
        }
    }
}

/// The part of a budget that one list has; what it does not keep goes back.
struct Shared<'a> {
    budget: &'a Budget,
    bytes: u64,
}

impl<'a> Shared<'a> {
    fn of(budget: &'a Budget) -> Shared<'a> {
        Shared { budget, bytes: 0 }
    }
}

impl Room for Shared<'_> {
    #[inline(always)]
    fn grow(&mut self, records: u64) -> Result<(), QueryError> {
        if self.budget.0.is_none() || (records + 1) * RECORD <= self.bytes {
            return Ok(());
        }
        let more = self.bytes.max(STEP * RECORD);
        match self.budget.take(more) {
            true => self.bytes += more,
            false => return Err(refused((records + 1) * RECORD)),
        }
        Ok(())
    }

    fn keep(&mut self, bytes: u64) {
        if self.budget.0.is_some() {
            self.budget.give(self.bytes - bytes);
            // Whoever takes the list gives this back.
            self.bytes = 0;
        }
    }
}

impl Drop for Shared<'_> {
    fn drop(&mut self) {
        self.budget.give(self.bytes);
    }
}

/// Points of one list between two looks at whether it is still wanted.
const BETWEEN_CHECKS: u64 = 1 << 13;

struct List<'a, 'w, R> {
    stop: u64,
    keys: Vec<u64>,
    filter: Option<&'a (dyn Fn(u32) -> bool + Sync)>,
    room: R,
    failed: Option<QueryError>,
    /// Points that were visited.
    visits: u64,
    meter: &'a ProgressMeter<'w>,
}

impl<R: Room> Visitor for List<'_, '_, R> {
    #[inline(always)]
    fn stop(&self) -> u64 {
        self.stop
    }
    fn visit(&mut self, key: u64) {
        self.visits += 1;
        if self.visits.is_multiple_of(BETWEEN_CHECKS) && self.meter.record_work(BETWEEN_CHECKS) {
            self.stop = 0;
            return;
        }
        if self.filter.is_some_and(|filter| !filter(key as u32)) {
            return;
        }
        let records = self.keys.len() as u64;
        let reserved = |()| self.keys.try_reserve(1).map_err(|_| refused((records + 1) * RECORD));
        match self.room.grow(records).and_then(reserved) {
            Ok(()) => self.keys.push(key),
            Err(error) => (self.failed, self.stop) = (Some(error), 0),
        }
    }
}

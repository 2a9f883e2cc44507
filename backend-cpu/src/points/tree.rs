//! The point tree of this backend.

use splitplane_core::arithmetic::Strict;
use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::points::build::{PointBuildError, PointOptions, Survey};
use splitplane_core::points::collect::Collector;
use splitplane_core::points::distance::{NOTHING, distance_of, distance_squared, key};
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop};
use splitplane_core::points::tree::{BLOCK, PointNode, PointTree, height};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::watch::{Progress, Stage};
use splitplane_float_state::Standard;

use super::columns::Columns;
use super::divide::{Divide, Finish, Work};
use super::few::{FEW, Few};
use super::gather::{Gather, Spread};
use super::layout::{LEVELS, Line, PointLayout, WIDTH, numbers};
use super::order::along_curve;
use super::search::{Frames, GROUP, GroupSearch, NO_FRAMES, Search, Searched, Visitor};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::memory::lengthen;
use crate::parallel::{Parallel, ParallelSlice};
use crate::simd::InstructionSet;

/// Subtrees of fewer points are one task.
const TASK: usize = 1 << 14;
/// Most queries that are put in order at a time.
const CHUNK: usize = 1 << 16;
/// From so many neighbours on the query before pays for a first bound.
const MANY: usize = 20;
/// Queries between two checks of the watch.
const BETWEEN_CHECKS: usize = 64;

/// A point tree and what this backend searches it by. Bytes and answers are the reference's
/// ([`splitplane_core::points`]), on any number of threads and any instruction set.
///
/// ```
/// use splitplane_cpu::CpuPointTree;
/// use splitplane_core::points::build::PointOptions;
/// use splitplane_core::points::nearest::{NearestOptions, Neighbour};
///
/// let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 5.0, 0.0]];
/// let tree = CpuPointTree::build(&points, &PointOptions::default()).unwrap();
/// let mut found = [Neighbour::NONE; 2];
/// let options = NearestOptions { k: 2, ..NearestOptions::default() };
/// tree.nearest(&[[0.9, 0.0, 0.0]], &mut found, &options).unwrap();
/// assert_eq!(found.map(|neighbour| neighbour.point), [1, 0]);
/// ```
#[derive(Debug)]
pub struct CpuPointTree<const N: usize> {
    tree: PointTree<N>,
    layout: PointLayout<N>,
    set: InstructionSet,
}

impl<const N: usize> CpuPointTree<N> {
    /// Builds the tree of points, on all threads of the pool.
    ///
    /// # Errors
    /// See [`PointBuildError`].
    pub fn build(
        points: &[[f32; N]],
        options: &PointOptions<'_>,
    ) -> Result<CpuPointTree<N>, PointBuildError> {
        CpuPointTree::build_on(points, options, InstructionSet::detect())
    }

    /// [`CpuPointTree::build`], on a set that the processor has.
    pub(super) fn build_on(
        points: &[[f32; N]],
        options: &PointOptions<'_>,
        set: InstructionSet,
    ) -> Result<CpuPointTree<N>, PointBuildError> {
        let _state = Standard::set();
        let meter = &ProgressMeter::of(options.watch);
        let survey = Survey::of(points)?;
        let total = survey.kept();
        let needed = build_bytes::<N>(total);
        if let Some(limit) = options.max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        meter.begin_stage(Stage::Points, total as u64);
        let blocks = total.div_ceil(BLOCK);
        let refused = |_| PointBuildError::OutOfMemory { needed, limit: needed };
        let (mut lines, mut ordered, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
        let (mut indices, mut spare) = (Vec::new(), Vec::new());
        lengthen(&mut lines, N * blocks, Line::NOWHERE).map_err(refused)?;
        lengthen(&mut indices, blocks * BLOCK, 0).map_err(refused)?;
        lengthen(&mut spare, blocks * BLOCK, 0).map_err(refused)?;
        lengthen(&mut ordered, blocks * BLOCK, [0.0; N]).map_err(refused)?;
        let none = PointNode { plane: 0.0, axis: 0 };
        lengthen(&mut nodes, blocks.saturating_sub(1), none).map_err(refused)?;
        let mut columns = Columns::new(numbers(&mut lines), &mut indices);
        let (all, unit) = (total == points.len(), survey.unit);
        // SAFETY: the processor has the set.
        unsafe { set.run(Gather { points, all, unit, columns: &mut columns }) };
        if blocks > 0 {
            let work = Work {
                axes: options.axes,
                height: height(total),
                level: 0,
                points: total,
                columns,
                // Where the points will stand in the order of the tree.
                spare: Columns::new(ordered.as_flattened_mut(), &mut spare),
                moved: false,
                nodes: &mut nodes,
            };
            grow(work, set, meter);
        }
        drop(spare);
        meter.finish_stage();
        if let Err(splitplane_core::error::BuildError::Cancelled {
            progress: Progress { done, total, .. },
        }) = meter.check()
        {
            return Err(PointBuildError::Cancelled { done, total });
        }
        indices.truncate(total);
        ordered.truncate(total);
        // SAFETY: the processor has the set.
        unsafe { set.run(Spread { columns: &lines, points: &mut ordered }) };
        let layout = PointLayout::of_columns(total, lines, set).map_err(refused)?;
        let tree = survey.finish(options.axes, nodes, ordered, indices);
        Ok(CpuPointTree { tree, layout, set })
    }

    /// What searches a tree that is there. `max_memory` limits the bytes of both.
    ///
    /// # Errors
    /// [`PointBuildError::OutOfMemory`].
    pub fn of(
        tree: PointTree<N>,
        max_memory: Option<u64>,
    ) -> Result<CpuPointTree<N>, PointBuildError> {
        let _state = Standard::set();
        let needed = bytes::<N>(tree.len());
        if let Some(limit) = max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        let set = InstructionSet::detect();
        let layout = PointLayout::new(&tree, set);
        let layout = layout.map_err(|_| PointBuildError::OutOfMemory { needed, limit: needed })?;
        Ok(CpuPointTree { tree, layout, set })
    }

    /// The tree itself.
    pub fn tree(&self) -> &PointTree<N> {
        &self.tree
    }

    /// Bytes of the tree and of what searches it.
    pub fn bytes(&self) -> u64 {
        bytes::<N>(self.tree.len())
    }

    /// Searches with an instruction set that is not the best one; nothing changes where the processor does not have it.
    #[must_use]
    pub fn with_instruction_set(mut self, set: InstructionSet) -> CpuPointTree<N> {
        if InstructionSet::available().contains(&set) {
            self.set = set;
        }
        self
    }

    /// The k nearest points of each query, k records each, least (distance, index) first; [`Neighbour::NONE`] where there is
    /// no further one. After an error `found` holds the answers to some of the queries, and nothing says which.
    ///
    /// # Errors
    /// `found` not of k times as many records as there are queries, more memory than allowed or than the system has, or a watch that
    /// cancels the batch.
    pub fn nearest(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
    ) -> Result<(), QueryError> {
        let k = options.k;
        let places = queries.len().saturating_mul(k);
        check_lengths(places, found.len())?;
        let meter = &ProgressMeter::of(options.watch);
        meter.begin_stage(Stage::Rays, queries.len() as u64);
        if places > 0 {
            let threads = rayon::current_num_threads();
            let chunk = queries.len().div_ceil(4 * threads).clamp(1024, CHUNK);
            let chunk = if threads == 1 { CHUNK } else { chunk };
            let each = Collector::bytes(k.min(self.tree.len())) + 2 * 8 * chunk as u64;
            let most = threads.min(queries.len().div_ceil(chunk)) as u64;
            check_bytes(each * most, options.max_memory)?;
            queries.par_chunks(chunk).zip(found.par_chunks_mut(chunk * k)).try_for_each(
                |(queries, found)| self.chunk(queries, found, options, meter, each),
            )?;
        }
        meter.finish_stage();
        meter.check_batch()
    }

    fn chunk(
        &self,
        queries: &[[f32; N]],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
        meter: &ProgressMeter<'_>,
        bytes: u64,
    ) -> Result<(), QueryError> {
        let _state = Standard::set();
        let refused = |_| refused(bytes);
        let k = options.k;
        let mut collector = Collector::new(k, self.tree.len()).map_err(refused)?;
        let (mut keys, mut spare) = (Vec::new(), Vec::new());
        keys.try_reserve_exact(queries.len()).map_err(refused)?;
        spare.try_reserve_exact(queries.len()).map_err(refused)?;
        let (lower, upper) = self.bounds();
        along_curve(queries, lower, upper, &mut keys, &mut spare);
        let unit = self.tree.unit();
        let mut frames = [NO_FRAMES; GROUP];
        let mut before = None;
        for few in keys.chunks(BETWEEN_CHECKS) {
            if meter.is_cancelled() {
                break;
            }
            if k <= FEW && options.filter.is_none() {
                for some in few.chunks(GROUP) {
                    self.group(queries, some, found, options, &mut frames);
                }
                meter.advance(few.len() as u64);
                meter.record_work(WORK_BETWEEN_CHECKS);
                continue;
            }
            for &key in few {
                let place = key as u32 as usize;
                let query = queries[place];
                let records = &mut found[place * k..][..k];
                let stop = first_stop(unit, query, options.max_distance);
                let at = self.tree.in_units(query);
                collector.begin(if k < MANY { stop } else { stop.min(reach(before, &at)) });
                match options.filter {
                    None => self.search(query, &mut Plain(&mut collector), &mut frames[0]),
                    Some(filter) => {
                        let mut filtered = Filtered(&mut collector, filter);
                        self.search(query, &mut filtered, &mut frames[0]);
                    }
                }
                let keys = collector.finish();
                before = (keys.len() == k).then(|| (at, distance_of(keys[k - 1])));
                for (record, &key) in records.iter_mut().zip(keys) {
                    *record = Neighbour::of(unit, key);
                }
                records[keys.len()..].fill(Neighbour::NONE);
            }
            meter.advance(few.len() as u64);
            meter.record_work(WORK_BETWEEN_CHECKS);
        }
        Ok(())
    }

    /// Answers a few queries side by side, whose places the lower halves of `keys` are.
    fn group(
        &self,
        queries: &[[f32; N]],
        keys: &[u64],
        found: &mut [Neighbour],
        options: &NearestOptions<'_>,
        frames: &mut [Frames; GROUP],
    ) {
        let (k, unit) = (options.k, self.tree.unit());
        let (mut at, mut stops) = ([[0.0; N]; GROUP], [0; GROUP]);
        for (number, &key) in keys.iter().enumerate() {
            let query = queries[key as u32 as usize];
            at[number] = self.tree.in_units(query);
            stops[number] = first_stop(unit, query, options.max_distance).min(NOTHING);
        }
        let at = &at[..keys.len()];
        let mut write = |number: usize, keys_found: &[u64]| {
            let place = keys[number] as u32 as usize;
            for (record, &key) in found[place * k..][..k].iter_mut().zip(keys_found) {
                let is_found = key < stops[number];
                *record = if is_found { Neighbour::of(unit, key) } else { Neighbour::NONE };
            }
        };
        if k == 1 {
            let mut nearest = stops.map(Nearest);
            self.search_group(at, &mut nearest[..at.len()], frames);
            for (number, nearest) in nearest[..at.len()].iter().enumerate() {
                write(number, &[nearest.0]);
            }
        } else {
            let mut few = stops.map(|stop| Few::new(k, stop));
            self.search_group(at, &mut few[..at.len()], frames);
            for (number, few) in few[..at.len()].iter().enumerate() {
                write(number, few.keys());
            }
        }
    }

    fn search_group<V: Visitor>(
        &self,
        queries: &[[f32; N]],
        visitors: &mut [V],
        frames: &mut [Frames; GROUP],
    ) {
        let searched = self.searched();
        // SAFETY: `set` was detected on this processor.
        unsafe { self.set.run(GroupSearch { searched, queries, visitors, frames }) }
    }

    fn searched(&self) -> Searched<'_, N> {
        Searched { layout: &self.layout, tree: &self.tree }
    }

    /// The box around all points, in the caller's unit, about.
    fn bounds(&self) -> ([f32; N], [f32; N]) {
        let (mut lower, mut upper) = ([0.0; N], [0.0; N]);
        if let Some(root) = self.layout.levels.last() {
            let unit = self.tree.unit().exponent() as f32;
            for axis in 0..N {
                let [lo, hi] = &root[0][axis];
                lower[axis] = lo.0.iter().copied().fold(f32::INFINITY, f32::min) * unit.exp2();
                upper[axis] = hi.0.iter().copied().fold(f32::NEG_INFINITY, f32::max) * unit.exp2();
            }
        }
        (lower, upper)
    }

    #[inline]
    pub(super) fn search<V: Visitor>(&self, query: [f32; N], visitor: &mut V, frames: &mut Frames) {
        let query = self.tree.in_units(query);
        // SAFETY: `set` was detected on this processor.
        unsafe { self.set.run(Search { searched: self.searched(), query, visitor, frames }) }
    }
}

const _: () = assert!(WIDTH.pow(LEVELS as u32) >= (1 << 30) / WIDTH);

/// Bytes of a tree of so many points and its layout.
fn bytes<const N: usize>(points: usize) -> u64 {
    let nodes = points.div_ceil(BLOCK).saturating_sub(1) * size_of::<PointNode>();
    let each = size_of::<[f32; N]>() + size_of::<u32>();
    PointLayout::<N>::bytes(points)
        + PointTree::<N>::summary_bytes(points)
        + (points * each + nodes) as u64
}

/// Bytes of a build: besides, a second column of indices, and the rest of the last block.
fn build_bytes<const N: usize>(points: usize) -> u64 {
    bytes::<N>(points)
        + ((points + 2 * BLOCK) * size_of::<u32>() + BLOCK * size_of::<[f32; N]>()) as u64
}

/// Builds a subtree, the children of large nodes side by side.
fn grow<const N: usize>(work: Work<'_, N>, set: InstructionSet, meter: &ProgressMeter<'_>) {
    let _state = Standard::set();
    if meter.is_cancelled() {
        return;
    }
    let points = work.points;
    if points <= TASK {
        // SAFETY: `set` was detected on this processor.
        unsafe { set.run(Finish(work)) };
        meter.advance(points as u64);
        meter.record_work(points as u64);
        return;
    }
    // SAFETY: `set` was detected on this processor.
    let [left, right] = unsafe { set.run(Divide(work)) };
    rayon::join(|| grow(left, set, meter), || grow(right, set, meter));
}

/// See [`reach`]: 2^-60.
const HIDDEN: f32 = 8.673_617_4e-19;

/// Keys from here on are not among the k least of a query, by the query before it and the squared distance of its k-th point: those
/// k points are at most so far from it, and it from the query. What sums and roots round is far less than 2^-16 of the distance. A square
/// that is snapped hides a difference of less than 2^-63, so two distances hide less than 2^-61 (4 axes), and 2^-60 is added.
fn reach<const N: usize>(before: Option<([f32; N], f32)>, query: &[f32; N]) -> u64 {
    let Some((other, squared)) = before else { return NOTHING };
    let apart = distance_squared::<Strict, N>(*query, other);
    let reach = (apart.sqrt() + squared.sqrt()) * (1.0 + 1.0 / 65_536.0) + HIDDEN;
    let squared = reach * reach;
    if squared < f32::INFINITY { key(squared, u32::MAX) } else { NOTHING }
}

/// The least key.
struct Nearest(u64);

impl Visitor for Nearest {
    const ONE: bool = true;
    #[inline(always)]
    fn stop(&self) -> u64 {
        self.0
    }
    #[inline(always)]
    fn visit(&mut self, key: u64) {
        self.0 = key;
    }
}

struct Plain<'a>(&'a mut Collector);

impl Visitor for Plain<'_> {
    #[inline(always)]
    fn stop(&self) -> u64 {
        self.0.stop()
    }
    #[inline(always)]
    fn visit(&mut self, key: u64) {
        self.0.add(key);
    }
}

struct Filtered<'a>(&'a mut Collector, &'a (dyn Fn(u32) -> bool + Sync));

impl Visitor for Filtered<'_> {
    #[inline(always)]
    fn stop(&self) -> u64 {
        self.0.stop()
    }
    #[inline(always)]
    fn visit(&mut self, key: u64) {
        if (self.1)(key as u32) {
            self.0.add(key);
        }
    }
}

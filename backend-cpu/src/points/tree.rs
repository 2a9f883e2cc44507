//! The point tree of this backend.

use rayon::prelude::*;
use splitplane_core::arithmetic::Strict;
use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::points::build::{PointBuild, PointBuildError, PointOptions};
use splitplane_core::points::collect::Collector;
use splitplane_core::points::distance::{NOTHING, distance_of, distance_squared, key};
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop};
use splitplane_core::points::tree::{PointTree, Record, height};
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::watch::{Progress, Stage};

use super::divide::{Divide, Finish, Keys, NO_KEYS, Work};
use super::layout::{LEVELS, PointLayout, WIDTH};
use super::order::along_curve;
use super::search::{Frames, NO_FRAMES, Search, Visitor};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::simd::InstructionSet;

/// Subtrees of fewer points are one task.
const TASK: usize = 1 << 14;
/// Most queries that are put in order at a time.
const CHUNK: usize = 1 << 16;
/// From so many neighbours on the query before pays for a first bound.
const MANY: usize = 20;
/// Queries between two checks of the watch.
const FEW: usize = 64;

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
        let meter = &ProgressMeter::of(options.watch);
        let mut build = PointBuild::new(points, options)?;
        let total = build.records.len();
        meter.begin_stage(Stage::Points, total as u64);
        // As many bytes as the tree's points and indices take, which are not there yet.
        let bytes = (total * size_of::<Record<N>>()) as u64;
        let refused = |_| PointBuildError::OutOfMemory { needed: bytes, limit: bytes };
        let mut spare = Vec::new();
        spare.try_reserve_exact(total).map_err(refused)?;
        spare.resize(total, Record { bits: [0; N], point: 0 });
        let work = Work {
            axes: options.axes,
            height: height(total),
            level: 0,
            records: &mut build.records,
            spare: &mut spare,
            moved: false,
            nodes: &mut build.nodes,
        };
        grow(work, InstructionSet::detect(), &mut { NO_KEYS }, meter);
        drop(spare);
        meter.finish_stage();
        if let Err(splitplane_core::error::BuildError::Cancelled {
            progress: Progress { done, total, .. },
        }) = meter.check()
        {
            return Err(PointBuildError::Cancelled { done, total });
        }
        CpuPointTree::of(build.finish()?, options.max_memory)
    }

    /// What searches a tree that is there. `max_memory` limits the bytes of both.
    ///
    /// # Errors
    /// [`PointBuildError::OutOfMemory`].
    pub fn of(
        tree: PointTree<N>,
        max_memory: Option<u64>,
    ) -> Result<CpuPointTree<N>, PointBuildError> {
        let needed = bytes(&tree);
        if let Some(limit) = max_memory.filter(|&limit| needed > limit) {
            return Err(PointBuildError::OutOfMemory { needed, limit });
        }
        let layout = PointLayout::new(&tree);
        let layout = layout.map_err(|_| PointBuildError::OutOfMemory { needed, limit: needed })?;
        Ok(CpuPointTree { tree, layout, set: InstructionSet::detect() })
    }

    /// The tree itself.
    pub fn tree(&self) -> &PointTree<N> {
        &self.tree
    }

    /// Bytes of the tree and of what searches it.
    pub fn bytes(&self) -> u64 {
        bytes(&self.tree)
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
        let refused = |_| refused(bytes);
        let k = options.k;
        let mut collector = Collector::new(k, self.tree.len()).map_err(refused)?;
        let (mut keys, mut spare) = (Vec::new(), Vec::new());
        keys.try_reserve_exact(queries.len()).map_err(refused)?;
        spare.try_reserve_exact(queries.len()).map_err(refused)?;
        let (lower, upper) = self.bounds();
        along_curve(queries, lower, upper, &mut keys, &mut spare);
        let unit = self.tree.unit();
        let mut frames = NO_FRAMES;
        let mut before = None;
        for few in keys.chunks(FEW) {
            if meter.is_cancelled() {
                break;
            }
            for &key in few {
                let place = key as u32 as usize;
                let query = queries[place];
                let records = &mut found[place * k..][..k];
                let stop = first_stop(unit, query, options.max_distance);
                if k == 1 && options.filter.is_none() {
                    let mut nearest = Nearest(stop.min(NOTHING));
                    self.search(query, &mut nearest, &mut frames);
                    let is_found = nearest.0 < stop.min(NOTHING);
                    records[0] =
                        if is_found { Neighbour::of(unit, nearest.0) } else { Neighbour::NONE };
                    continue;
                }
                let at = self.tree.in_units(query);
                collector.begin(if k < MANY { stop } else { stop.min(reach(before, &at)) });
                match options.filter {
                    None => self.search(query, &mut Plain(&mut collector), &mut frames),
                    Some(filter) => {
                        self.search(query, &mut Filtered(&mut collector, filter), &mut frames);
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
        unsafe { self.set.run(Search { layout: &self.layout, query, visitor, frames }) }
    }
}

const _: () = assert!(WIDTH.pow(LEVELS as u32) >= (1 << 30) / WIDTH);

/// Bytes of a tree and its layout.
fn bytes<const N: usize>(tree: &PointTree<N>) -> u64 {
    let arrays = size_of_val(tree.points()) + size_of_val(tree.indices());
    PointLayout::<N>::bytes(tree.len()) + (arrays + size_of_val(tree.nodes())) as u64
}

/// Builds a subtree, the children of large nodes side by side.
fn grow<const N: usize>(
    work: Work<'_, N>,
    set: InstructionSet,
    keys: &mut Keys,
    meter: &ProgressMeter<'_>,
) {
    if meter.is_cancelled() {
        return;
    }
    let points = work.len();
    if points <= TASK {
        // SAFETY: `set` was detected on this processor.
        unsafe { set.run(Finish(work, keys)) };
        meter.advance(points as u64);
        meter.record_work(points as u64);
        return;
    }
    // SAFETY: `set` was detected on this processor.
    let [left, right] = unsafe { set.run(Divide(work, keys)) };
    let side = |work| grow(work, set, &mut { NO_KEYS }, meter);
    rayon::join(|| side(left), || side(right));
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

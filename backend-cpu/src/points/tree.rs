//! The point tree of this backend.

use rayon::prelude::*;
use splitplane_core::error::{QueryError, check_bytes, refused};
use splitplane_core::points::build::{PointBuild, PointBuildError, PointOptions, Subtree};
use splitplane_core::points::collect::Collector;
use splitplane_core::points::nearest::{NearestOptions, Neighbour, first_stop};
use splitplane_core::points::tree::PointTree;
use splitplane_core::query::closest_point::check_lengths;
use splitplane_core::watch::{Progress, Stage};

use super::layout::{LEVELS, PointLayout, WIDTH};
use super::order::along_curve;
use super::search::{Search, Visitor};
use crate::cancel::{ProgressMeter, WORK_BETWEEN_CHECKS};
use crate::simd::InstructionSet;

/// Subtrees of fewer points are one task.
const TASK: usize = 1 << 14;
/// Most queries that are put in order at a time.
const CHUNK: usize = 1 << 16;
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
        subtree(build.root(), meter);
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
        for few in keys.chunks(FEW) {
            if meter.is_cancelled() {
                break;
            }
            for &key in few {
                let place = key as u32 as usize;
                let query = queries[place];
                collector.begin(first_stop(self.tree.unit(), query, options.max_distance));
                match options.filter {
                    None => self.search(query, &mut Plain(&mut collector)),
                    Some(filter) => self.search(query, &mut Filtered(&mut collector, filter)),
                }
                let records = &mut found[place * k..][..k];
                let keys = collector.finish();
                for (record, &key) in records.iter_mut().zip(keys) {
                    *record = Neighbour::of(self.tree.unit(), key);
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
    pub(super) fn search<V: Visitor>(&self, query: [f32; N], visitor: &mut V) {
        let query = self.tree.in_units(query);
        // SAFETY: `set` was detected on this processor.
        unsafe { self.set.run(Search { layout: &self.layout, query, visitor }) }
    }
}

const _: () = assert!(WIDTH.pow(LEVELS as u32) >= (1 << 30) / WIDTH);

/// Bytes of a tree and its layout.
fn bytes<const N: usize>(tree: &PointTree<N>) -> u64 {
    let arrays = size_of_val(tree.points()) + size_of_val(tree.indices());
    PointLayout::<N>::bytes(tree.len()) + (arrays + size_of_val(tree.nodes())) as u64
}

/// Builds a subtree, the children of large nodes side by side.
fn subtree<const N: usize>(tree: Subtree<'_, N>, meter: &ProgressMeter<'_>) {
    if meter.is_cancelled() {
        return;
    }
    let points = tree.len();
    match tree.divide() {
        Some([left, right]) if points > TASK => {
            rayon::join(|| subtree(left, meter), || subtree(right, meter));
        }
        Some([left, right]) => {
            subtree(left, meter);
            subtree(right, meter);
        }
        None => {
            meter.advance(points as u64);
            meter.record_work(points as u64);
        }
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

//! One build: the data that all its tasks read, and the memory that they share.

use core::sync::atomic::AtomicUsize;
use core::sync::atomic::Ordering::Relaxed;
use std::collections::TryReserveError;
use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use splitplane_core::error::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::triangle::Triangle;

use super::atomic_memory::AtomicMemory;
use super::bins::{Bins, CHUNK};
use super::cost::{Cell, SplitCosts};
use super::node::{OpenNode, SplitDecision};
use super::thread_scratch::ThreadScratch;
use crate::cancel::ProgressMeter;
use crate::memory::{boxed, resize};
use crate::simd::InstructionSet;

/// Lists of no more references are taken however few are needed.
const LONG: usize = 4 * CHUNK;

/// Memory kept between builds: scratch of threads, and lists of references of large nodes.
#[derive(Debug, Default)]
pub(crate) struct SweepScratch {
    workers: Mutex<Vec<Box<ThreadScratch>>>,
    lists: Mutex<Vec<Vec<Reference>>>,
}

impl SweepScratch {
    /// Prepares for a build. Returns the number of workers.
    pub(super) fn begin(&mut self) -> usize {
        // A poisoned lock means that another build panicked: its data is still usable.
        let workers = self.workers.get_mut().unwrap_or_else(PoisonError::into_inner);
        for (number, worker) in workers.iter_mut().enumerate() {
            worker.number = number;
            worker.nodes.clear();
            worker.references.clear();
        }
        workers.len()
    }

    /// Takes the longest list, for the root of the next build.
    pub(super) fn longest_list(&mut self) -> Vec<Reference> {
        let lists = self.lists.get_mut().unwrap_or_else(PoisonError::into_inner);
        let longest = (0..lists.len()).max_by_key(|&list| lists[list].len());
        longest.map_or_else(Vec::new, |longest| lists.swap_remove(longest))
    }

    /// Frees all but the subtrees that workers have built.
    pub(super) fn give_back_lists(&mut self) {
        self.lists = Mutex::default();
        let workers = self.workers.get_mut().unwrap_or_else(PoisonError::into_inner);
        for worker in workers {
            worker.stacks = Default::default();
            worker.bins.give_back();
        }
    }

    /// All workers by number, when none is at work.
    ///
    /// # Errors
    /// Less memory than a list of them takes.
    pub(super) fn workers(&mut self) -> Result<Vec<&ThreadScratch>, TryReserveError> {
        let workers = self.workers.get_mut().unwrap_or_else(PoisonError::into_inner);
        workers.sort_unstable_by_key(|worker| worker.number);
        let mut all = Vec::new();
        all.try_reserve_exact(workers.len())?;
        all.extend(workers.iter().map(|worker| &**worker));
        Ok(all)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        let workers = self.workers.lock().map_or(0, |w| w.iter().map(|w| w.bytes()).sum());
        let size = |list: &Vec<Reference>| (list.capacity() * size_of::<Reference>()) as u64;
        workers + self.lists.lock().map_or(0, |lists| lists.iter().map(size).sum::<u64>())
    }
}

/// One build.
#[derive(Debug)]
pub(super) struct BuildContext<'a> {
    /// The costs of planes, with expected children and with leaves.
    pub costs: &'a [SplitCosts; 2],
    /// Whether references are clipped to cells.
    pub clip: bool,
    pub set: InstructionSet,
    /// Snapped corners of all triangles.
    pub triangles: &'a [Triangle],
    pub memory: &'a AtomicMemory,
    pub scratch: &'a SweepScratch,
    /// How many workers there are.
    pub workers: AtomicUsize,
    pub meter: &'a ProgressMeter<'a>,
}

impl BuildContext<'_> {
    /// A list of at least `references` elements, with contents left over from earlier nodes.
    pub(super) fn list(&self, references: usize) -> Result<Vec<Reference>, BuildError> {
        // A poisoned lock means that another thread panicked; a new list is used.
        let spare = self.scratch.lists.lock().map_or(None, |mut lists| {
            // The shortest that is long enough, or else the longest.
            let fit =
                |list: &Vec<Reference>| (list.len() < references, list.len().abs_diff(references));
            let at = (0..lists.len()).min_by_key(|&at| fit(&lists[at]))?;
            // A few references in a long list would wait there while the other child is built.
            let wasted = lists[at].len() > LONG.max(4 * references);
            (!wasted).then(|| lists.swap_remove(at))
        });
        let mut list = spare.unwrap_or_default();
        let more = references.saturating_sub(list.len());
        self.memory.reserve_exactly(&mut list, more)?;
        self.lengthen(&mut list, references)?;
        Ok(list)
    }

    /// Makes a list at least `length` long.
    pub(super) fn lengthen(
        &self,
        list: &mut Vec<Reference>,
        references: usize,
    ) -> Result<(), BuildError> {
        if list.len() < references {
            self.memory.reserve(list, references - list.len())?;
            resize(self.meter, list, references, &Reference::zeroed());
            self.meter.check()?;
        }
        Ok(())
    }

    /// Whether and where a node is split.
    pub(super) fn decide(
        &self,
        node: &OpenNode,
        cell: &Cell,
        references: &[Reference],
        bins: &mut Bins,
    ) -> Result<Option<SplitDecision>, BuildError> {
        node.decide(self.costs, self.set, cell, references, bins, self.memory, self.meter)
    }

    /// Keeps a list for later nodes, or drops it if there is no space.
    pub(super) fn recycle(&self, list: Vec<Reference>) {
        if let Ok(mut lists) = self.scratch.lists.lock()
            && lists.try_reserve(1).is_ok()
        {
            lists.push(list);
        }
    }

    /// Does something with a thread's scratch.
    pub(super) fn with_worker<T>(
        &self,
        work: impl FnOnce(&mut ThreadScratch) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        let spare = self.scratch.workers.lock().map_or(None, |mut workers| workers.pop());
        let mut worker = match spare {
            Some(worker) => worker,
            None => self.worker()?,
        };
        let out = work(&mut worker);
        if let Ok(mut workers) = self.scratch.workers.lock() {
            // There is space: see `BuildContext::worker`.
            workers.push(worker);
        }
        out
    }

    /// One more worker, and space for it in the list that receives all workers at the end, since
    /// subtrees are in them. In unoptimised builds this takes stack space for a whole worker, which
    /// must not be held while the worker runs.
    fn worker(&self) -> Result<Box<ThreadScratch>, BuildError> {
        self.memory.take(size_of::<ThreadScratch>() as u64)?;
        let number = self.workers.fetch_add(1, Relaxed);
        let made = boxed(|| ThreadScratch::new(number)).and_then(|worker| {
            // A poisoned lock means that another thread panicked, which ends the build.
            if let Ok(mut workers) = self.scratch.workers.lock() {
                let more = number + 1 - workers.len().min(number);
                workers.try_reserve(more)?;
            }
            Ok(worker)
        });
        made.map_err(|_| self.memory.lacking())
    }
}

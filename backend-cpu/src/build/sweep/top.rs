//! The nodes above the subtrees that one thread builds.

use core::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::collections::TryReserveError;
use std::sync::{Mutex, PoisonError};

use bytemuck::Zeroable;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::node::Axis;
use splitplane_core::triangle::Triangle;

use super::bins::{Bins, CHUNK};
use super::cost::{Cell, Costs, Split};
use super::emit::Built;
use super::ledger::Ledger;
use super::node::{Decision, Node};
use super::partition::partition;
use super::subtree::Worker;
use crate::buffers::boxed;
use crate::lookout::{self, Lookout};
use crate::query::InstructionSet;

/// A node of at most this many references is one task.
const TASK: usize = 2048;

/// Nodes below this depth are built one after the other: all threads have work long before, and
/// tasks within tasks take a few times the stack.
const DIVIDED: u32 = 20;

/// Memory kept between builds: scratch of threads, and lists of references of large nodes.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    workers: Mutex<Vec<Box<Worker>>>,
    lists: Mutex<Vec<Vec<Reference>>>,
}

impl Scratch {
    /// Makes ready for a build. Returns how many workers there are.
    pub(super) fn begin(&mut self) -> usize {
        // A poisoned lock means that another build panicked: what is left serves.
        let workers = self.workers.get_mut().unwrap_or_else(PoisonError::into_inner);
        for (number, worker) in workers.iter_mut().enumerate() {
            worker.number = number;
            worker.nodes.clear();
            worker.references.clear();
        }
        workers.len()
    }

    /// All workers by number, when none is at work.
    ///
    /// # Errors
    /// Less memory than a list of them takes.
    pub(super) fn workers(&mut self) -> Result<Vec<&Worker>, TryReserveError> {
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
pub(super) struct Builder<'a> {
    /// What planes are compared by, and leaves for children.
    pub costs: &'a [Costs; 2],
    /// Whether references are clipped to cells.
    pub clip: bool,
    pub set: InstructionSet,
    /// Snapped corners of all triangles.
    pub triangles: &'a [Triangle],
    pub ledger: &'a Ledger,
    pub scratch: &'a Scratch,
    /// How many workers there are.
    pub workers: AtomicUsize,
    pub look: &'a Lookout<'a>,
}

/// What becomes of a node before its children are built.
enum Outcome {
    /// Nothing is left to do: the subtree, and its cost.
    Built(Built, f64),
    Divided(Divided),
}

/// A node that is split.
struct Divided {
    split: Split,
    /// What a step at it costs, and what it would as a leaf.
    step: f64,
    leaf: f64,
    /// What goes left and right, the children, and how many references each has.
    lists: [Vec<Reference>; 2],
    nodes: [Node; 2],
    counts: [usize; 2],
}

/// A node of so many references whose children are built: split where that pays. `step` is what a step at it
/// costs, `leaf` what it would as a leaf.
fn joined(
    split: &Split,
    [step, leaf]: [f64; 2],
    count: usize,
    (left, left_cost): (Built, f64),
    (right, right_cost): (Built, f64),
) -> Result<(Built, f64), TryReserveError> {
    let cost = step + left_cost + right_cost;
    if cost < leaf {
        let axis = Axis::from_index(split.axis as u32);
        return Ok((Built::split(axis, split.position, left, right)?, cost));
    }
    Ok((Built::retracted(left, right, count as u64)?, leaf))
}

impl Builder<'_> {
    /// A list with room for so many references; what it holds is of no use.
    pub fn list(&self, references: usize) -> Result<Vec<Reference>, BuildError> {
        // A poisoned lock means that another thread panicked; a new list serves.
        let spare = self.scratch.lists.lock().map_or(None, |mut lists| {
            // The shortest that is long enough, or else the longest.
            let fit =
                |list: &Vec<Reference>| (list.len() < references, list.len().abs_diff(references));
            let at = (0..lists.len()).min_by_key(|&at| fit(&lists[at]))?;
            Some(lists.swap_remove(at))
        });
        let mut list = spare.unwrap_or_default();
        self.lengthen(&mut list, references)?;
        Ok(list)
    }

    /// Makes a list at least so long.
    pub fn lengthen(&self, list: &mut Vec<Reference>, references: usize) -> Result<(), BuildError> {
        if list.len() < references {
            self.ledger.reserve(list, references - list.len())?;
            lookout::resize(self.look, list, references, &Reference::zeroed());
            self.look.check()?;
        }
        Ok(())
    }

    /// Whether and where a node is split.
    pub fn decide(
        &self,
        node: &Node,
        cell: &Cell,
        references: &[Reference],
        bins: &mut Bins,
    ) -> Result<Option<Decision>, BuildError> {
        node.decide(self.costs, self.set, cell, references, bins, self.ledger, self.look)
    }

    /// Keeps a list; one that there is no room for is let go.
    fn recycle(&self, list: Vec<Reference>) {
        if let Ok(mut lists) = self.scratch.lists.lock()
            && lists.try_reserve(1).is_ok()
        {
            lists.push(list);
        }
    }

    /// Does something with a thread's scratch.
    fn with_worker<T>(
        &self,
        work: impl FnOnce(&mut Worker) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        let spare = self.scratch.workers.lock().map_or(None, |mut workers| workers.pop());
        let mut worker = match spare {
            Some(worker) => worker,
            None => self.worker()?,
        };
        let out = work(&mut worker);
        if let Ok(mut workers) = self.scratch.workers.lock() {
            // There is room: see `Builder::worker`.
            workers.push(worker);
        }
        out
    }

    /// One more worker, and room for it where all workers go in the end, since subtrees are in them. Unless it is
    /// optimised this takes room on the stack for all that a worker is, which is not to be there while the
    /// worker works.
    fn worker(&self) -> Result<Box<Worker>, BuildError> {
        self.ledger.take(size_of::<Worker>() as u64)?;
        let number = self.workers.fetch_add(1, Relaxed);
        let made = boxed(|| Worker::new(number)).and_then(|worker| {
            // A poisoned lock means that another thread panicked, which ends the build.
            if let Ok(mut workers) = self.scratch.workers.lock() {
                let more = number + 1 - workers.len().min(number);
                workers.try_reserve(more)?;
            }
            Ok(worker)
        });
        made.map_err(|_| self.ledger.lacking())
    }

    /// Builds the subtree of a node whose references are the first `count` of a list. Returns it with its
    /// cost.
    pub fn build(
        &self,
        list: Vec<Reference>,
        count: usize,
        node: &Node,
    ) -> Result<(Built, f64), BuildError> {
        match self.divide(list, count, node)? {
            Outcome::Divided(divided) => self.build_children(divided, count),
            Outcome::Built(built, cost) => Ok((built, cost)),
        }
    }

    /// Divides the references of a node, or builds it where it is a leaf or one task's. This is not on the
    /// stack while the children are built, as what calls it is, once a level.
    fn divide(
        &self,
        mut list: Vec<Reference>,
        count: usize,
        node: &Node,
    ) -> Result<Outcome, BuildError> {
        if count <= TASK {
            let built = self.with_worker(|worker| worker.task(self, &mut list, count, node));
            self.recycle(list);
            return built.map(|(subtree, cost)| Outcome::Built(Built::Whole(subtree), cost));
        }
        let cell = Cell::new(&self.costs[0], &node.cell);
        let leaf = self.costs[0].leaf(cell.area, count as u32);
        let decision =
            self.with_worker(|worker| self.decide(node, &cell, &list[..count], &mut worker.bins))?;
        self.look.check()?;
        let Some(decision) = decision else {
            self.look.advance(node.budget);
            let mut all = Vec::new();
            self.ledger.reserve(&mut all, count)?;
            all.extend(list[..count].iter().map(|reference| reference.triangle));
            self.recycle(list);
            return Ok(Outcome::Built(Built::Leaf(all), leaf));
        };
        let split = decision.split;
        let (lists, counts) = self.partition(&node.cell, &split, list, count)?;
        self.look.check()?;
        let nodes = node.children(&decision, counts);
        Ok(Outcome::Divided(Divided { split, step: cell.step, leaf, lists, nodes, counts }))
    }

    /// Builds the children of a node of so many references, and what it is then.
    fn build_children(
        &self,
        Divided { split, step, leaf, lists, nodes, counts }: Divided,
        count: usize,
    ) -> Result<(Built, f64), BuildError> {
        let [left, right] = lists;
        let left = || self.build(left, counts[0], &nodes[0]);
        let right = || self.build(right, counts[1], &nodes[1]);
        let (left, right) =
            if nodes[0].depth <= DIVIDED { rayon::join(left, right) } else { (left(), right()) };
        joined(&split, [step, leaf], count, left?, right?).map_err(|_| self.ledger.lacking())
    }

    /// [`partition`]. Returns what goes left, what goes right, and how many either are.
    fn partition(
        &self,
        cell: &Aabb,
        split: &Split,
        mut list: Vec<Reference>,
        count: usize,
    ) -> Result<([Vec<Reference>; 2], [usize; 2]), BuildError> {
        let move_some = |references: &mut [Reference], left: &mut [Reference]| {
            // Clipping some of them takes as long as moving a few times as many.
            if self.look.worked(2 * references.len() as u64) {
                return [0; 2];
            }
            partition(self.set, self.clip, self.triangles, cell, split, references, left)
        };
        let mut left = self.list(count)?;
        if count <= 4 * CHUNK {
            let counts = move_some(&mut list[..count], &mut left[..count]);
            return Ok(([left, list], counts));
        }
        // In parts, which are then put together; they differ in length.
        let mut counts: Vec<[usize; 2]> = self.ledger.passing(count.div_ceil(CHUNK))?;
        list[..count]
            .par_chunks_mut(CHUNK)
            .zip(left[..count].par_chunks_mut(CHUNK))
            .map(|(references, left)| move_some(references, left))
            .collect_into_vec(&mut counts);
        let sides = [0, 1].map(|side| counts.iter().map(|counts| counts[side]).sum::<usize>());
        let together = |list: Vec<Reference>, side: usize| -> Result<_, BuildError> {
            let mut out = self.list(sides[side])?;
            let mut rest = &mut out[..];
            let mut parts = self.ledger.passing(counts.len())?;
            for (from, counts) in list.chunks(CHUNK).zip(&counts) {
                let to;
                (to, rest) = rest.split_at_mut(counts[side]);
                parts.push((&from[..counts[side]], to));
            }
            parts.into_par_iter().for_each(|(from, to)| {
                if !self.look.worked(from.len() as u64) {
                    to.copy_from_slice(from);
                }
            });
            self.recycle(list);
            Ok(out)
        };
        Ok(([together(left, 0)?, together(list, 1)?], sides))
    }
}

//! The nodes above the subtrees that one thread builds.

use core::mem;
use std::sync::Mutex;

use bytemuck::Zeroable;
use rayon::prelude::*;
use splitplane_core::aabb::Aabb;
use splitplane_core::backend::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::node::Axis;
use splitplane_core::triangle::Triangle;

use super::bins::Bins;
use super::cost::{Cell, Costs, Split};
use super::emit::{Built, Subtree};
use super::ledger::Ledger;
use super::node::{Decision, Node};
use super::partition::partition;
use super::subtree::{Worker, union};
use crate::lookout::{self, Lookout};
use crate::query::InstructionSet;

/// A node of at most this many references is one task.
const TASK: usize = 2048;
/// References of one task where a node has many.
const CHUNK: usize = 16_384;

/// Memory kept between builds: scratch of threads, and lists of references of large nodes.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    workers: Mutex<Vec<Box<Worker>>>,
    lists: Mutex<Vec<Vec<Reference>>>,
}

impl Scratch {
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
    pub costs: [Costs; 2],
    /// Whether references are clipped to cells.
    pub clip: bool,
    pub set: InstructionSet,
    /// Snapped corners of all triangles.
    pub triangles: &'a [Triangle],
    pub ledger: &'a Ledger,
    pub scratch: &'a Scratch,
    pub look: &'a Lookout<'a>,
}

impl Builder<'_> {
    /// A list with room for so many references; what it holds is of no use.
    pub fn list(&self, references: usize) -> Result<Vec<Reference>, BuildError> {
        // A poisoned lock means that another thread panicked; a new list serves.
        let spare = self.scratch.lists.lock().map_or(None, |mut lists| lists.pop());
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
        node.decide(&self.costs, self.set, cell, references, bins, self.ledger, self.look)
    }

    fn recycle(&self, list: Vec<Reference>) {
        if let Ok(mut lists) = self.scratch.lists.lock() {
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
            None => {
                self.ledger.take(size_of::<Worker>() as u64)?;
                Box::default()
            }
        };
        let out = work(&mut worker);
        if let Ok(mut workers) = self.scratch.workers.lock() {
            workers.push(worker);
        }
        out
    }

    /// Builds the subtree of a node whose references are the first `count` of a list. Returns it with its
    /// cost.
    pub fn build(
        &self,
        mut list: Vec<Reference>,
        count: usize,
        node: &Node,
    ) -> Result<(Built, f64), BuildError> {
        if count <= TASK {
            let built = self.with_worker(|worker| self.task(worker, &mut list, count, node));
            self.recycle(list);
            return built;
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
            return Ok((Built::leaf(all), leaf));
        };
        let split = decision.split;
        let mut left = self.list(count)?;
        let counts = self.partition(&node.cell, &split, &mut list[..count], &mut left[..count]);
        self.look.check()?;
        let [below, above] = node.children(&decision, counts);
        let (left, right) = rayon::join(
            || self.build(left, counts[0], &below),
            || self.build(list, counts[1], &above),
        );
        let ((left, left_cost), (right, right_cost)) = (left?, right?);
        let cost = cell.step + left_cost + right_cost;
        if cost < leaf {
            let axis = Axis::from_index(split.axis as u32);
            return Ok((Built::split(axis, split.position, left, right), cost));
        }
        let mut all = Vec::new();
        self.ledger.reserve(&mut all, (left.references() + right.references()) as usize)?;
        left.collect(&mut all);
        right.collect(&mut all);
        union(&mut all, 0);
        // What is retracted is held no longer.
        self.ledger.give(left.bytes() + right.bytes());
        drop((left, right));
        Ok((Built::leaf(all), leaf))
    }

    /// [`partition`], in chunks.
    fn partition(
        &self,
        cell: &Aabb,
        split: &Split,
        references: &mut [Reference],
        left: &mut [Reference],
    ) -> [usize; 2] {
        let counts: Vec<[usize; 2]> = references
            .par_chunks_mut(CHUNK)
            .zip(left.par_chunks_mut(CHUNK))
            .map(|(chunk, left)| {
                // Clipping some of them takes as long as moving a few times as many.
                if self.look.worked(2 * chunk.len() as u64) {
                    return [0; 2];
                }
                partition(self.set, self.clip, self.triangles, cell, split, chunk, left)
            })
            .collect();
        // Close the gaps between the chunks.
        let mut ends = [0; 2];
        for (chunk, counts) in counts.iter().enumerate() {
            if self.look.worked(CHUNK as u64) {
                break;
            }
            let first = chunk * CHUNK;
            for (list, side) in [(&mut *left, 0), (&mut *references, 1)] {
                list.copy_within(first..first + counts[side], ends[side]);
                ends[side] += counts[side];
            }
        }
        ends
    }

    /// The subtree of a node that is one task. The list is put under the worker while it works.
    fn task(
        &self,
        worker: &mut Worker,
        list: &mut Vec<Reference>,
        count: usize,
        node: &Node,
    ) -> Result<(Built, f64), BuildError> {
        worker.nodes.clear();
        worker.references.clear();
        mem::swap(list, &mut worker.stacks[0].references);
        worker.stacks[0].top = count;
        worker.stacks[1].top = 0;
        let cost = worker.build(self, node, 0, 0);
        mem::swap(list, &mut worker.stacks[0].references);
        let (mut nodes, mut references) = (Vec::new(), Vec::new());
        self.ledger.reserve(&mut nodes, worker.nodes.len())?;
        self.ledger.reserve(&mut references, worker.references.len())?;
        nodes.extend_from_slice(&worker.nodes);
        references.extend_from_slice(&worker.references);
        Ok((Built::Whole(Subtree { nodes, references }), cost?))
    }
}

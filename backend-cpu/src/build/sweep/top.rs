//! The nodes above the subtrees that one thread builds.

use std::collections::TryReserveError;

use splitplane_core::aabb::Aabb;
use splitplane_core::error::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::tree::node::Axis;

use super::bins::CHUNK;
use super::context::BuildContext;
use super::cost::{Cell, Split};
use super::emit::Built;
use super::node::OpenNode;
use super::partition::partition;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// A node of at most this many references is one task.
const TASK: usize = 2048;

/// Nodes below this depth are built one at a time: all threads have work long before, and
/// tasks within tasks take a few times the stack.
const DIVIDED: u32 = 20;

/// A node's state before its children are built.
enum Outcome {
    /// The node is finished: the subtree, and its cost.
    Built(Built, f64),
    Divided(Divided),
}

/// A node that is split.
struct Divided {
    split: Split,
    /// The cost of a step at it, and its cost as a leaf.
    step: f64,
    leaf: f64,
    /// The references that go left and right, the children, and how many references each has.
    lists: [Vec<Reference>; 2],
    nodes: [OpenNode; 2],
    counts: [usize; 2],
}

/// A node of `count` references whose children are built: split where that pays. `step` is the cost
/// of a step at it, `leaf` its cost as a leaf.
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

impl BuildContext<'_> {
    /// Builds the subtree of a node whose references are the first `count` of a list. Returns it with its
    /// cost.
    pub(super) fn build(
        &self,
        list: Vec<Reference>,
        count: usize,
        node: &OpenNode,
    ) -> Result<(Built, f64), BuildError> {
        match self.divide(list, count, node)? {
            Outcome::Divided(divided) => self.build_children(divided, count),
            Outcome::Built(built, cost) => Ok((built, cost)),
        }
    }

    /// Divides the references of a node, or builds it where it is a leaf or one task's. Unlike its
    /// caller, which is on the stack once per level, this is not on the stack while the children
    /// are built.
    fn divide(
        &self,
        mut list: Vec<Reference>,
        count: usize,
        node: &OpenNode,
    ) -> Result<Outcome, BuildError> {
        if count <= TASK {
            let built =
                span::task(|| self.with_worker(|worker| worker.task(self, &mut list, count, node)));
            self.recycle(list);
            return built.map(|(subtree, cost)| Outcome::Built(Built::Whole(subtree), cost));
        }
        let cell = Cell::new(&self.costs[0], &node.cell);
        let leaf = self.costs[0].leaf(cell.area, count as u32);
        let decision =
            self.with_worker(|worker| self.decide(node, &cell, &list[..count], &mut worker.bins))?;
        self.meter.check()?;
        let Some(decision) = decision else {
            self.meter.advance(node.budget);
            let mut all = Vec::new();
            self.memory.reserve(&mut all, count)?;
            all.extend(list[..count].iter().map(|reference| reference.triangle));
            self.recycle(list);
            return Ok(Outcome::Built(Built::Leaf(all), leaf));
        };
        let split = decision.split;
        let (lists, counts) = self.partition(&node.cell, &split, list, count)?;
        self.meter.check()?;
        let nodes = node.children(&decision, counts);
        Ok(Outcome::Divided(Divided { split, step: cell.step, leaf, lists, nodes, counts }))
    }

    /// Builds the children of a node of `count` references, and then the node.
    fn build_children(
        &self,
        Divided { split, step, leaf, lists, nodes, counts }: Divided,
        count: usize,
    ) -> Result<(Built, f64), BuildError> {
        let [left, right] = lists;
        let left = || self.build(left, counts[0], &nodes[0]);
        let right = || self.build(right, counts[1], &nodes[1]);
        let (left, right) =
            if nodes[0].depth <= DIVIDED { span::join(left, right) } else { (left(), right()) };
        joined(&split, [step, leaf], count, left?, right?).map_err(|_| self.memory.lacking())
    }

    /// As [`partition`]. Returns the references that go left, those that go right, and the number
    /// of each.
    fn partition(
        &self,
        cell: &Aabb,
        split: &Split,
        mut list: Vec<Reference>,
        count: usize,
    ) -> Result<([Vec<Reference>; 2], [usize; 2]), BuildError> {
        let move_some = |references: &mut [Reference], left: &mut [Reference]| {
            // Clipping some of them takes as long as moving a few times as many.
            if self.meter.record_work(2 * references.len() as u64) {
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
        let parts = count.div_ceil(CHUNK);
        let mut counts: Vec<[usize; 2]> = self.memory.temporary(parts)?;
        counts.resize(parts, [0; 2]);
        let dividing = span::pieces_of(1);
        list[..count]
            .par_chunks_mut(CHUNK)
            .zip(left[..count].par_chunks_mut(CHUNK))
            .zip(&mut counts)
            .for_each(|((references, left), counts)| {
                let _piece = span::piece();
                *counts = move_some(references, left);
            });
        drop(dividing);
        let sides = [0, 1].map(|side| counts.iter().map(|counts| counts[side]).sum::<usize>());
        let together = |list: Vec<Reference>, side: usize| -> Result<_, BuildError> {
            let mut out = self.list(sides[side])?;
            let mut rest = &mut out[..];
            let mut parts = self.memory.temporary(counts.len())?;
            for (from, counts) in list.chunks(CHUNK).zip(&counts) {
                let to;
                (to, rest) = rest.split_at_mut(counts[side]);
                parts.push((&from[..counts[side]], to));
            }
            let _loop = span::pieces_of(1);
            parts.par_iter_mut().for_each(|(from, to)| {
                let _piece = span::piece();
                if !self.meter.record_work(from.len() as u64) {
                    to.copy_from_slice(from);
                }
            });
            self.recycle(list);
            Ok(out)
        };
        Ok(([together(left, 0)?, together(list, 1)?], sides))
    }
}

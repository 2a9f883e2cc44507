//! The subtree of a node on one thread, depth first.

use core::mem;

use splitplane_core::error::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::tree::node::{Axis, KdNode};

use super::context::BuildContext;
use super::cost::Cell;
use super::emit::{Subtree, union};
use super::node::OpenNode;
use super::partition::partition;
use super::thread_scratch::ThreadScratch;

/// Work between two calls of the watch, in references of nodes that are decided.
const WORK: usize = 2048;

impl ThreadScratch {
    /// Builds a subtree from the first references of a list. Returns it with its cost.
    pub(super) fn task(
        &mut self,
        builder: &BuildContext<'_>,
        list: &mut Vec<Reference>,
        count: usize,
        node: &OpenNode,
    ) -> Result<(Subtree, f64), BuildError> {
        self.start = [self.nodes.len(), self.references.len()];
        // The list is put under the worker while it works.
        mem::swap(list, &mut self.stacks[0].references);
        self.stacks[0].top = count;
        self.stacks[1].top = 0;
        let cost = self.build(builder, node, 0, 0);
        mem::swap(list, &mut self.stacks[0].references);
        let nodes = self.start[0]..self.nodes.len();
        let references = self.start[1]..self.references.len();
        Ok((Subtree { worker: self.number, nodes, references }, cost?))
    }

    /// Builds the subtree of a node whose references are those from `first` to the top of a stack, and
    /// removes them. Returns its cost.
    fn build(
        &mut self,
        builder: &BuildContext<'_>,
        node: &OpenNode,
        stack: usize,
        first: usize,
    ) -> Result<f64, BuildError> {
        let top = self.stacks[stack].top;
        let count = top - first;
        self.look_up(builder, count)?;
        let cell = Cell::new(&builder.costs[0], &node.cell);
        let leaf = builder.costs[0].leaf(cell.area, count as u32);
        let references = &self.stacks[stack].references[first..top];
        let decision = builder.decide(node, &cell, references, &mut self.bins)?;
        let index = self.nodes.len();
        let first_reference = self.references.len();
        let leaf_at = (first_reference - self.start[1]) as u32;
        builder.memory.reserve(&mut self.nodes, 1)?;
        let Some(decision) = decision else {
            self.nodes.push(KdNode::leaf(leaf_at, count as u32));
            builder.memory.reserve(&mut self.references, count)?;
            self.references.extend(references.iter().map(|reference| reference.triangle));
            self.stacks[stack].top = first;
            builder.meter.advance(node.budget);
            return Ok(leaf);
        };
        let split = decision.split;
        // Its right child is not known yet.
        self.nodes.push(KdNode::interior(Axis::from_index(split.axis as u32), split.position, 0));
        let [low, high] = &mut self.stacks;
        let (own, other) = if stack == 0 { (low, high) } else { (high, low) };
        let start = other.top;
        builder.lengthen(&mut other.references, start + count)?;
        let counts = partition(
            builder.set,
            builder.clip,
            builder.triangles,
            &node.cell,
            &split,
            &mut own.references[first..top],
            &mut other.references[start..],
        );
        other.top = start + counts[0];
        own.top = first + counts[1];
        let [left, right] = node.children(&decision, counts);
        let mut cost = cell.step + self.build(builder, &left, 1 - stack, start)?;
        let right_index = self.nodes.len() - self.start[0];
        cost += self.build(builder, &right, stack, first)?;
        if cost < leaf {
            self.nodes[index] = KdNode::interior(
                Axis::from_index(split.axis as u32),
                split.position,
                right_index as u32,
            );
            return Ok(cost);
        }
        // It does not pay: it becomes a leaf of all references of its leaves.
        self.nodes.truncate(index);
        let count = union(&mut self.references, first_reference);
        self.nodes.push(KdNode::leaf(leaf_at, count));
        Ok(leaf)
    }
}

impl ThreadScratch {
    /// Calls the watch after some work.
    #[inline]
    fn look_up(&mut self, builder: &BuildContext<'_>, references: usize) -> Result<(), BuildError> {
        self.work += references + 1;
        if self.work < WORK {
            return Ok(());
        }
        // Nearly every plane is compared with every reference.
        builder.meter.record_work(4 * self.work as u64);
        self.work = 0;
        builder.meter.check()
    }
}

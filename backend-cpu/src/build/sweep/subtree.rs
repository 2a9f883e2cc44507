//! The subtree of a node on one thread, depth first.

use core::mem;

use splitplane_core::backend::BuildError;
use splitplane_core::layout::Reference;
use splitplane_core::node::{Axis, KdNode};

use super::bins::Bins;
use super::cost::Cell;
use super::emit::Subtree;
use super::node::Node;
use super::partition::partition;
use super::top::Builder;

/// Lists of references, one above the other; what is above `top` is free.
#[derive(Debug, Default)]
pub(super) struct Stack {
    pub references: Vec<Reference>,
    pub top: usize,
}

/// Work between two looks at the watch, in references of nodes that are decided.
const WORK: usize = 2048;

/// Scratch of one thread. A node's references are on top of one stack. What goes right stays there, what
/// goes left goes to the top of the other: so nothing is held but the lists of nodes that wait.
#[derive(Debug, Default)]
pub(super) struct Worker {
    pub stacks: [Stack; 2],
    pub bins: Bins,
    /// Which of a build's workers it is.
    pub number: usize,
    /// Nodes of the subtrees built so far; children and references count from the start of each.
    pub nodes: Vec<KdNode>,
    /// References of their leaves.
    pub references: Vec<u32>,
    /// Where the subtree at hand starts in either.
    start: [usize; 2],
    /// Work since the watch was asked last, in references looked at.
    work: usize,
}

impl Worker {
    /// A worker of this number.
    pub fn new(number: usize) -> Worker {
        Worker { number, ..Worker::default() }
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let [a, b] = self.stacks.each_ref().map(|stack| stack.references.capacity());
        let references = (a + b) * size_of::<Reference>();
        let out = self.nodes.capacity() * size_of::<KdNode>() + self.references.capacity() * 4;
        (references + out + size_of::<Worker>()) as u64 + self.bins.bytes()
    }

    /// Builds a subtree from the first references of a list. Returns it with its cost.
    pub fn task(
        &mut self,
        builder: &Builder<'_>,
        list: &mut Vec<Reference>,
        count: usize,
        node: &Node,
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
        builder: &Builder<'_>,
        node: &Node,
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
        builder.ledger.reserve(&mut self.nodes, 1)?;
        let Some(decision) = decision else {
            self.nodes.push(KdNode::leaf(leaf_at, count as u32));
            builder.ledger.reserve(&mut self.references, count)?;
            self.references.extend(references.iter().map(|reference| reference.triangle));
            self.stacks[stack].top = first;
            builder.look.advance(node.budget);
            return Ok(leaf);
        };
        let split = decision.split;
        // Its right child is known later.
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
        // It does not pay: a leaf of all that its leaves have.
        self.nodes.truncate(index);
        let count = union(&mut self.references, first_reference);
        self.nodes.push(KdNode::leaf(leaf_at, count));
        Ok(leaf)
    }
}

impl Worker {
    /// Asks the watch after some work.
    #[inline]
    fn look_up(&mut self, builder: &Builder<'_>, references: usize) -> Result<(), BuildError> {
        self.work += references + 1;
        if self.work < WORK {
            return Ok(());
        }
        // Every plane is held against every reference, or nearly.
        builder.look.worked(4 * self.work as u64);
        self.work = 0;
        builder.look.check()
    }
}

/// Makes one leaf of all from `first` on: in order, each once. Returns how many there are.
pub(super) fn union(references: &mut Vec<u32>, first: usize) -> u32 {
    references[first..].sort_unstable();
    let mut end = first;
    for i in first..references.len() {
        if end == first || references[end - 1] != references[i] {
            references[end] = references[i];
            end += 1;
        }
    }
    references.truncate(end);
    (end - first) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_union_is_in_order_and_without_repeats() {
        let mut references = vec![9, 9, 5, 3, 5, 9, 1];
        assert_eq!(union(&mut references, 2), 4);
        assert_eq!(references, [9, 9, 1, 3, 5, 9]);
        assert_eq!(union(&mut references, 6), 0);
    }
}

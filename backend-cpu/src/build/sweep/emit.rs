//! Finished subtrees, and the canonical arrays they become.

use core::ops::Range;
use std::collections::TryReserveError;

use splitplane_core::error::BuildError;
use splitplane_core::tree::node::{Axis, KdNode, NodeKind};

use super::thread_scratch::ThreadScratch;
use crate::build::MOST_NODES;
use crate::cancel::ProgressMeter;
use crate::memory::boxed;
use crate::span;

/// A finished subtree.
#[derive(Debug)]
pub(super) enum Built {
    /// A subtree that a single thread built.
    Whole(Subtree),
    /// A node with two children.
    Split(Box<Children>),
    /// One leaf.
    Leaf(Vec<u32>),
    /// A node that is a leaf after all: the references of its children, each once.
    Retracted(Box<Children>),
}

/// The place of a subtree among those that a [`ThreadScratch`] has built; indices count from its
/// start.
#[derive(Debug)]
pub(super) struct Subtree {
    /// [`ThreadScratch::number`].
    pub worker: usize,
    pub nodes: Range<usize>,
    pub references: Range<usize>,
}

/// A node with two children.
#[derive(Debug)]
pub(super) struct Children {
    axis: Axis,
    position: f32,
    left: Built,
    right: Built,
    nodes: u64,
    references: u64,
}

impl Built {
    /// A node with two children.
    ///
    /// # Errors
    /// No memory for it.
    pub(super) fn split(
        axis: Axis,
        position: f32,
        left: Built,
        right: Built,
    ) -> Result<Built, TryReserveError> {
        let nodes = 1 + left.nodes() + right.nodes();
        let references = left.references() + right.references();
        boxed(|| Children { axis, position, left, right, nodes, references }).map(Built::Split)
    }

    /// A leaf of all `references` references of its children's leaves.
    ///
    /// # Errors
    /// No memory for it.
    pub(super) fn retracted(
        left: Built,
        right: Built,
        references: u64,
    ) -> Result<Built, TryReserveError> {
        let (axis, position) = (Axis::X, 0.0);
        boxed(|| Children { axis, position, left, right, nodes: 1, references })
            .map(Built::Retracted)
    }

    /// How many nodes it has.
    pub(super) fn nodes(&self) -> u64 {
        match self {
            Built::Whole(subtree) => subtree.nodes.len() as u64,
            Built::Split(parts) | Built::Retracted(parts) => parts.nodes,
            Built::Leaf(_) => 1,
        }
    }

    /// How many references its leaves have.
    pub(super) fn references(&self) -> u64 {
        match self {
            Built::Whole(subtree) => subtree.references.len() as u64,
            Built::Split(parts) | Built::Retracted(parts) => parts.references,
            Built::Leaf(references) => references.len() as u64,
        }
    }

    /// Appends the references of all leaves.
    fn collect(
        &self,
        workers: &[&ThreadScratch],
        out: &mut Vec<u32>,
    ) -> Result<(), TryReserveError> {
        let references = match self {
            Built::Whole(subtree) => subtree.references_in(workers),
            Built::Split(parts) | Built::Retracted(parts) => {
                parts.left.collect(workers, out)?;
                return parts.right.collect(workers, out);
            }
            Built::Leaf(references) => references,
        };
        out.try_reserve(references.len())?;
        out.extend_from_slice(references);
        Ok(())
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        match self {
            Built::Whole(_) => 0,
            Built::Split(parts) | Built::Retracted(parts) => {
                parts.left.bytes() + parts.right.bytes()
            }
            Built::Leaf(references) => (references.capacity() * size_of::<u32>()) as u64,
        }
    }

    /// How many nodes and references there are.
    ///
    /// # Errors
    /// More than the format can address.
    pub(super) fn check_size(&self) -> Result<(usize, usize), BuildError> {
        let (nodes, references) = (self.nodes(), self.references());
        if nodes > u64::from(MOST_NODES) || references > u64::from(u32::MAX) {
            return Err(BuildError::TooLarge { nodes, references });
        }
        Ok((nodes as usize, references as usize))
    }

    /// Writes the subtree to arrays of its size, as the canonical tree has it. `workers` are all
    /// workers that took part, by number.
    ///
    /// # Errors
    /// Less memory than merging leaves takes.
    pub(super) fn emit(
        &self,
        meter: &ProgressMeter<'_>,
        workers: &[&ThreadScratch],
        nodes: &mut [KdNode],
        references: &mut [u32],
    ) -> Result<(), TryReserveError> {
        self.emit_at(meter, workers, nodes, references, [0, 0])
    }

    /// Writes the subtree to arrays of its size, which begin at these indices of the tree: of nodes and
    /// of references.
    fn emit_at(
        &self,
        meter: &ProgressMeter<'_>,
        workers: &[&ThreadScratch],
        nodes: &mut [KdNode],
        references: &mut [u32],
        first: [u32; 2],
    ) -> Result<(), TryReserveError> {
        if meter.is_cancelled() {
            return Ok(());
        }
        let [first_node, first_reference] = first;
        match self {
            Built::Whole(subtree) => {
                let _loop = span::pieces_of(1);
                let _piece = span::piece();
                references.copy_from_slice(subtree.references_in(workers));
                for (out, node) in nodes.iter_mut().zip(subtree.nodes_in(workers)) {
                    *out = match node.kind() {
                        NodeKind::Interior { axis, split, right } => {
                            KdNode::interior(axis, split, first_node + right)
                        }
                        NodeKind::Leaf { first, count } => {
                            KdNode::leaf(first_reference + first, count)
                        }
                    };
                }
                meter.advance(nodes.len() as u64);
                meter.record_work((nodes.len() + references.len()) as u64 / 2);
            }
            Built::Split(parts) => {
                meter.advance(1);
                let (left_nodes, left_references) = (parts.left.nodes(), parts.left.references());
                let Some((root, nodes)) = nodes.split_first_mut() else { return Ok(()) };
                let right_node = first_node + 1 + left_nodes as u32;
                *root = KdNode::interior(parts.axis, parts.position, right_node);
                let (nodes, far_nodes) = nodes.split_at_mut(left_nodes as usize);
                let (references, far) = references.split_at_mut(left_references as usize);
                let near_first = [first_node + 1, first_reference];
                let far_first = [right_node, first_reference + left_references as u32];
                let (left, right) = span::join(
                    || parts.left.emit_at(meter, workers, nodes, references, near_first),
                    || parts.right.emit_at(meter, workers, far_nodes, far, far_first),
                );
                left.and(right)?;
            }
            Built::Leaf(_) | Built::Retracted(_) => {
                meter.advance(1);
                let mut all = Vec::new();
                self.collect(workers, &mut all)?;
                union(&mut all, 0);
                // Every reference of the node is in some leaf below it.
                for (out, triangle) in references.iter_mut().zip(&all) {
                    *out = *triangle;
                }
                for node in nodes {
                    *node = KdNode::leaf(first_reference, references.len() as u32);
                }
            }
        }
        Ok(())
    }
}

impl Subtree {
    fn nodes_in<'w>(&self, workers: &[&'w ThreadScratch]) -> &'w [KdNode] {
        &workers[self.worker].nodes[self.nodes.clone()]
    }

    fn references_in<'w>(&self, workers: &[&'w ThreadScratch]) -> &'w [u32] {
        &workers[self.worker].references[self.references.clone()]
    }
}

/// Makes one leaf of all references from `first` on: in order, each once. Returns how many there
/// are.
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

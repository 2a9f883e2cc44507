//! Compressed nodes made top down, without costs: a rule that needs no more of a tree than its planes, so that a device can
//! follow it for a tree that it has just built. The schedule of the kernels that do so, and [`CompressedNodes::greedy`], which
//! runs their serial reference.
//!
//! A node has the children of its part of the tree. While there are fewer than eight, the subtree of greatest surface
//! area is replaced by its own two, of equal ones the first; empty leaves are left out. A subtree's box is its cell, a
//! leaf's the part of its cell that its triangles' bounds reach into, both widened by the scene's slack. A leaf of the tree
//! stays one, unless it is too long: then it is a node, whose children share its references. Nodes and references come in the
//! order of the nodes that they belong to.

use super::CompressedNodes;
use super::reference::Reference;
use crate::build::schedule::Executor;
use crate::kernel::{CompressCounter, CompressKernel, NodeCompressor};
use crate::layout::{Compress, Part};
use crate::query::intersect::SceneScale;
use crate::query::traverse::Triangles;
use crate::tree::KdTreeView;

/// Makes compressed nodes. The executor must hold the tree, the counters of
/// [`CompressCounters::at_start`](crate::layout::CompressCounters::at_start), and [the root](root) in the queue. An executor that
/// cannot read its counters runs some rounds; if parts still wait, it runs this again.
///
/// # Errors
/// The executor's.
pub fn compress<E: Executor<NodeCompressor>>(executor: &mut E) -> Result<(), E::Error> {
    let mut round = 0;
    while executor.pending(CompressCounter::Waiting, round)? {
        executor.dispatch(CompressKernel::OpenParts)?;
        executor.dispatch(CompressKernel::PlaceChildren)?;
        executor.dispatch(CompressKernel::EmitNodes)?;
        round += 1;
    }
    Ok(())
}

/// The part that is queued at first: the whole tree, by its bounds.
pub fn root(bounds: &crate::aabb::Aabb) -> Part {
    Part { lo: bounds.lo, first: 0, hi: bounds.hi, count: Part::SUBTREE }
}

/// More nodes than this are never made of a tree with so many nodes and references: a node has two children at least that have
/// references, or shares more than 31 references, two children at least getting 16 each.
pub const fn most_nodes(nodes: u32, references: u32) -> u32 {
    nodes / 2 + references / 16 + 1
}

impl CompressedNodes {
    /// The nodes of a tree with the snapped corners of its mesh by the rule that a device can follow; the hits are those of
    /// [`CompressedNodes::new`], and of the tree. The tree must be valid (see
    /// [`tree::validate`](crate::tree::validate)), and `scale` of these triangles. `None` where leaves name more than
    /// [`MOST_REFERENCES`](CompressedNodes::MOST_REFERENCES).
    pub fn greedy(
        tree: &KdTreeView<'_>,
        triangles: &(impl Triangles + ?Sized),
        scale: &SceneScale,
    ) -> Option<CompressedNodes> {
        if tree.references.len() > CompressedNodes::MOST_REFERENCES as usize {
            return None;
        }
        let inputs =
            Compress { slack: scale.slack, zero: 0, batch_room: u32::MAX, part_room: u32::MAX };
        let mut reference = Reference::new(*tree, triangles, inputs);
        match compress(&mut reference) {
            Ok(()) => Some(reference.into_nodes()),
            Err(never) => match never {},
        }
    }
}

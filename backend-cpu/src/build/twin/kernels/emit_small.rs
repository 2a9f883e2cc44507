//! `emit_small`: one workgroup a small root.
//!
//! Reads: small roots, their references, their addresses. Writes: nodes and references of their
//! subtrees. Devices build each subtree again; here `build_small` has kept it.

use splitplane_core::layout::{Extent, SmallRoot};
use splitplane_core::tree::node::{KdNode, NodeKind};

use crate::build::twin::subtrees::Subtrees;
use crate::cancel::ProgressMeter;
use crate::memory::Scatter;
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

/// Runs the kernel. `subtrees` holds an element for each `batch` roots.
#[allow(clippy::too_many_arguments, reason = "the buffers it reads and writes")]
pub(crate) fn run(
    meter: &ProgressMeter<'_>,
    batch: usize,
    roots: &[SmallRoot],
    sizes: &[Extent],
    subtrees: &[Subtrees],
    addresses: &[Extent],
    nodes: &mut [KdNode],
    leaf_references: &mut [u32],
) {
    let nodes = Scatter::new(nodes);
    let leaf_references = Scatter::new(leaf_references);
    let addresses = addresses.par_chunks(batch);
    let batches = roots.par_chunks(batch).zip(sizes.par_chunks(batch)).zip(addresses).zip(subtrees);
    let _loop = span::pieces_of(1);
    batches.for_each(|(((roots, sizes), addresses), subtrees)| {
        let _piece = span::piece();
        if meter.is_cancelled() {
            return;
        }
        let (mut node, mut reference) = (0, 0);
        for (size, address) in sizes.iter().zip(addresses) {
            let next_node = node + size.nodes as usize;
            let next_reference = reference + size.references as usize;
            // SAFETY: preorder addresses give each subtree a range of its own.
            let out = unsafe { nodes.part(address.nodes as usize, size.nodes as usize) };
            for (out, kept) in out.iter_mut().zip(&subtrees.nodes[node..next_node]) {
                *out = match kept.kind() {
                    NodeKind::Interior { axis, split, right } => {
                        KdNode::interior(axis, split, right + address.nodes)
                    }
                    NodeKind::Leaf { first, count } => {
                        KdNode::leaf(first + address.references, count)
                    }
                };
            }
            // SAFETY: as above.
            unsafe { leaf_references.part(address.references as usize, size.references as usize) }
                .copy_from_slice(&subtrees.references[reference..next_reference]);
            (node, reference) = (next_node, next_reference);
        }
        meter.advance(roots.len() as u64);
        meter.record_work((node + reference) as u64 / 2);
    });
}

//! `count_children`: one workgroup an active node.
//!
//! Reads: counts of the node's chunks. Writes: their exclusive scan in their place, and the node's
//! counts in its decision.

use splitplane_core::config::CHUNK;
use splitplane_core::layout::{Decision, LargeNode, Sides};

/// Runs the kernel. Serial: it adds two numbers for 256 references.
pub(crate) fn run(active: &[LargeNode], chunk_counts: &mut [Sides], decisions: &mut [Decision]) {
    for (node, decision) in active.iter().zip(decisions) {
        let first = node.first_chunk as usize;
        let mut total = Sides::default();
        for counts in &mut chunk_counts[first..first + node.count.div_ceil(CHUNK) as usize] {
            let here = *counts;
            *counts = total;
            total.left += here.left;
            total.right += here.right;
        }
        decision.counts = total;
    }
}

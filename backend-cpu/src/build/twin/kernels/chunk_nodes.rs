//! `chunk_nodes`: one workgroup.
//!
//! Reads: reference counts of the active nodes. Writes: each node's first chunk, by an exclusive
//! scan of the numbers of chunks, and their sum.

use splitplane_core::config::CHUNK;
use splitplane_core::kernel::Counter;
use splitplane_core::layout::{Counters, LargeNode};

/// Runs the kernel.
pub(crate) fn run(active: &mut [LargeNode], counters: &mut Counters) {
    let mut chunks = 0;
    for node in active {
        node.first_chunk = chunks;
        chunks += node.count.div_ceil(CHUNK);
    }
    counters[Counter::Chunks] = chunks;
}

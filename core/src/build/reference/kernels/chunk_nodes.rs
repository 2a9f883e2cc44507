use crate::config::CHUNK;
use crate::kernel::Counter;
use crate::layout::{Counters, LargeNode};

/// Gives each active node its first chunk, by an exclusive scan of the numbers of chunks, and counts
/// all chunks.
pub fn chunk_nodes(active_nodes: &mut [LargeNode], counters: &mut Counters) {
    let mut chunks = 0;
    for node in active_nodes {
        node.first_chunk = chunks;
        chunks += node.count.div_ceil(CHUNK);
    }
    counters[Counter::Chunks] = chunks;
}

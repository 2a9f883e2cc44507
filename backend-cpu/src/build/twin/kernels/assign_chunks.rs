//! `assign_chunks`: one workgroup a chunk; on devices it finds its node by binary search.
//!
//! Reads: first chunk, first reference and count of the active nodes. Writes: the chunks.

use splitplane_core::config::CHUNK;
use splitplane_core::layout::{Chunk, LargeNode};

/// Runs the kernel. Serial: it writes 16 bytes for 256 references.
pub(crate) fn run(active: &[LargeNode], chunks: &mut [Chunk]) {
    for (index, node) in active.iter().enumerate() {
        let first_chunk = node.first_chunk as usize;
        for k in 0..node.count.div_ceil(CHUNK) {
            chunks[first_chunk + k as usize] = Chunk {
                node: index as u32,
                first: node.first + k * CHUNK,
                count: CHUNK.min(node.count - k * CHUNK),
                padding: 0,
            };
        }
    }
}

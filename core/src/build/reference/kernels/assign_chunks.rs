use crate::config::CHUNK;
use crate::layout::{Chunk, LargeNode};

/// A chunk: its node, and up to 256 consecutive references of it. All chunks of a node but its last
/// are full.
pub fn assign_chunks(chunk: usize, active_nodes: &[LargeNode]) -> Chunk {
    let chunk = chunk as u32;
    // Each node has at least one chunk, so first chunks ascend.
    let index = active_nodes.partition_point(|node| node.first_chunk <= chunk) - 1;
    let node = &active_nodes[index];
    let offset = (chunk - node.first_chunk) * CHUNK;
    Chunk {
        node: index as u32,
        first: node.first + offset,
        count: CHUNK.min(node.count - offset),
        padding: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{chunk_nodes, chunks_of};
    use super::*;
    use crate::kernel::Counter;
    use crate::layout::Counters;
    use bytemuck::Zeroable;

    #[test]
    fn chunks_tile_the_references_of_every_node() {
        let mut first = 0;
        let mut nodes = [1, 256, 257, 65, 1000].map(|count| {
            first += count;
            LargeNode { first: first - count, count, ..LargeNode::zeroed() }
        });
        let mut counters = Counters::default();
        chunk_nodes(&mut nodes, &mut counters);
        assert_eq!(counters[Counter::Chunks], 1 + 1 + 2 + 1 + 4);
        let (mut chunk, mut reference) = (0, 0);
        for (index, node) in nodes.iter().enumerate() {
            assert_eq!(chunks_of(node).start, chunk);
            while chunk < chunks_of(node).end {
                let found = assign_chunks(chunk, &nodes);
                assert_eq!((found.node, found.first), (index as u32, reference));
                assert!((1..=CHUNK).contains(&found.count));
                (chunk, reference) = (chunk + 1, reference + found.count);
            }
            assert_eq!(reference, node.first + node.count);
        }
    }
}

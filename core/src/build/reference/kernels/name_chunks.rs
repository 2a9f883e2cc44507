use crate::config::CHUNK;
use crate::layout::{Chunk, LargeNode};

/// Names the chunks of an active node: each is up to 256 consecutive references of it. All chunks of a node
/// but its last are full.
///
/// `chunks` are those of the node, see [`super::chunks_of`].
pub fn name_chunks(node: usize, active_nodes: &[LargeNode], chunks: &mut [Chunk]) {
    let this = &active_nodes[node];
    for (index, chunk) in chunks.iter_mut().enumerate() {
        let offset = index as u32 * CHUNK;
        *chunk = Chunk {
            node: node as u32,
            first: this.first + offset,
            count: CHUNK.min(this.count - offset),
            span_sides: 0,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::chunks_of;
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn chunks_tile_the_references_of_every_node() {
        let (mut first, mut first_chunk) = (0, 0);
        let nodes = [1, 256, 257, 65, 1000].map(|count| {
            let node = LargeNode { first, count, first_chunk, ..LargeNode::zeroed() };
            (first, first_chunk) = (first + count, first_chunk + count.div_ceil(CHUNK));
            node
        });
        let mut chunks = [Chunk::zeroed(); 9];
        for node in 0..nodes.len() {
            name_chunks(node, &nodes, &mut chunks[chunks_of(&nodes[node])]);
        }
        let mut reference = 0;
        for chunk in chunks {
            let node = &nodes[chunk.node as usize];
            assert_eq!(chunk.first, reference);
            assert!((1..=CHUNK).contains(&chunk.count));
            reference += chunk.count;
            assert!((node.first..node.first + node.count).contains(&chunk.first));
            assert!(reference <= node.first + node.count);
            assert!(chunk.count == CHUNK || reference == node.first + node.count);
        }
        assert_eq!(reference, first);
    }
}

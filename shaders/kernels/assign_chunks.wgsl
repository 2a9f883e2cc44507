// Names node and range of every chunk.
// One invocation a chunk: it finds its node by binary search.
// Reads: first chunk, first reference and count of the active nodes.
// Writes: the chunks.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read_write> chunks: array<Chunk>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let nodes = active_node_count();
    let end = select(0u, slice_end(live(COUNTER_CHUNKS)), nodes > 0u);
    for (var chunk = parameters.first + group.x * LANES + lane; chunk < end; chunk += groups.x * LANES) {
        // The last node whose first chunk is not beyond this one. Every node has a chunk.
        var low = 0u;
        var high = nodes;
        while high - low > 1u {
            let middle = (low + high) / 2u;
            if active_nodes[middle].first_chunk <= chunk {
                low = middle;
            } else {
                high = middle;
            }
        }
        let offset = (chunk - active_nodes[low].first_chunk) * CHUNK;
        let rest = active_nodes[low].count - offset;
        chunks[chunk] = Chunk(low, active_nodes[low].first + offset, min(CHUNK, rest), 0u);
    }
}

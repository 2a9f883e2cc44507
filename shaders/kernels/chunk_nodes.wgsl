// Scans the numbers of chunks of the active nodes.
// One workgroup.
// Reads: reference counts of the active nodes.
// Writes: each node's first chunk, and the number of all chunks.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read_write> active_nodes: array<LargeNode>;

const LANES: u32 = 256u;

var<workgroup> node_count: u32;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        node_count = active_node_count();
    }
    let nodes = workgroupUniformLoad(&node_count);
    // A level without nodes leaves everything as it is.
    if nodes == 0u {
        return;
    }
    var chunks = 0u;
    for (var start = 0u; start < nodes; start += LANES) {
        let index = start + lane;
        var count = 0u;
        if index < nodes {
            count = chunks_of(active_nodes[index].count);
        }
        let before = exclusive_scan(lane, vec4<u32>(count, 0u, 0u, 0u));
        if index < nodes {
            active_nodes[index].first_chunk = chunks + before.x;
        }
        chunks += scan_total().x;
    }
    if lane == 0u {
        counters[COUNTER_CHUNKS] = chunks;
        if chunks > parameters.chunk_room {
            counters[COUNTER_OVERFLOW] = OVERFLOW_CHUNKS;
        }
    }
}

// Scans the counts of each node's chunks.
// One workgroup an active node.
// Reads: counts of the node's chunks.
// Writes: their exclusive scan in their place, and the node's counts in its decision.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read_write> chunk_state: array<u32>;
@group(0) @binding(4) var<storage, read_write> decisions: array<Decision>;

const LANES: u32 = 64u;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(active_node_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let first = active_nodes[index].first_chunk;
        let count = chunks_of(active_nodes[index].count);
        var total = vec2<u32>(0u);
        for (var start = 0u; start < count; start += LANES) {
            let chunk = start + lane;
            var counts = vec2<u32>(0u);
            if chunk < count {
                counts = load_counts(first + chunk);
            }
            let before = exclusive_scan(lane, vec4<u32>(counts, 0u, 0u));
            if chunk < count {
                store_counts(first + chunk, total + before.xy);
            }
            total += scan_total().xy;
        }
        if lane == 0u {
            decisions[index].counts = total;
        }
    }
}

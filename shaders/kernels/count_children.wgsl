// Scans the counts of each node's chunks.
// One workgroup an active node.
// Reads: counts of the node's chunks.
// Writes: their exclusive scan in their place, and the node's counts in its decision.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read_write> chunk_state: array<u32>;
@group(0) @binding(4) var<storage, read_write> decisions: array<Decision>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(active_node_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let first = active_nodes[index].first_chunk;
        let count = chunks_of(active_nodes[index].count);
        // As many chunks in a row an invocation.
        let share = (count + LANES - 1u) / LANES;
        let begin = first + min(lane * share, count);
        let last = first + min(lane * share + share, count);
        var own = vec2<u32>(0u);
        for (var chunk = begin; chunk < last; chunk++) {
            own += load_counts(chunk);
        }
        var before = inclusive_scan(lane, own) - own;
        for (var chunk = begin; chunk < last; chunk++) {
            let counts = load_counts(chunk);
            store_counts(chunk, before);
            before += counts;
        }
        if lane == 0u {
            decisions[index].counts = scan_sum();
        }
    }
}

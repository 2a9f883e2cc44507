// Writes the children whose places `allocate_children` has found, where that leaves it to others.
// One invocation a node of the active list.
// Reads: active nodes, decisions, and from the top tree where the children of each node begin.
// Writes: the next list, the small list and the top tree.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read_write> decisions: array<Decision>;
@group(0) @binding(4) var<storage, read_write> next_nodes: array<LargeNode>;
@group(0) @binding(5) var<storage, read_write> small_roots: array<SmallRoot>;
@group(0) @binding(6) var<storage, read_write> top_nodes: array<TopNode>;
@group(0) @binding(7) var<storage, read_write> level_starts: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(global_invocation_id) invocation: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    opaque_zero = parameters.zero;
    // Counted by now.
    level = counters[COUNTER_LEVELS] - 1u;
    // None where a list has outgrown its room.
    let nodes = active_node_count();
    for (var index = invocation.x; index < nodes; index += 64u * groups.x) {
        let node = active_nodes[index];
        let decision = decisions[index];
        let places = top_nodes[place_of_places(decision, node.node)];
        emit_nodes(index, decision, node, places.kind, places.split, places.left);
    }
}

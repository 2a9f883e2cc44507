// Writes the nodes of the top tree.
// One invocation a top node.
// Reads: the top tree and its addresses.
// Writes: its interior nodes and empty leaves in preorder; where its small roots begin, if there is no middle stage.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_nodes: array<TopNode>;
@group(0) @binding(3) var<storage, read> top_addresses: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> small_addresses: array<vec2<u32>>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(finished_top_nodes());
    for (var index = parameters.first + group.x * LANES + lane; index < end; index += groups.x * LANES) {
        let node = top_nodes[index];
        let address = top_addresses[index];
        if node.kind == EMPTY {
            nodes[address.x] = leaf(address.y, 0u);
        } else if node.kind < SMALL_ROOT {
            nodes[address.x] = vec2<u32>(node.split, (top_addresses[node.right].x << 2u) | node.kind);
        } else if middle_root_count() == 0u {
            small_addresses[node.left] = address;
        }
    }
}

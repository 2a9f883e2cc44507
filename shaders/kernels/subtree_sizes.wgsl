// Prepares the sums over the subtrees of the top tree, which `subtree_sizes_retry` makes.
// One invocation a top node.
// Reads: the top tree.
// Writes: the parent of each pair of nodes; zero as the sum of every node.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_nodes: array<TopNode>;
@group(0) @binding(3) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> middle_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> top_parents: array<u32>;
@group(0) @binding(6) var<storage, read_write> top_sizes: array<vec2<u32>>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = finished_top_nodes();
    for (var index = group.x * LANES + lane; index < end; index += groups.x * LANES) {
        let node = top_nodes[index];
        if node.kind < SMALL_ROOT {
            top_parents[pair_of(min(node.left, node.right))] = pair_word(index, node.left < node.right);
        }
        top_sizes[index] = vec2<u32>(0u);
    }
}

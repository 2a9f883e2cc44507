// Preorder addresses of the top tree.
// One invocation a top node, which goes up to the root and adds what stands before it: each ancestor, and the left subtree of those
// that it is to the right of.
// Reads: the top tree's parents and the sizes of its subtrees.
// Writes: where each subtree starts in the output: a left subtree just behind its parent, a right one
// behind the left one.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_parents: array<u32>;
@group(0) @binding(3) var<storage, read> top_sizes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> top_addresses: array<vec2<u32>>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = finished_top_nodes();
    for (var index = group.x * LANES + lane; index < end; index += groups.x * LANES) {
        var address = vec2<u32>(0u);
        var node = index;
        while node > 0u {
            let word = top_parents[pair_of(node)];
            address.x += 1u;
            if is_right_child(node, word) {
                address += top_sizes[sibling_of(node)];
            }
            node = parent_in(word);
        }
        top_addresses[index] = address;
    }
}

// Writes the subtrees of the small roots: builds each again, now that its place is known.
// One workgroup a small root, one invocation a triangle.
// Reads: small roots, their references, their addresses.
// Writes: nodes and references of their subtrees.
// Ties: least cost, then axis, then position.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> small_roots: array<SmallRoot>;
@group(0) @binding(3) var<storage, read> small_references: array<Reference>;
@group(0) @binding(4) var<storage, read> top_addresses: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> leaf_references: array<u32>;

// Where the root at hand begins in the output.
var<private> address: vec2<u32>;

// A leaf's first reference counts from the subtree's start.
fn put_node(index: u32, words: vec2<u32>) {
    let leaf_offset = select(0u, address.y, (words.y & 3u) == 3u);
    nodes[address.x + index] = vec2<u32>(words.x + leaf_offset, words.y);
}

// The right child of an interior node, now that it is known.
fn put_right(parent: u32, axis: u32, right: u32) {
    nodes[address.x + parent].y = ((address.x + right) << 2u) | axis;
}

fn put_reference(index: u32, triangle: u32) {
    leaf_references[address.y + index] = triangle;
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(live(COUNTER_SMALL_ROOTS));
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let root = small_roots[index];
        address = top_addresses[root.node];
        _ = build_subtree(root, lane);
    }
}

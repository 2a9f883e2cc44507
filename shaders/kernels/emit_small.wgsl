// Writes the subtrees of the small roots: copies those that were kept, builds the others again, now that
// their places are known.
// One workgroup a small root.
// Reads: small roots, their references, sizes, kept subtrees and addresses.
// Writes: nodes and references of their subtrees.
// Ties: least cost, then axis, then position.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> small_roots: array<SmallRoot>;
@group(0) @binding(3) var<storage, read> small_references: array<Reference>;
@group(0) @binding(4) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> subtrees: array<u32>;
@group(0) @binding(6) var<storage, read> small_addresses: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> leaf_references: array<u32>;

// The few roots that are built again are among the greatest: more invocations each finish them earlier.
const SMALL_LANES: u32 = 64u;

// Where the current root begins in the output.
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

// Copies a subtree that was kept: indices become addresses.
fn copy_subtree(slot: u32, size: vec2<u32>, lane: u32) {
    for (var i = lane; i < size.x; i += SMALL_LANES) {
        let words = vec2<u32>(subtrees[slot + 2u * i], subtrees[slot + 2u * i + 1u]);
        let is_leaf = (words.y & 3u) == 3u;
        nodes[address.x + i] = words
            + select(vec2<u32>(0u, address.x << 2u), vec2<u32>(address.y, 0u), is_leaf);
    }
    for (var i = lane; i < size.y; i += SMALL_LANES) {
        leaf_references[address.y + i] = subtrees[slot + 2u * SUBTREE_NODES + i];
    }
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
        // Uniform: every lane reads the same root.
        if !is_seen(root) {
            continue;
        }
        address = small_addresses[index];
        let size = small_sizes[index];
        if index < parameters.subtree_room && size.x <= SUBTREE_NODES && size.y <= SUBTREE_REFERENCES {
            copy_subtree(SUBTREE_WORDS * index, size, lane);
        } else {
            _ = build_subtree(root, lane);
        }
    }
}

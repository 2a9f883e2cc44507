// Builds the subtrees of the small roots that were not kept again, now that their places are known.
// One workgroup a small root.
// Reads: small roots, their references, sizes and addresses.
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

// Most of these roots are large: kept ones have few nodes.
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

// A leaf of a subtree that is built again: an invocation for each reference of a half.
fn put_leaf(index: u32, mask: vec2<u32>, first: u32, lane: u32) {
    let place = lane % 32u;
    let below = (1u << place) - 1u;
    let of_first_half = countOneBits(mask.x);
    if lane < 32u && ((mask.x >> place) & 1u) == 1u {
        put_reference(first + countOneBits(mask.x & below), own_triangles[place].x);
    }
    if lane >= 32u && ((mask.y >> place) & 1u) == 1u {
        put_reference(first + of_first_half + countOneBits(mask.y & below), own_triangles[place].y);
    }
    if lane == 0u {
        put_node(index, vec2<u32>(first, (count_mask(mask) << 2u) | 3u));
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
        // Uniform: every lane reads the same root.
        if has_subtree_slot(index) && small_sizes[index].x <= subtree_nodes() {
            continue;
        }
        let root = small_roots[index];
        if !is_seen(root) || root.count > parameters.small_node_limit {
            continue;
        }
        address = small_addresses[index];
        _ = build_subtree(root, lane);
    }
}

// Builds the subtree of every small root and measures it.
// One workgroup a small root.
// Reads: small roots and their references.
// Writes: how many nodes and references each root's subtree has; the subtree, where it is small enough
// to be kept.
// Ties: least cost, then axis, then position.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> small_roots: array<SmallRoot>;
@group(0) @binding(3) var<storage, read> small_references: array<Reference>;
@group(0) @binding(4) var<storage, read_write> small_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> subtrees: array<u32>;

// The memory of a root bounds how many roots are at work at a time; more invocations each hide what an invocation waits for.
// On an H100 a root by 128 takes two thirds of what it takes by 32, and by 64 three quarters.
const SMALL_LANES: u32 = 128u;

// Where the current subtree is kept, and whether there is space for it.
var<private> slot: u32;
var<private> kept: bool;

// Indices count from the subtree's start.
fn put_node(index: u32, words: vec2<u32>) {
    if kept && index < subtree_nodes() {
        subtrees[slot + 3u * index] = words.x;
        subtrees[slot + 3u * index + 2u] = words.y;
    }
}

fn put_right(parent: u32, axis: u32, right: u32) {
    if kept && parent < subtree_nodes() {
        subtrees[slot + 3u * parent + 2u] = (right << 2u) | axis;
    }
}

fn put_leaf(index: u32, mask: vec2<u32>, first: u32, lane: u32) {
    if lane == 0u && kept && index < subtree_nodes() {
        let at = slot + 3u * index;
        subtrees[at] = mask.x;
        subtrees[at + 1u] = mask.y;
        subtrees[at + 2u] = (first << 2u) | 3u;
    }
}

// A leaf too large to split is not kept.
fn put_reference(index: u32, triangle: u32) {}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(live(COUNTER_SMALL_ROOTS));
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        slot = subtree_slot(index);
        kept = has_subtree_slot(index);
        let root = small_roots[index];
        // Uniform: every lane reads the same root.
        if !is_seen(root) {
            continue;
        }
        var size = vec2<u32>(1u, root.count);
        if root.count > parameters.small_node_limit {
            put_large_leaf(root, lane);
        } else {
            size = build_subtree(root, lane);
        }
        if lane == 0u && begins_here(root) {
            small_sizes[index] = size;
        }
    }
}

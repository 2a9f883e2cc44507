// Writes the subtrees of the small roots that were kept, and leaves too large to split. `emit_small_retry` builds the others
// again: it takes the memory of a workgroup that copies would have to do without.
// One workgroup a small root.
// Reads: small roots, their references, sizes, kept subtrees and addresses.
// Writes: nodes and references of their subtrees.
// Ties: none.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> small_roots: array<SmallRoot>;
@group(0) @binding(3) var<storage, read> small_references: array<Reference>;
@group(0) @binding(4) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> subtrees: array<u32>;
@group(0) @binding(6) var<storage, read> small_addresses: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> leaf_references: array<u32>;

const SMALL_LANES: u32 = 64u;

// Where the current root begins in the output.
var<private> address: vec2<u32>;

// A leaf's first reference counts from the subtree's start.
fn put_node(index: u32, words: vec2<u32>) {
    let leaf_offset = select(0u, address.y, (words.y & 3u) == 3u);
    nodes[address.x + index] = vec2<u32>(words.x + leaf_offset, words.y);
}

fn put_reference(index: u32, triangle: u32) {
    leaf_references[address.y + index] = triangle;
}

// The triangles of a leaf's references in one half of the root's.
fn put_half(mask: u32, first: u32, second: bool) {
    var at = first;
    for (var left = mask; left != 0u; left &= left - 1u) {
        let own = own_triangles[firstTrailingBit(left)];
        put_reference(at, select(own.x, own.y, second));
        at += 1u;
    }
}

// Copies a subtree that was kept: indices become addresses. An invocation every 64th node.
fn copy_subtree(root: SmallRoot, slot: u32, count: u32, lane: u32) {
    workgroupBarrier();
    let half = (root.count + 1u) / 2u;
    if lane < half {
        let at = root.first + lane - first_seen();
        // Of an odd number one is missing: then the other half's last is read, and no leaf has it.
        own_triangles[lane] = vec2<u32>(
            small_references[at].triangle, small_references[at + min(half, root.count - 1u - lane)].triangle);
    }
    workgroupBarrier();
    for (var node = lane; node < count; node += SMALL_LANES) {
        let at = slot + 3u * node;
        let mask = vec2<u32>(subtrees[at], subtrees[at + 1u]);
        let last = subtrees[at + 2u];
        if (last & 3u) == 3u {
            let first = last >> 2u;
            put_half(mask.x, first, false);
            put_half(mask.y, first + countOneBits(mask.x), true);
            put_node(node, leaf(first, count_mask(mask)));
        } else {
            nodes[address.x + node] = vec2<u32>(mask.x, last + (address.x << 2u));
        }
    }
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(live(COUNTER_SMALL_ROOTS));
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let root = small_roots[index];
        // Uniform: every lane reads the same root.
        if !is_seen(root) {
            continue;
        }
        address = small_addresses[index];
        let size = small_sizes[index];
        if root.count > parameters.small_node_limit {
            put_large_leaf(root, lane);
        } else if has_subtree_slot(index) && size.x <= subtree_nodes() {
            copy_subtree(root, subtree_slot(index), size.x, lane);
        }
    }
}

// What the kernels of small roots share: which of a root's references a dispatch sees, and leaves that are too large to split.
// References of a root are in two halves of equal length, one bit in one of two words each: the first half in the first word.
//
// The kernel says how many invocations it has, SMALL_LANES, and what becomes of a leaf too large to split, and of its
// references: `put_node`, `put_reference`.
// Needs the bindings `parameters` and `small_references`.

// The triangles of each lane's two references.
var<workgroup> own_triangles: array<vec2<u32>, 32>;

// Slots that the kept subtree of a root may take: more where leaves are small. Twin of `subtree_slots` in core/src/kernel/builder.rs.
fn subtree_slots() -> u32 {
    return select(1u, 4u, parameters.block_width < 4u);
}

fn subtree_nodes() -> u32 {
    return SUBTREE_NODES * subtree_slots();
}

// Where the subtree of a root is kept.
fn subtree_slot(index: u32) -> u32 {
    return SUBTREE_WORDS * subtree_slots() * index;
}

// Whether there is room for the subtree of a root.
fn has_subtree_slot(index: u32) -> bool {
    return index < parameters.subtree_room / subtree_slots();
}

fn count_mask(mask: vec2<u32>) -> u32 {
    return countOneBits(mask.x) + countOneBits(mask.y);
}

// The references that a dispatch sees, where one binding does not hold all: those of the first half or of the second.
// A root of at most T references is worked on where its first reference is; the binding reaches so far beyond its
// half that it holds the others too. Without halves the first has all.
fn first_seen() -> u32 {
    return select(0u, parameters.small_reference_half, (parameters.view & 1u) != 0u);
}

fn end_seen() -> u32 {
    return select(parameters.small_reference_half, 0xffffffffu, (parameters.view & 1u) != 0u);
}

// Whether a root's first reference is seen.
fn begins_here(root: SmallRoot) -> bool {
    return root.first >= first_seen() && root.first < end_seen();
}

// Whether a dispatch works on a root: of a leaf too large to split it sees a part.
fn is_seen(root: SmallRoot) -> bool {
    return begins_here(root) || root.count > parameters.small_node_limit;
}

// A root of more than T references is a leaf too large to split: as much of it as the dispatch sees.
fn put_large_leaf(root: SmallRoot, lane: u32) {
    let end = min(root.first + root.count, end_seen());
    for (var place = max(root.first, first_seen()) + lane; place < end; place += SMALL_LANES) {
        put_reference(place - root.first, small_references[place - first_seen()].triangle);
    }
    if lane == 0u && begins_here(root) {
        put_node(0u, vec2<u32>(0u, (root.count << 2u) | 3u));
    }
}

// Twin of core/src/layout.rs: the records that kernels exchange. See there for what each field means.

struct Reference {
    lo: vec3<f32>,
    triangle: u32,
    hi: vec3<f32>,
    padding: u32,
}

struct LargeNode {
    lo: vec3<f32>,
    first: u32,
    hi: vec3<f32>,
    count: u32,
    node: u32,
    depth: u32,
    source: u32,
    source_chunks: u32,
    side: u32,
    inseparable: u32,
    first_chunk: u32,
    padding: u32,
}

struct Chunk {
    node: u32,
    first: u32,
    count: u32,
    span_sides: u32,
}

struct Decision {
    cuts: array<f32, 6>,
    cut_count: u32,
    cut_sides: u32,
    axis: u32,
    position: f32,
    counts: vec2<u32>,
    first: vec2<u32>,
    first_node: u32,
    source_first: u32,
}

// Decision.axis of a node that goes to the small list as it is.
const TRANSFER: u32 = 3u;
// A bit of Decision.cut_sides that no side needs: the decision could not be finished.
const UNDECIDED: u32 = 0x80000000u;

struct TopNode {
    kind: u32,
    split: u32,
    left: u32,
    right: u32,
}

// TopNode.kind of a root of the small-node stage, and of an empty leaf; below, an axis.
const SMALL_ROOT: u32 = 3u;
const EMPTY: u32 = 4u;

struct SmallRoot {
    lo: vec3<f32>,
    first: u32,
    hi: vec3<f32>,
    count: u32,
    node: u32,
    depth: u32,
    level: u32,
    padding: u32,
}

struct MiddleRoot {
    node: u32,
    first: u32,
    count: u32,
    levels: u32,
    nodes: u32,
    leaves: u32,
    references: u32,
    growth: u32,
    first_leaf: u32,
    first_reference: u32,
    outgrown: u32,
    padding: u32,
}

struct Parameters {
    zero: u32,
    swapped: u32,
    first: u32,
    count: u32,
    traversal_cost: u32,
    intersection_cost: u32,
    block_width: u32,
    small_node_limit: u32,
    hand_over_limit: u32,
    empty_cutoff: u32,
    max_depth: u32,
    reference_cap: u32,
    node_cap: u32,
    first_index: u32,
    chunk_room: u32,
    node_room: u32,
    reference_room: u32,
    small_root_room: u32,
    small_reference_room: u32,
    top_node_room: u32,
    level_room: u32,
    tree_node_room: u32,
    leaf_reference_room: u32,
    subtree_room: u32,
    middle_reference_room: u32,
    middle_node_room: u32,
    middle_leaf_room: u32,
    bins: u32,
    clip: u32,
    view: u32,
    reference_half: u32,
    small_reference_half: u32,
}

// Twin of core/src/layout/compress.rs and core/src/kernel/compress.rs: the records and counters of the kernels that make
// compressed nodes. Needs the bindings `compress` and `counters`.

struct Part {
    lo: vec3<f32>,
    first: u32,
    hi: vec3<f32>,
    count: u32,
}

struct Compress {
    slack: f32,
    zero: u32,
    batch_room: u32,
    part_room: u32,
}

// Part.count of a subtree.
const SUBTREE: u32 = 0xffffffffu;
// Children of a node.
const CHILDREN: u32 = 8u;
// Most references of a leaf.
const LEAF_MOST: u32 = 31u;

// By the numbers of the counters.
fn waiting_count() -> u32 {
    return counters[0];
}

fn active_count() -> u32 {
    return counters[1];
}

fn made_count() -> u32 {
    return counters[2];
}

// Whether a child becomes a node.
fn is_node(part: Part) -> bool {
    return part.count > LEAF_MOST;
}

// Twin of core/src/build/middle.rs: where the regions of a middle root begin, and how long they are.

const ACTIVE_NODES: u32 = 96u;
const LEVEL_REFERENCES: u32 = 8192u;
const NO_NODE: u32 = 0xffffffffu;

// First of a root's nodes, and of its leaves. Before the nodes of all stands what build_middle.wgsl counts.
fn first_middle_node(first: u32, index: u32) -> u32 {
    return 1u + first / 2u + 128u * index;
}

fn first_middle_leaf(first: u32, index: u32) -> u32 {
    return first / 4u + 64u * index;
}

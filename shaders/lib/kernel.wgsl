// Twin of core/src/kernel/builder.rs: counters, and the part of a grid that a workgroup takes.
// Needs the bindings `parameters` and `counters`.

const CHUNK: u32 = 256u;
// Chunks of a node that are counted together.
const SPAN: u32 = 128u;

const COUNTER_TRIANGLES: u32 = 0u;
const COUNTER_INPUT_CHUNKS: u32 = 1u;
const COUNTER_DROPPED: u32 = 2u;
const COUNTER_SNAPPED: u32 = 3u;
const COUNTER_ACTIVE_NODES: u32 = 4u;
const COUNTER_NEXT_NODES: u32 = 5u;
const COUNTER_ACTIVE_REFERENCES: u32 = 6u;
const COUNTER_NEXT_REFERENCES: u32 = 7u;
const COUNTER_CHUNKS: u32 = 8u;
const COUNTER_NEXT_CHUNKS: u32 = 9u;
const COUNTER_SMALL_ROOTS: u32 = 10u;
const COUNTER_SMALL_REFERENCES: u32 = 11u;
const COUNTER_TOP_NODES: u32 = 12u;
const COUNTER_LEVELS: u32 = 13u;
const COUNTER_NODES: u32 = 14u;
const COUNTER_LEAF_REFERENCES: u32 = 15u;
const COUNTER_OVERFLOW: u32 = 16u;
const COUNTER_GROWTH: u32 = 17u;
const COUNTER_MIDDLE_ROOTS: u32 = 18u;
const COUNTER_MIDDLE_LEVELS: u32 = 19u;

const OVERFLOW_NODES: u32 = 1u;
const OVERFLOW_REFERENCES: u32 = 2u;
const OVERFLOW_SMALL_ROOTS: u32 = 4u;
const OVERFLOW_SMALL_REFERENCES: u32 = 8u;
const OVERFLOW_TOP_NODES: u32 = 16u;
const OVERFLOW_LEVELS: u32 = 32u;
const OVERFLOW_TREE_NODES: u32 = 64u;
const OVERFLOW_LEAF_REFERENCES: u32 = 128u;
const OVERFLOW_CHUNKS: u32 = 256u;
// Not a list: a driver ended a loop before its end.
const OVERFLOW_UNFINISHED: u32 = 512u;
// Not a list: the middle stage cannot finish what was handed over to it.
const OVERFLOW_MIDDLE_STAGE: u32 = 1024u;
const OVERFLOW_MIDDLE_REGIONS: u32 = 2048u;

// A counter; zero once a list has outgrown its room, so that nothing more is done.
fn live(counter: u32) -> u32 {
    return select(0u, counters[counter], counters[COUNTER_OVERFLOW] == 0u);
}

// Active and next lists change places by name alone: their counters do so here.
fn active_node_count() -> u32 {
    return live(COUNTER_ACTIVE_NODES + parameters.swapped);
}

fn active_chunk_count() -> u32 {
    return live(COUNTER_CHUNKS + parameters.swapped);
}

// Where this slice of a grid over `count` items ends.
fn slice_end(count: u32) -> u32 {
    return parameters.first + min(parameters.count, max(count, parameters.first) - parameters.first);
}

// The roots of the middle stage. While nodes are active the levels have more to hand over, and the stage waits.
fn middle_root_count() -> u32 {
    return select(0u, live(COUNTER_MIDDLE_ROOTS), active_node_count() == 0u);
}

// The nodes of the top tree. None while nodes are active, since these have yet to become nodes of it.
fn finished_top_nodes() -> u32 {
    return select(0u, live(COUNTER_TOP_NODES), active_node_count() == 0u);
}

// How many chunks a node of `count` references has.
fn chunks_of(count: u32) -> u32 {
    return (count + CHUNK - 1u) / CHUNK;
}

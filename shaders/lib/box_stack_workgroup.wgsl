// The stack of a traversal of compressed nodes in the memory of the workgroup, as in short_stack_workgroup.wgsl. In place of
// box_stack.wgsl.

const BOX_ENTRIES: u32 = 16u;
// From one entry to the next, as in short_stack_workgroup.wgsl.
const STACK_STEP: u32 = 64u;
const BOX_SIZE: u32 = STACK_STEP * BOX_ENTRIES;

var<workgroup> stack_keys: array<u32, BOX_SIZE>;
var<workgroup> stack_nodes: array<u32, BOX_SIZE>;

// The invocation's index in its workgroup.
var<private> stack_lane: u32;

// An entry point calls it first.
fn begin_stack(lane: u32) {
    stack_lane = lane;
}

fn stack_start() -> u32 {
    return STACK_STEP + stack_lane;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + BOX_SIZE;
}

// Puts a child on the stack if it is one, and returns where the stack ends then. Beyond its room nothing is stored.
fn stack_pushed(at: u32, key: u32, node: u32) -> u32 {
    if key != NO_CHILD && stack_has(at) {
        stack_keys[at - STACK_STEP] = key;
        stack_nodes[at - STACK_STEP] = node;
    }
    return at + select(STACK_STEP, 0u, key == NO_CHILD);
}

fn stack_entry(at: u32) -> vec2<u32> {
    return vec2<u32>(stack_keys[at - STACK_STEP], stack_nodes[at - STACK_STEP]);
}

// The stack of a traversal of compressed nodes in the memory of the invocation, as in short_stack.wgsl. An entry is a node,
// and the key of one of its children: where the ray enters the child's box, and its place among the children. A ray that
// needs more is deferred.

const BOX_ENTRIES: u32 = 16u;
// From one entry to the next. Below it, the stack is empty.
const STACK_STEP: u32 = 1u;

// Key and node.
var<private> stack_entries: array<vec2<u32>, BOX_ENTRIES>;

// An entry point calls it first. The memory of the invocation needs no lane.
fn begin_stack(lane: u32) {}

fn stack_start() -> u32 {
    return STACK_STEP;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + BOX_ENTRIES;
}

// Puts a child on the stack if it is one, and returns where the stack ends then. Beyond its room nothing is stored.
fn stack_pushed(at: u32, key: u32, node: u32) -> u32 {
    if key != NO_CHILD && stack_has(at) {
        stack_entries[at - STACK_STEP] = vec2<u32>(key, node);
    }
    return at + select(STACK_STEP, 0u, key == NO_CHILD);
}

fn stack_entry(at: u32) -> vec2<u32> {
    return stack_entries[at - STACK_STEP];
}

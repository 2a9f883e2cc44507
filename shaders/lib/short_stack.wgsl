// A short stack of a traversal in the memory of the workgroup, for kernels of 64 invocations: nearer than the memory
// of an invocation, and never zeroed. A ray that needs more is deferred. In place of private_stack.wgsl.

const SHORT_ENTRIES: u32 = 12u;
const LANES: u32 = 64u;
// From one entry to the next: those of all lanes lie side by side, so that lanes do not get in one another's way.
// Below it, the stack is empty.
const STACK_STEP: u32 = LANES;
const SHORT_SIZE: u32 = LANES * SHORT_ENTRIES;

var<workgroup> stack_nodes: array<u32, SHORT_SIZE>;
var<workgroup> stack_enters: array<f32, SHORT_SIZE>;
var<workgroup> stack_leaves: array<f32, SHORT_SIZE>;

// The invocation's index in its workgroup. An entry point sets it.
var<private> stack_lane: u32;

fn stack_start() -> u32 {
    return STACK_STEP + stack_lane;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + SHORT_SIZE;
}

fn stack_store(at: u32, entry: StackEntry) {
    let place = at - STACK_STEP;
    stack_nodes[place] = entry.node;
    stack_enters[place] = entry.enter;
    stack_leaves[place] = entry.leave;
}

fn stack_entry(at: u32) -> StackEntry {
    let place = at - STACK_STEP;
    return StackEntry(stack_nodes[place], stack_enters[place], stack_leaves[place]);
}

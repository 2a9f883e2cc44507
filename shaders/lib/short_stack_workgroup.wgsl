// The short stack of a traversal in the memory of the workgroup, for kernels of 64 invocations. In place of short_stack.wgsl
// for devices whose compilers keep arrays of an invocation in registers and choose among them by comparisons. A ray that needs more
// entries is deferred.

const SHORT_ENTRIES: u32 = 12u;
// From one entry to the next: those of all invocations lie side by side, so that invocations do not get in one another's way.
// Below it, the stack is empty.
const STACK_STEP: u32 = 64u;
const SHORT_SIZE: u32 = STACK_STEP * SHORT_ENTRIES;

var<workgroup> stack_nodes: array<u32, SHORT_SIZE>;
var<workgroup> stack_enters: array<f32, SHORT_SIZE>;
var<workgroup> stack_leaves: array<f32, SHORT_SIZE>;

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

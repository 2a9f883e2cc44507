// A short stack of a traversal in the memory of the invocation, which hardware keeps in its nearest cache. In the memory of
// the workgroup it took that cache away from the tree, and rays took 1.3 to 1.6 times as long on an H100. A ray that needs
// more entries is deferred. In place of private_stack.wgsl.

const SHORT_ENTRIES: u32 = 16u;
// From one entry to the next. Below it, the stack is empty.
const STACK_STEP: u32 = 1u;

var<private> stack: array<StackEntry, SHORT_ENTRIES>;

// An entry point calls it first. The memory of the invocation needs no lane.
fn begin_stack(lane: u32) {}

fn stack_start() -> u32 {
    return STACK_STEP;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + SHORT_ENTRIES;
}

fn stack_store(at: u32, entry: StackEntry) {
    stack[at - STACK_STEP] = entry;
}

fn stack_entry(at: u32) -> StackEntry {
    return stack[at - STACK_STEP];
}

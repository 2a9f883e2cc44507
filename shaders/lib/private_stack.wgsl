// The stack of a traversal, deep enough for every tree, in the memory of the invocation.

// MAX_DEPTH + 1: one entry a level, and the first, which is not used.
const STACK_ENTRIES: u32 = 97u;
// From one entry to the next. Below it, the stack is empty.
const STACK_STEP: u32 = 1u;

var<private> stack: array<StackEntry, STACK_ENTRIES>;

fn stack_start() -> u32 {
    return 1u;
}

// Whether there is an entry of this number.
fn stack_has(entry: u32) -> bool {
    return true;
}

fn stack_store(at: u32, entry: StackEntry) {
    stack[at] = entry;
}

fn stack_entry(at: u32) -> StackEntry {
    return stack[at];
}

// The stack of a traversal of compressed nodes in the memory of the workgroup, for kernels of 64 invocations. An entry
// is a node, and the key of one of its children: where the ray enters the child's box, and its place among the children. A
// ray that needs more is deferred.

const BOX_ENTRIES: u32 = 16u;
const LANES: u32 = 64u;
// From one entry to the next: those of all lanes lie side by side. Below it, the stack is empty.
const STACK_STEP: u32 = LANES;
const BOX_STACK_SIZE: u32 = LANES * BOX_ENTRIES;

// Key and node.
var<workgroup> stack_entries: array<vec2<u32>, BOX_STACK_SIZE>;

// The invocation's index in its workgroup. An entry point sets it.
var<private> stack_lane: u32;

fn stack_start() -> u32 {
    return STACK_STEP + stack_lane;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + BOX_STACK_SIZE;
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

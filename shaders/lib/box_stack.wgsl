// The stack of a traversal of compressed nodes in the memory of the workgroup, for kernels of 64 invocations. An entry
// is a node, and the key of one of its children: where the ray enters the child's box, and its place among the children. A
// ray that needs more is deferred.

const BOX_ENTRIES: u32 = 24u;
const LANES: u32 = 64u;
// From one entry to the next: those of all lanes lie side by side. Below it, the stack is empty.
const STACK_STEP: u32 = LANES;
const BOX_STACK_SIZE: u32 = LANES * BOX_ENTRIES;

var<workgroup> stack_keys: array<u32, BOX_STACK_SIZE>;
var<workgroup> stack_nodes: array<u32, BOX_STACK_SIZE>;

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
    if key == NO_CHILD {
        return at;
    }
    if stack_has(at) {
        stack_keys[at - STACK_STEP] = key;
        stack_nodes[at - STACK_STEP] = node;
    }
    return at + STACK_STEP;
}

fn stack_key(at: u32) -> u32 {
    return stack_keys[at - STACK_STEP];
}

fn stack_node(at: u32) -> u32 {
    return stack_nodes[at - STACK_STEP];
}

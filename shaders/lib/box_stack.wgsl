// The stack of a traversal of compressed nodes in the memory of the workgroup, for kernels of 64 invocations. An entry
// is a node or a leaf, and where the ray enters its box. A ray that needs more is deferred.

const BOX_ENTRIES: u32 = 24u;
const LANES: u32 = 64u;
// From one entry to the next: those of all lanes lie side by side. Below it, the stack is empty.
const STACK_STEP: u32 = LANES;
const BOX_STACK_SIZE: u32 = LANES * BOX_ENTRIES;

var<workgroup> stack_words: array<u32, BOX_STACK_SIZE>;
var<workgroup> stack_enters: array<f32, BOX_STACK_SIZE>;

// The invocation's index in its workgroup. An entry point sets it.
var<private> stack_lane: u32;

fn stack_start() -> u32 {
    return STACK_STEP + stack_lane;
}

fn stack_has(entry: u32) -> bool {
    return entry < STACK_STEP + BOX_STACK_SIZE;
}

fn stack_store(at: u32, word: u32, enter: f32) {
    stack_words[at - STACK_STEP] = word;
    stack_enters[at - STACK_STEP] = enter;
}

fn stack_word(at: u32) -> u32 {
    return stack_words[at - STACK_STEP];
}

fn stack_enter(at: u32) -> f32 {
    return stack_enters[at - STACK_STEP];
}

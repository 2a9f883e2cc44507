// Sizes of the subtrees of the top tree, bottom up.
// One workgroup, one invocation a node, level by level from the deepest.
// Reads: the top tree, sizes of the middle roots, or of the small roots where there is no middle stage.
// Writes: nodes and references of every top node's subtree; the size of the tree.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_nodes: array<TopNode>;
@group(0) @binding(3) var<storage, read> level_starts: array<u32>;
@group(0) @binding(4) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> middle_sizes: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> top_sizes: array<vec2<u32>>;

const LANES: u32 = 256u;

var<workgroup> level_count: u32;
var<workgroup> node_count: u32;
var<private> has_middle_stage: bool;

// a + b, each at most 2^32 - 1.
fn saturating_sum(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return a + min(b, vec2<u32>(0xffffffffu) - a);
}

// The size of a node whose children, if any, belong to a deeper level.
fn size_above(node: TopNode) -> vec2<u32> {
    if node.kind == EMPTY {
        return vec2<u32>(1u, 0u);
    }
    if node.kind == SMALL_ROOT {
        // What the levels have handed over: to the middle stage, if there is one.
        if has_middle_stage {
            return middle_sizes[node.left];
        }
        return small_sizes[node.left];
    }
    let children = saturating_sum(top_sizes[node.left], top_sizes[node.right]);
    return saturating_sum(children, vec2<u32>(1u, 0u));
}

// The size of a node of the level that ends before `end`. Cuts and the split that follows them are
// emitted at one level: such a chain is walked by every node on it, down to what lies deeper. The
// second of two siblings continues the chain.
fn size_of(index: u32, end: u32) -> vec2<u32> {
    var total = vec2<u32>(0u);
    var node = top_nodes[index];
    while node.kind < SMALL_ROOT && min(node.left, node.right) < end {
        let sibling = min(node.left, node.right);
        total = saturating_sum(total, size_above(top_nodes[sibling]) + vec2<u32>(1u, 0u));
        node = top_nodes[sibling + 1u];
    }
    return saturating_sum(total, size_above(node));
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    has_middle_stage = middle_root_count() > 0u;
    if lane == 0u {
        level_count = live(COUNTER_LEVELS);
        node_count = live(COUNTER_TOP_NODES);
    }
    let levels = workgroupUniformLoad(&level_count);
    let nodes = workgroupUniformLoad(&node_count);
    var end = nodes;
    // Level 0 holds what the root emits; before it stands the root alone.
    for (var level = levels + 1u; level > 0u; level--) {
        var start = 0u;
        if level > 1u {
            start = level_starts[level - 2u];
        }
        for (var index = start + lane; index < end; index += LANES) {
            top_sizes[index] = size_of(index, end);
        }
        end = start;
        storageBarrier();
    }
    if lane == 0u && nodes > 0u {
        let size = top_sizes[0];
        counters[COUNTER_NODES] = size.x;
        counters[COUNTER_LEAF_REFERENCES] = size.y;
        var overflow = 0u;
        overflow |= select(0u, OVERFLOW_TREE_NODES, size.x > parameters.tree_node_room);
        overflow |= select(0u, OVERFLOW_LEAF_REFERENCES, size.y > parameters.leaf_reference_room);
        // What `build_small` says of a subtree that it could not finish; sums stay there.
        overflow |= select(0u, OVERFLOW_UNFINISHED, size.y == 0xffffffffu);
        if overflow != 0u {
            counters[COUNTER_OVERFLOW] = overflow;
        }
    }
}

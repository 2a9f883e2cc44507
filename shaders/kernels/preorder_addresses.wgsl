// Preorder addresses of the top tree, top down.
// One workgroup, one invocation a node, level by level from the root.
// Reads: the top tree and the sizes of its subtrees.
// Writes: where each subtree starts in the output: a left subtree just behind its parent, a right one
// behind the left one.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_nodes: array<TopNode>;
@group(0) @binding(3) var<storage, read> level_starts: array<u32>;
@group(0) @binding(4) var<storage, read> top_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> top_addresses: array<vec2<u32>>;

const LANES: u32 = 256u;

// Gives the children of a node of an earlier level their addresses, and then, along the chain of cuts
// and split that was emitted with them, theirs: down to the nodes before `end` that have none there.
fn address_children(parent: u32, end: u32) {
    var index = parent;
    var node = top_nodes[index];
    while node.kind < SMALL_ROOT && min(node.left, node.right) < end {
        let here = top_addresses[index];
        let left = vec2<u32>(here.x + 1u, here.y);
        top_addresses[node.left] = left;
        top_addresses[node.right] = left + top_sizes[node.left];
        index = min(node.left, node.right) + 1u;
        node = top_nodes[index];
    }
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let levels = live(COUNTER_LEVELS);
    let nodes = live(COUNTER_TOP_NODES);
    if lane == 0u && nodes > 0u {
        top_addresses[0] = vec2<u32>(0u);
    }
    storageBarrier();
    // The parents of level 0 are the root; those of a later level stand in the level before it.
    var start = 0u;
    for (var level = 0u; level < levels; level++) {
        let middle = level_starts[level];
        var end = nodes;
        if level + 1u < levels {
            end = level_starts[level + 1u];
        }
        for (var index = start + lane; index < middle; index += LANES) {
            let node = top_nodes[index];
            // The children of others have their addresses: they stand in the parents' own level.
            if node.kind < SMALL_ROOT && min(node.left, node.right) >= middle {
                address_children(index, end);
            }
        }
        start = middle;
        storageBarrier();
    }
}

// Counts the tree, now that the sizes of all subtrees are known. `preorder_addresses_retry` gives the addresses.
// One workgroup, one invocation.
// Reads: the size of the root's subtree.
// Writes: the number of nodes and references of the tree, and whether there is room for them.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_parents: array<u32>;
@group(0) @binding(3) var<storage, read> top_sizes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> top_addresses: array<vec2<u32>>;

@compute @workgroup_size(1)
fn main() {
    if finished_top_nodes() == 0u {
        return;
    }
    let size = top_sizes[0];
    counters[COUNTER_NODES] = size.x;
    counters[COUNTER_LEAF_REFERENCES] = size.y;
    var overflow = 0u;
    overflow |= select(0u, OVERFLOW_TREE_NODES, size.x > parameters.tree_node_room);
    overflow |= select(0u, OVERFLOW_LEAF_REFERENCES, size.y > parameters.leaf_reference_room);
    // What `build_small` says of a subtree that it could not finish is more than any sum.
    overflow |= select(0u, OVERFLOW_UNFINISHED, size.y == MOST_SUMMED);
    if overflow != 0u {
        counters[COUNTER_OVERFLOW] = overflow;
    }
}

// Sizes of the subtrees of the top tree, bottom up.
// One invocation a top node. That of a leaf takes its size to the parent. Whoever comes to a node second has both children's sizes, and goes
// on; the first is done. Nodes and references are taken up one after the other, since no rule of WGSL orders two words: each
// has a bit that says whether one child's share is in it. Nobody waits for anybody.
// Reads: the top tree, its parents, sizes of the middle roots, or of the small roots where there is no middle stage.
// Writes: nodes and references of every top node's subtree.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> top_nodes: array<TopNode>;
@group(0) @binding(3) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> middle_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> top_parents: array<u32>;
// Two words a node.
@group(0) @binding(6) var<storage, read_write> top_sizes: array<atomic<u32>>;

const LANES: u32 = 256u;
const ARRIVED: u32 = 0x80000000u;

// Takes the size of a leaf up, in the one word of every node or in the other. `own` is what an interior node adds.
fn take_up(leaf: u32, leaf_size: u32, word: u32, own: u32) {
    var node = leaf;
    var size = min(leaf_size, MOST_SUMMED);
    atomicStore(&top_sizes[2u * node + word], size);
    while node > 0u {
        let parent = parent_in(top_parents[pair_of(node)]);
        let before = atomicAdd(&top_sizes[2u * parent + word], size | ARRIVED);
        if (before & ARRIVED) == 0u {
            return;
        }
        size = min(size + (before ^ ARRIVED), MOST_SUMMED - own) + own;
        atomicStore(&top_sizes[2u * parent + word], size);
        node = parent;
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = finished_top_nodes();
    let has_middle_stage = middle_root_count() > 0u;
    for (var index = group.x * LANES + lane; index < end; index += groups.x * LANES) {
        let node = top_nodes[index];
        var size = vec2<u32>(1u, 0u);
        if node.kind == SMALL_ROOT {
            // What the levels have handed over: to the middle stage, if there is one.
            if has_middle_stage {
                size = middle_sizes[node.left];
            } else {
                size = small_sizes[node.left];
            }
        } else if node.kind != EMPTY {
            continue;
        }
        take_up(index, size.x, 0u, 1u);
        take_up(index, size.y, 1u, 0u);
    }
}

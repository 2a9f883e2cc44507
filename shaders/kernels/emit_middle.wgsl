// Writes the nodes of the middle roots' trees, now that their places are known, and where the small roots below begin.
// One workgroup a middle root, each invocation a part of its list of nodes in preorder.
// Reads: middle roots and their trees, sizes of their leaves, addresses of the roots.
// Writes: interior nodes and empty leaves in preorder; the addresses of the leaves.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> middle_roots: array<MiddleRoot>;
@group(0) @binding(3) var<storage, read> middle_nodes: array<TopNode>;
@group(0) @binding(4) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> top_addresses: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> small_addresses: array<vec2<u32>>;

const LANES: u32 = 64u;

// By invocation: what its part of the list adds to addresses, and the invocation whose part follows.
var<workgroup> part_sizes: array<vec2<u32>, LANES>;
var<workgroup> part_next: array<u32, LANES>;
var<workgroup> part_addresses: array<vec2<u32>, LANES>;
// Where each node of the tree stands in the output: as many as the regions of a root have room for.
var<workgroup> node_addresses: array<u32, 2176>;

fn successor(node: TopNode) -> u32 {
    return select(node.right, node.left, node.kind < SMALL_ROOT);
}

fn weight(root: MiddleRoot, node: TopNode) -> vec2<u32> {
    if node.kind == SMALL_ROOT {
        return small_sizes[root.first_leaf + node.left];
    }
    return vec2<u32>(1u, 0u);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(middle_root_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let root = middle_roots[index];
        let first = first_middle_node(root.first, index);
        // Parts begin at nodes whose index is a multiple of this.
        let share = (root.nodes + LANES - 1u) / LANES;
        let begin = lane * share;
        // The list is ranked by parts (Helman and JaJa): each sums its own, one invocation goes over the sums.
        if begin < root.nodes {
            var sum = vec2<u32>(0u);
            var place = begin;
            loop {
                let node = middle_nodes[first + place];
                sum += weight(root, node);
                place = successor(node);
                if place == NO_NODE || place % share == 0u {
                    break;
                }
            }
            part_sizes[lane] = sum;
            part_next[lane] = select(place / share, NO_NODE, place == NO_NODE);
        }
        workgroupBarrier();
        if lane == 0u {
            var address = top_addresses[root.node];
            var part = 0u;
            while part != NO_NODE {
                part_addresses[part] = address;
                address += part_sizes[part];
                part = part_next[part];
            }
        }
        workgroupBarrier();
        if begin < root.nodes {
            var address = part_addresses[lane];
            var place = begin;
            loop {
                let node = middle_nodes[first + place];
                if node.kind == EMPTY {
                    nodes[address.x] = leaf(address.y, 0u);
                } else if node.kind == SMALL_ROOT {
                    small_addresses[root.first_leaf + node.left] = address;
                }
                node_addresses[place] = address.x;
                address += weight(root, node);
                place = successor(node);
                if place == NO_NODE || place % share == 0u {
                    break;
                }
            }
        }
        workgroupBarrier();
        for (var place = lane; place < root.nodes; place += LANES) {
            let node = middle_nodes[first + place];
            if node.kind < SMALL_ROOT {
                nodes[node_addresses[place]] =
                    vec2<u32>(node.split, (node_addresses[node.right] << 2u) | node.kind);
            }
        }
        workgroupBarrier();
    }
}

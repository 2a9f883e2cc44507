// Names the chunks of every active node, and bounds it: segmented reduction over chunks (Zhou et al. 2008,
// Algorithm 2).
// One workgroup an active node.
// Reads: bounds of the parent's chunks on the node's side.
// Writes: the node's chunks and tight bounds.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read> chunk_state: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> chunks: array<Chunk>;
@group(0) @binding(5) var<storage, read_write> node_bounds: array<f32>;

const LANES: u32 = 64u;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(active_node_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let node = active_nodes[index];
        name_chunks(index, node, lane);
        bound_node(node, lane);
        if lane < 6u {
            node_bounds[6u * index + lane] = reduced[lane];
        }
    }
}

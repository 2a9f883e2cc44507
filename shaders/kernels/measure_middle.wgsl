// Sums the sizes of every middle root's leaves.
// One workgroup a middle root, one invocation a leaf.
// Reads: middle roots, sizes of their leaves.
// Writes: nodes and references of each root's subtree.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> middle_roots: array<MiddleRoot>;
@group(0) @binding(3) var<storage, read> small_sizes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> middle_sizes: array<vec2<u32>>;

const LANES: u32 = 64u;

var<workgroup> nodes: atomic<u32>;
var<workgroup> references: atomic<u32>;
// 1 where `build_small` could not finish a subtree.
var<workgroup> unfinished: atomic<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(middle_root_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let root = middle_roots[index];
        if lane == 0u {
            atomicStore(&nodes, root.nodes - root.leaves);
            atomicStore(&references, 0u);
            atomicStore(&unfinished, 0u);
        }
        workgroupBarrier();
        var sum = vec2<u32>(0u);
        for (var leaf = lane; leaf < root.leaves; leaf += LANES) {
            let size = small_sizes[root.first_leaf + leaf];
            if size.y == 0xffffffffu {
                atomicStore(&unfinished, 1u);
            }
            sum += size;
        }
        atomicAdd(&nodes, sum.x);
        atomicAdd(&references, sum.y);
        workgroupBarrier();
        if lane == 0u {
            let size = vec2<u32>(atomicLoad(&nodes), atomicLoad(&references));
            middle_sizes[index] = select(size, vec2<u32>(0xffffffffu), atomicLoad(&unfinished) == 1u);
        }
        workgroupBarrier();
    }
}

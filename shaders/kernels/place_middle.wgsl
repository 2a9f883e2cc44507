// Moves the leaves of the middle roots and their references to the small list.
// One workgroup a middle root, 64 invocations a leaf.
// Reads: middle roots, their leaves and the references of these.
// Writes: the small list and its references.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> middle_roots: array<MiddleRoot>;
@group(0) @binding(3) var<storage, read> middle_references: array<Reference>;
@group(0) @binding(4) var<storage, read> middle_leaves: array<SmallRoot>;
@group(0) @binding(5) var<storage, read_write> small_roots: array<SmallRoot>;
@group(0) @binding(6) var<storage, read_write> small_references: array<Reference>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let end = slice_end(middle_root_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let root = middle_roots[index];
        let first = first_middle_leaf(root.first, index);
        for (var leaf = lane / 64u; leaf < root.leaves; leaf += LANES / 64u) {
            var small = middle_leaves[first + leaf];
            // Its references in the pool.
            let source = small.padding;
            let target_first = root.first_reference + small.first;
            for (var i = lane % 64u; i < small.count; i += 64u) {
                small_references[target_first + i] = middle_references[source + i];
            }
            if lane % 64u == 0u {
                small.first = target_first;
                small.padding = 0u;
                small_roots[root.first_leaf + leaf] = small;
            }
        }
    }
}

// Whether each ray of a batch hits anything, as far as a lean traversal can tell.
// One invocation a ray.
// Reads: nodes and their references (the tree's or compressed ones), corners and scale of the scene; the rays of the batch.
// Writes: a word a ray, except for those that are left to `any_hit_retry`; the indices of these and what is left of
// their walks, in any order.
// Ties: none; the answer does not depend on which hit is found.

@group(0) @binding(5) var<storage, read_write> occluded: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    begin_stack(local);
    let index = ray_index(workgroup, workgroups, local);
    if index >= batch.count {
        return;
    }
    let hit = trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), true);
    occluded[index] = occluded_word(hit);
    if hit.triangle == DEFERRED || hit.triangle == UNSETTLED {
        defer_ray(index, left_aside(hit));
    }
}

// The triangles that each ray of a batch may meet, as far as a lean traversal can tell.
// One invocation a ray.
// Reads: nodes, references, corners and scale of the scene; the rays of the batch.
// Writes: a list a ray; the indices of the rays that are left to `list_triangles_retry`, in any order.
// Ties: none; a list is in the order of leaves, a triangle as often as it has references there or less.

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
    begin_list(index);
    let hit = trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), false);
    end_list(hit);
    if hit.triangle == DEFERRED {
        defer_ray(index, vec3<u32>());
    }
}

// How many surfaces each ray of a batch crosses, as far as a lean traversal can tell for certain.
// One invocation a ray.
// Reads: nodes, references, corners and scale of the scene; the rays of the batch.
// Writes: a count a ray, and the triangles that were counted; the indices of the rays that are left to
// `count_crossings_retry`, in any order.
// Ties: none; a triangle counts once, in however many leaves it lies.

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
    begin_count(index);
    let hit = trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), false);
    end_count(index, hit);
    if hit.triangle == DEFERRED {
        defer_ray(index, vec3<u32>());
    }
}

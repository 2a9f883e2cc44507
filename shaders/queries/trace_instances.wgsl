// The closest hit, or any, of every ray with the instance that it has entered, as far as a lean traversal can tell.
// One invocation a ray; those that have entered none do nothing.
// Reads: the instances; nodes, references and corners of their geometries; the rays of the batch, what they have entered, and
// their best hits so far.
// Writes: the hits that come before those; UNFINISHED as the triangle of a ray which the driver did not let finish. The indices of
// rays that are left to `trace_instances_retry`, in any order.
// Ties: among equal `t` the lower instance, then the lower triangle index.

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    begin_stack(local);
    let index = ray_index(workgroup, workgroups, local);
    if index >= scene_batch.count {
        return;
    }
    let instance = ways[index];
    if instance == NO_INSTANCE {
        return;
    }
    if !trace_entered(index, instance) {
        defer_ray(index, vec3<u32>());
    }
}

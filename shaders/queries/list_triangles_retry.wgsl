// The triangles that each ray which `list_triangles` deferred may meet.
// One invocation a ray, or fewer that take several, as many apart as there are; those beyond the list do nothing.
// Reads: nodes, references, corners and scale of the scene; the rays of the batch; the deferred ones.
// Writes: the lists of the deferred rays, as `list_triangles` does; none is deferred again.
// Ties: none; a list is in the order of leaves, a triangle as often as it has references there or less.

fn take_entry(place: u32) {
    let index = deferred_ray(place);
    begin_list(index);
    end_list(trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), false));
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let first = ray_index(workgroup, workgroups, local);
    take_entries(first, deferred_count(), workgroups.x * workgroups.y * 64u);
}

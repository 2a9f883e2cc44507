// The closest hit, or any, of every ray that `trace_instances` deferred, with the instance that it has entered.
// One invocation a ray, or fewer that take several, as many apart as there are; those beyond the list do nothing.
// Reads: the instances; nodes, references and corners of their geometries; the rays of the batch, what they have entered, and
// their best hits so far; the deferred rays.
// Writes: hits, as `trace_instances` does; no ray is deferred again.
// Ties: among equal `t` the lower instance, then the lower triangle index.

fn take_entry(place: u32) {
    let index = deferred_ray(place);
    let traced = trace_entered(index, ways[index]);
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

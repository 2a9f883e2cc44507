// Whether each ray that `any_hit` deferred hits anything.
// One invocation a ray, or fewer that take several, as many apart as there are; those beyond the list do nothing.
// Reads: nodes, references, corners and scale of the scene; the rays of the batch; the deferred ones.
// Writes: the words of the deferred rays.
// Ties: none; the answer does not depend on which hit is found.

@group(0) @binding(5) var<storage, read_write> occluded: array<u32>;

fn take_entry(place: u32) {
    let index = deferred_ray(place);
    to_take_up = left_of_walk(place);
    let hit = trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), true);
    occluded[index] = occluded_word(hit);
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

// Whether each ray of a batch hits anything.
// One invocation a ray.
// Reads: nodes, references, corners and scale of the scene; the rays of the batch.
// Writes: a word a ray.
// Ties: none; the answer does not depend on which hit is found.

// 1 for a hit, 0 for none, 2 for a ray that the driver did not let finish, 3 for one that is undecided.
@group(0) @binding(5) var<storage, read_write> occluded: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let index = ray_index(workgroup, workgroups, local);
    if index >= batch.count {
        return;
    }
    let hit = trace_ray(batch_ray(index), QueryOptions(batch.culling, batch.ignore), true);
    let marked = select(select(0u, 2u, hit.triangle == UNFINISHED), 3u, hit.triangle == UNDECIDED_HIT);
    occluded[index] = select(marked, 1u, is_hit(hit));
}

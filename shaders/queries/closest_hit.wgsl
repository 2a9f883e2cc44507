// The closest hit of every ray of a batch, as far as a lean traversal can tell.
// One invocation a ray.
// Reads: nodes and their references (the tree's or compressed ones), corners and scale of the scene; the rays of the batch.
// Writes: a hit a ray. The record of a miss is (infinity, NO_TRIANGLE, 0, 0); that of a ray which the
// driver did not let finish has UNFINISHED as its triangle, that of an undecided one UNDECIDED_HIT, that of one
// which is left to `closest_hit_retry` DEFERRED or UNSETTLED. The indices of these and what is left of their walks, in any order.
// Ties: among equal `t` the lower triangle index.

// 16 bytes a hit: t, triangle, u, v. As bits, since the `t` of a miss is infinite.
@group(0) @binding(5) var<storage, read_write> hits: array<vec4<u32>>;

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
    let hit = closest_hit(batch_ray(index), QueryOptions(batch.culling, batch.ignore));
    hits[index] = hit_words(hit);
    if hit.triangle == DEFERRED || hit.triangle == UNSETTLED {
        defer_ray(index, left_aside(hit));
    }
}

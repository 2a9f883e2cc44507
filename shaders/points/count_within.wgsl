// How many points are within the radius of each query of a batch.
// One invocation a query.
// Reads: the tree and its points; which of them count; the queries.
// Writes: a number for each, or a mark.
// Ties: none; a point at just the radius counts.

@group(0) @binding(5) var<storage, read_write> counts: array<u32>;

var<private> own_count: u32;

fn visit(place: u32, bits: u32) {
    own_count += 1u;
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = point_batch.zero;
    own_lane = local;
    let index = query_index(workgroup, workgroups, local);
    if index >= point_batch.count {
        return;
    }
    own_count = 0u;
    stop = vec2<u32>(point_batch.reach, 0xffffffffu);
    let done = walk_points(queries[index]);
    counts[index] = select(POINT_BATCH_ENDED_EARLY, own_count, done);
}

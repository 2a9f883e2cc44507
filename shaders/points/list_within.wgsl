// The points within the radius of each query of a batch.
// One invocation a query.
// Reads: the tree, its points and their indices; which of them count; the queries; where the list of each begins.
// Writes: the keys of each list, in no order; how many there are, or a mark.
// Ties: none; a point at just the radius counts.

@group(0) @binding(5) var<storage, read> indices: array<u32>;
@group(0) @binding(6) var<storage, read_write> found: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> counts: array<u32>;
@group(0) @binding(8) var<storage, read> starts: array<u32>;

var<private> own_start: u32;
// Where the next list begins.
var<private> own_end: u32;
var<private> own_count: u32;

fn visit(place: u32, bits: u32) {
    if own_count < own_end - own_start {
        found[own_start + own_count] = vec2<u32>(bits, indices[place]);
    }
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
    own_start = starts[index];
    own_end = starts[index + 1u];
    own_count = 0u;
    stop = vec2<u32>(point_batch.reach, 0xffffffffu);
    let done = walk_points(queries[index]);
    counts[index] = select(POINT_BATCH_ENDED_EARLY, own_count, done);
}

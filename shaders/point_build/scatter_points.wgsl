// Moves the points of each large node to its children; in each they stand in the order that they had.
// One workgroup a chunk.
// Reads: records; the planes; how many points of the node before each chunk are below the plane and on it.
// Writes: records of the next level.
// Ties: of points on the plane, the first go to the left child, as many as it takes.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> records: array<PointRecord>;
@group(0) @binding(3) var<storage, read> splits: array<PointSplit>;
@group(0) @binding(4) var<storage, read> sides_before: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> next_records: array<PointRecord>;

const SHARE: u32 = POINT_CHUNK / LANES;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let height = height_of_level();
    for (var chunk = workgroup.x; chunk < active_chunk_count(); chunk += workgroups.x) {
        let node = chunk >> (height - SMALL_HEIGHT);
        let split = splits[node];
        let start = (node << height) * POINT_BLOCK;
        let middle = start + (POINT_BLOCK << (height - 1u));
        let first = chunk * POINT_CHUNK + lane * SHARE;
        let end = min(kept_count(), first + SHARE);
        var own = vec2<u32>(0u);
        for (var place = first; place < end; place++) {
            let bits = bits_along(records[place], split.axis);
            own += vec2<u32>(select(0u, 1u, bits < split.bits), select(0u, 1u, bits == split.bits));
        }
        var before = sides_before[chunk] + inclusive_scan(lane, own) - own;
        for (var place = first; place < end; place++) {
            let record = records[place];
            let bits = bits_along(record, split.axis);
            let is_below = bits < split.bits;
            let is_on_plane = bits == split.bits;
            let lefts = before.x + min(before.y, split.rank);
            let is_left = is_below || (is_on_plane && before.y < split.rank);
            let moved = select(middle + (place - start) - lefts, start + lefts, is_left);
            next_records[select(moved, place, split.axis == UNDIVIDED)] = record;
            before += vec2<u32>(select(0u, 1u, is_below), select(0u, 1u, is_on_plane));
        }
    }
}

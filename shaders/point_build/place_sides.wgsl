// Sums up, over the chunks of each large node, the points below its plane and on it; and writes the node.
// One workgroup a large node, each invocation a run of chunks.
// Reads: both numbers of each chunk; the planes.
// Writes: how many of either come before each chunk, in its node; the node of the tree.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> splits: array<PointSplit>;
@group(0) @binding(3) var<storage, read> chunk_sides: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> sides_before: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> nodes: array<vec2<u32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let height = height_of_level();
    for (var node = workgroup.x; node < large_count(); node += workgroups.x) {
        let first = node << (height - SMALL_HEIGHT);
        let end = min(chunk_count(), first + (1u << (height - SMALL_HEIGHT)));
        let run = (end - first + LANES - 1u) / LANES;
        let own_start = min(end, first + lane * run);
        let own_end = min(end, own_start + run);
        var own = vec2<u32>(0u);
        for (var chunk = own_start; chunk < own_end; chunk++) {
            own += chunk_sides[chunk];
        }
        var before = inclusive_scan(lane, own) - own;
        for (var chunk = own_start; chunk < own_end; chunk++) {
            sides_before[chunk] = before;
            before += chunk_sides[chunk];
        }
        let split = splits[node];
        if lane == 0u && split.axis != UNDIVIDED {
            let plane = bitcast<u32>(from_ordered(split.bits));
            nodes[middle_of(node, height) - 1u] = vec2<u32>(plane, split.axis);
        }
    }
}

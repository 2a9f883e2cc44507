// Finds the next eight bits of the plane of each large node.
// One workgroup a large node, each invocation one of the 256 digits.
// Reads: how many points of each chunk have each digit.
// Writes: what is known of the plane.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> chunk_digits: array<u32>;
@group(0) @binding(3) var<storage, read_write> splits: array<PointSplit>;

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
        var own = 0u;
        for (var chunk = first; chunk < end; chunk++) {
            own += chunk_digits[chunk * LANES + lane];
        }
        let split = splits[node];
        let before = inclusive_scan(lane, vec2<u32>(own, 0u)).x - own;
        workgroupBarrier();
        if split.axis != UNDIVIDED && before <= split.rank && split.rank < before + own {
            let bits = split.bits | (lane << (24u - split.known));
            splits[node] = PointSplit(split.axis, bits, split.rank - before, split.known + 8u);
        }
    }
}

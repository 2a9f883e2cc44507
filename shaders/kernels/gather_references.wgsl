// Writes the references of the root.
// One workgroup a chunk of 256 triangles of the input, one invocation a triangle.
// Reads: snapped corners, scanned counts.
// Writes: a reference for each triangle kept, in order.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> chunk_state: array<u32>;
@group(0) @binding(4) var<storage, read_write> references: array<Reference>;

fn corner(triangle: u32, index: u32) -> vec3<u32> {
    let at = 9u * triangle + 3u * index;
    return vec3<u32>(triangles[at], triangles[at + 1u], triangles[at + 2u]);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let count = live(COUNTER_TRIANGLES);
    let end = slice_end(live(COUNTER_INPUT_CHUNKS));
    for (var chunk = parameters.first + group.x; chunk < end; chunk += groups.x) {
        let triangle = chunk * CHUNK + lane;
        var a = vec3<u32>(0u);
        var b = vec3<u32>(0u);
        var c = vec3<u32>(0u);
        if triangle < count {
            a = corner(triangle, 0u);
            b = corner(triangle, 1u);
            c = corner(triangle, 2u);
        }
        // Lanes beyond the input hold three equal corners, which are not kept.
        let kept = is_kept(a, b, c);
        ballot(lane, kept, false);
        if kept {
            var bounds = enclose(empty_aabb(), bitcast<vec3<f32>>(a));
            bounds = enclose(bounds, bitcast<vec3<f32>>(b));
            bounds = enclose(bounds, bitcast<vec3<f32>>(c));
            let place = load_counts(chunk).x + ballot_rank(0u, lane);
            references[place] = Reference(bounds.lo, triangle, bounds.hi, 0u);
        }
    }
}

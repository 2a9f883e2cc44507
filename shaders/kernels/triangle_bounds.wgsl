// Snaps triangles, decides which are kept, bounds each 256 of them.
// One workgroup a chunk of 256 triangles of the input, one invocation a triangle.
// Reads: the mesh. Words, not floats: it may hold infinities and NaN.
// Writes: snapped corners of every triangle; for each chunk the number of triangles kept (left) and
// snapped (right), and the bounds of those kept (left).

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> input: array<u32>;
@group(0) @binding(3) var<storage, read_write> triangles: array<u32>;
@group(0) @binding(4) var<storage, read_write> chunk_state: array<u32>;

const LANES: u32 = 256u;

// Snapping, on bits: -0 and everything below 2^-126 become +0.
fn snap_bits(bits: vec3<u32>) -> vec3<u32> {
    let magnitude = bits & vec3<u32>(0x7fffffffu);
    return select(bits, vec3<u32>(0u), magnitude < vec3<u32>(0x800000u));
}

fn position(triangle: u32, corner: u32) -> vec3<u32> {
    var vertex = 3u * triangle + corner;
    if parameters.first_index != 0xffffffffu {
        vertex = input[parameters.first_index + vertex];
        if vertex >= parameters.first_index / 3u {
            // No such vertex: the bits of a NaN, for which the triangle is dropped.
            return vec3<u32>(0x7fc00000u);
        }
    }
    return vec3<u32>(input[3u * vertex], input[3u * vertex + 1u], input[3u * vertex + 2u]);
}

fn store_corner(triangle: u32, corner: u32, bits: vec3<u32>) {
    let at = 9u * triangle + 3u * corner;
    triangles[at] = bits.x;
    triangles[at + 1u] = bits.y;
    triangles[at + 2u] = bits.z;
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
        var bounds = empty_aabb();
        var kept = false;
        var snapped = false;
        if triangle < count {
            let given_a = position(triangle, 0u);
            let given_b = position(triangle, 1u);
            let given_c = position(triangle, 2u);
            let a = snap_bits(given_a);
            let b = snap_bits(given_b);
            let c = snap_bits(given_c);
            store_corner(triangle, 0u, a);
            store_corner(triangle, 1u, b);
            store_corner(triangle, 2u, c);
            kept = is_kept(a, b, c);
            let greatest = max(max(a & vec3<u32>(0x7fffffffu), b & vec3<u32>(0x7fffffffu)), c & vec3<u32>(0x7fffffffu));
            let finite = all(greatest < vec3<u32>(0x7f800000u));
            snapped = finite && (any(a != given_a) || any(b != given_b) || any(c != given_c));
            if kept {
                bounds = enclose(bounds, bitcast<vec3<f32>>(a));
                bounds = enclose(bounds, bitcast<vec3<f32>>(b));
                bounds = enclose(bounds, bitcast<vec3<f32>>(c));
            }
        }
        ballot(lane, kept, snapped);
        reduce_bounds(lane, bounds);
        store_reduced_bounds(chunk, lane);
        if lane >= 6u && lane < 12u {
            // Nothing goes right.
            let empty = select(-GREATEST, GREATEST, lane < 9u);
            chunk_state[bounds_of(chunk, 0u) + lane] = bitcast<u32>(empty);
        }
        if lane == 0u {
            store_counts(chunk, vec2<u32>(ballot_count(0u), ballot_count(1u)));
        }
    }
}

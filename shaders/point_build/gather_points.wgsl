// Gathers the points that are kept, in the order of their indices.
// One workgroup a chunk of the points given.
// Reads: their coordinates; where those of each chunk begin.
// Writes: their records, in the tree's unit.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> input: array<u32>;
@group(0) @binding(3) var<storage, read> chunk_places: array<u32>;
@group(0) @binding(4) var<storage, read_write> records: array<PointRecord>;

const SHARE: u32 = POINT_CHUNK / LANES;

fn is_kept(point: u32) -> bool {
    var all = point < point_build.given;
    for (var axis = 0u; axis < point_build.dimensions && all; axis++) {
        all = is_finite(input[point * point_build.dimensions + axis]);
    }
    return all;
}

// A coordinate in the tree's unit.
fn in_units(point: u32, axis: u32) -> u32 {
    if axis >= point_build.dimensions {
        return 0x80000000u;
    }
    let x = bitcast<f32>(input[point * point_build.dimensions + axis]);
    return ordered_bits(scale(snap(x), -unit_exponent()));
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = point_build.zero;
    for (var chunk = workgroup.x; chunk < counters[0]; chunk += workgroups.x) {
        let first = chunk * POINT_CHUNK + lane * SHARE;
        var own = 0u;
        for (var i = 0u; i < SHARE; i++) {
            own += select(0u, 1u, is_kept(first + i));
        }
        var place = chunk_places[chunk] + inclusive_scan(lane, vec2<u32>(own, 0u)).x - own;
        for (var i = 0u; i < SHARE; i++) {
            let point = first + i;
            if is_kept(point) {
                records[place] = PointRecord(
                    in_units(point, 0u),
                    in_units(point, 1u),
                    in_units(point, 2u),
                    in_units(point, 3u),
                    point,
                );
                place += 1u;
            }
        }
    }
}

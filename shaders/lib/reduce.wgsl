// Bounds of what the lanes of a workgroup hold. The kernel says how many lanes there are: LANES, a
// multiple of 16.

var<workgroup> reduced: array<f32, 6>;
var<workgroup> reduce_lanes: array<f32, 6u * LANES>;
var<workgroup> reduce_parts: array<f32, 96>;

// The lesser for a lower corner's coordinate (0 to 2), the greater for an upper one's (3 to 5).
fn merge(coordinate: u32, a: f32, b: f32) -> f32 {
    return select(most(a, b), least(a, b), coordinate < 3u);
}

// Leaves the union in `reduced`, for all lanes to read. Every lane must call it.
fn reduce_bounds(lane: u32, bounds: Aabb) {
    workgroupBarrier();
    reduce_lanes[lane] = bounds.lo.x;
    reduce_lanes[LANES + lane] = bounds.lo.y;
    reduce_lanes[2u * LANES + lane] = bounds.lo.z;
    reduce_lanes[3u * LANES + lane] = bounds.hi.x;
    reduce_lanes[4u * LANES + lane] = bounds.hi.y;
    reduce_lanes[5u * LANES + lane] = bounds.hi.z;
    workgroupBarrier();
    const SHARE: u32 = LANES / 16u;
    for (var part = lane; part < 96u; part += LANES) {
        let coordinate = part / 16u;
        let start = coordinate * LANES + (part % 16u) * SHARE;
        var value = reduce_lanes[start];
        for (var i = 1u; i < SHARE; i++) {
            value = merge(coordinate, value, reduce_lanes[start + i]);
        }
        reduce_parts[part] = value;
    }
    workgroupBarrier();
    if lane < 6u {
        var value = reduce_parts[16u * lane];
        for (var i = 1u; i < 16u; i++) {
            value = merge(lane, value, reduce_parts[16u * lane + i]);
        }
        reduced[lane] = value;
    }
    workgroupBarrier();
}

fn reduced_bounds() -> Aabb {
    return Aabb(
        vec3<f32>(reduced[0], reduced[1], reduced[2]),
        vec3<f32>(reduced[3], reduced[4], reduced[5]),
    );
}

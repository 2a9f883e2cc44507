// Bounds of what the lanes of a workgroup hold. The kernel says how many lanes there are: LANES, a
// multiple of 16; and how many boxes each lane holds: BOXES, so that several share their barriers.

// Six coordinates a box.
var<workgroup> reduced: array<f32, 6u * BOXES>;
var<workgroup> reduce_lanes: array<f32, 6u * BOXES * LANES>;
var<workgroup> reduce_parts: array<f32, 96u * BOXES>;

// The lesser for a lower corner's coordinate (0 to 2), the greater for an upper one's (3 to 5).
fn merge(coordinate: u32, a: f32, b: f32) -> f32 {
    return select(most(a, b), least(a, b), coordinate % 6u < 3u);
}

// What a lane holds in one of its boxes. A barrier must stand between the last reduction and this.
fn put_bounds(lane: u32, box: u32, bounds: Aabb) {
    let at = 6u * LANES * box + lane;
    reduce_lanes[at] = bounds.lo.x;
    reduce_lanes[at + LANES] = bounds.lo.y;
    reduce_lanes[at + 2u * LANES] = bounds.lo.z;
    reduce_lanes[at + 3u * LANES] = bounds.hi.x;
    reduce_lanes[at + 4u * LANES] = bounds.hi.y;
    reduce_lanes[at + 5u * LANES] = bounds.hi.z;
}

// Leaves the unions of what was put in `reduced`, for all lanes to read. Every lane must call it.
fn reduce_boxes(lane: u32) {
    workgroupBarrier();
    const SHARE: u32 = LANES / 16u;
    for (var part = lane; part < 96u * BOXES; part += LANES) {
        let coordinate = part / 16u;
        let start = coordinate * LANES + (part % 16u) * SHARE;
        var value = reduce_lanes[start];
        for (var i = 1u; i < SHARE; i++) {
            value = merge(coordinate, value, reduce_lanes[start + i]);
        }
        reduce_parts[part] = value;
    }
    workgroupBarrier();
    if lane < 6u * BOXES {
        var value = reduce_parts[16u * lane];
        for (var i = 1u; i < 16u; i++) {
            value = merge(lane, value, reduce_parts[16u * lane + i]);
        }
        reduced[lane] = value;
    }
    workgroupBarrier();
}

// Leaves the union of all lanes' first boxes in `reduced`. Every lane must call it.
fn reduce_bounds(lane: u32, bounds: Aabb) {
    workgroupBarrier();
    put_bounds(lane, 0u, bounds);
    reduce_boxes(lane);
}

fn reduced_bounds() -> Aabb {
    return Aabb(
        vec3<f32>(reduced[0], reduced[1], reduced[2]),
        vec3<f32>(reduced[3], reduced[4], reduced[5]),
    );
}

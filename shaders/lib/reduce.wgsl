// Bounds of what the lanes of a workgroup hold: minima of those 32 apart, then of 4 and of 8. The kernel says how many lanes there
// are: LANES, a multiple of 32.

// Six coordinates.
var<workgroup> reduced: array<f32, 6>;
// By axis and lane: the lower coordinate, and the upper one negated, so that the least of both is sought. Corners are snapped:
// there is no -0 but where a zero was negated.
var<workgroup> reduce_lanes: array<vec2<f32>, 3u * LANES>;
var<workgroup> reduce_parts: array<vec2<f32>, 96>;
var<workgroup> reduce_few: array<vec2<f32>, 24>;

// Leaves the union of what all lanes hold in `reduced`. Every lane must call it.
fn reduce_bounds(lane: u32, bounds: Aabb) {
    workgroupBarrier();
    reduce_lanes[lane] = vec2<f32>(bounds.lo.x, -bounds.hi.x);
    reduce_lanes[LANES + lane] = vec2<f32>(bounds.lo.y, -bounds.hi.y);
    reduce_lanes[2u * LANES + lane] = vec2<f32>(bounds.lo.z, -bounds.hi.z);
    workgroupBarrier();
    for (var part = lane; part < 96u; part += LANES) {
        let first = LANES * (part / 32u) + part % 32u;
        var least = reduce_lanes[first];
        for (var i = 32u; i < LANES; i += 32u) {
            least = min(least, reduce_lanes[first + i]);
        }
        reduce_parts[part] = least;
    }
    workgroupBarrier();
    if lane < 24u {
        let first = 32u * (lane / 8u) + lane % 8u;
        let a = min(reduce_parts[first], reduce_parts[first + 8u]);
        let b = min(reduce_parts[first + 16u], reduce_parts[first + 24u]);
        reduce_few[lane] = min(a, b);
    }
    workgroupBarrier();
    if lane < 3u {
        var least = reduce_few[8u * lane];
        for (var i = 1u; i < 8u; i++) {
            least = min(least, reduce_few[8u * lane + i]);
        }
        reduced[lane] = least.x;
        reduced[3u + lane] = -least.y;
    }
    workgroupBarrier();
}

fn reduced_bounds() -> Aabb {
    return Aabb(
        vec3<f32>(reduced[0], reduced[1], reduced[2]),
        vec3<f32>(reduced[3], reduced[4], reduced[5]),
    );
}

// The range of the triangles' coordinates and sizes; twin of `Limits` in core/src/query/intersect.
// One invocation a triangle.
// Reads: snapped corners and how many triangles there are.
// Writes: four numbers. Least and greatest of numbers that are not negative are least and greatest of
// their bits: exact, and no order plays a part. Dropped triangles (a coordinate that is not finite,
// two equal corners) have no say.

struct TriangleCount {
    count: u32,
    zero: u32,
}

// Snapped corners, nine numbers a triangle. As bits, since those of dropped triangles may be NaN.
@group(0) @binding(0) var<storage, read> triangles: array<u32>;
@group(0) @binding(1) var<uniform> triangle_count: TriangleCount;
// Greatest and least magnitude, longest and shortest extent.
@group(0) @binding(2) var<storage, read_write> limits: array<atomic<u32>, 4>;

var<workgroup> group_limits: array<atomic<u32>, 4>;

fn corner_words(first: u32) -> vec3<u32> {
    return vec3<u32>(triangles[first], triangles[first + 1u], triangles[first + 2u]);
}

// Adds the magnitudes of one corner.
fn magnitude_limits(corner: vec3<u32>) {
    for (var axis = 0u; axis < 3u; axis++) {
        let bits = select(select(corner.x, corner.y, axis == 1u), corner.z, axis == 2u) & 0x7fffffffu;
        atomicMax(&group_limits[0], bits);
        if bits != 0u {
            atomicMin(&group_limits[1], bits);
        }
    }
}

// Half the extent of three numbers.
fn half_spread(a: f32, b: f32, c: f32) -> f32 {
    let hi = most(most(a, b), c);
    let lo = least(least(a, b), c);
    return snapped_difference(snapped_product(hi, 0.5), snapped_product(lo, 0.5));
}

fn triangle_limits(index: u32) {
    let first = 9u * index;
    let a = corner_words(first);
    let b = corner_words(first + 3u);
    let c = corner_words(first + 6u);
    let mask = vec3<u32>(0x7f800000u);
    let finite =
        all((a & mask) != mask) && all((b & mask) != mask) && all((c & mask) != mask);
    if !finite || all(a == b) || all(b == c) || all(c == a) {
        return;
    }
    magnitude_limits(a);
    magnitude_limits(b);
    magnitude_limits(c);
    let p = bitcast<vec3<f32>>(a);
    let q = bitcast<vec3<f32>>(b);
    let r = bitcast<vec3<f32>>(c);
    // Halved, so that it cannot overflow, and doubled unless that would.
    var half = most(0.0, half_spread(p.x, q.x, r.x));
    half = most(half, half_spread(p.y, q.y, r.y));
    half = most(half, half_spread(p.z, q.z, r.z));
    let longest = bitcast<u32>(product(least(half, 0x1.fffffep+126f), 2.0));
    atomicMax(&group_limits[2], longest);
    atomicMin(&group_limits[3], longest);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = triangle_count.zero;
    if local == 0u {
        atomicStore(&group_limits[0], 0u);
        atomicStore(&group_limits[1], 0x7f7fffffu);
        atomicStore(&group_limits[2], 0u);
        atomicStore(&group_limits[3], 0x7f7fffffu);
    }
    workgroupBarrier();
    let index = (workgroup.y * workgroups.x + workgroup.x) * 256u + local;
    if index < triangle_count.count {
        triangle_limits(index);
    }
    workgroupBarrier();
    if local == 0u {
        atomicMax(&limits[0], atomicLoad(&group_limits[0]));
        atomicMin(&limits[1], atomicLoad(&group_limits[1]));
        atomicMax(&limits[2], atomicLoad(&group_limits[2]));
        atomicMin(&limits[3], atomicLoad(&group_limits[3]));
    }
}

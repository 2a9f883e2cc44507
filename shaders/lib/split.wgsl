// Twin of core/src/build/split.rs: where a node may be cut. `sampled_sweep` is in the kernel that uses it.

struct SplitPlane {
    axis: u32,
    position: f32,
    // False when there is no such plane.
    found: bool,
}

fn no_plane() -> SplitPlane {
    return SplitPlane(TRANSFER, 0.0, false);
}

fn strictly_inside(cell: Aabb, axis: u32, position: f32) -> bool {
    return on_axis(cell.lo, axis) < position && position < on_axis(cell.hi, axis);
}

// Something below the plane, or planar in it.
fn goes_left(lo: f32, hi: f32, position: f32) -> bool {
    return lo < position || hi <= position;
}

// Something above the plane.
fn goes_right(hi: f32, position: f32) -> bool {
    return hi > position;
}

// A cell without its empty space, and the sides that are cut as bits: lower before upper, axis by axis.
struct Rest {
    cell: Aabb,
    sides: u32,
}

// Cuts off empty space on each side where it exceeds C_e of the extent that the cuts before have left. All axes at a time.
fn without_empty_space(cell: Aabb, tight: Aabb) -> Rest {
    // C_e is at most 255 / 256: the quotient is exact.
    let part = product(f32(parameters.empty_cutoff), 0x1p-8f);
    let least = vec3<f32>(power_of_two(LEAST_EXPONENT));
    let half_lo = halves(cell.lo);
    let half_hi = halves(cell.hi);
    let half_low = halves(tight.lo);
    let extent = snapped_differences(half_hi, half_lo);
    let low = (cell.lo < tight.lo) & (tight.lo < cell.hi) & (extent >= least)
        & (snapped_differences(half_low, half_lo) > parts_of(extent, part));
    let lo = select(cell.lo, tight.lo, low);
    let half_high = halves(tight.hi);
    let rest = snapped_differences(half_hi, select(half_lo, half_low, low));
    let high = (lo < tight.hi) & (tight.hi < cell.hi) & (rest >= least)
        & (snapped_differences(half_hi, half_high) > parts_of(rest, part));
    let none = vec3<u32>(0u);
    let sides = select(none, vec3<u32>(1u, 4u, 16u), low) | select(none, vec3<u32>(2u, 8u, 32u), high);
    return Rest(Aabb(lo, select(cell.hi, tight.hi, high)), sides.x | sides.y | sides.z);
}

fn parts_of(extent: vec3<f32>, part: f32) -> vec3<f32> {
    return vec3<f32>(product(extent.x, part), product(extent.y, part), product(extent.z, part));
}

// Those of the sides that are cut where a node has this many levels left, a level each.
fn first_sides(sides: u32, levels: u32) -> u32 {
    var rest = sides;
    for (var over = countOneBits(sides); over > levels; over--) {
        rest &= ~(1u << firstLeadingBit(rest));
    }
    return rest;
}

fn median_on(cell: Aabb, axis: u32) -> SplitPlane {
    let lo = on_axis(cell.lo, axis);
    let hi = on_axis(cell.hi, axis);
    let position = snapped_sum(snapped_product(lo, 0.5), snapped_product(hi, 0.5));
    return SplitPlane(axis, position, lo < position && position < hi);
}

// The spatial median of the longest axis; of the next longest when no float lies between its ends.
fn spatial_median(cell: Aabb) -> SplitPlane {
    let half = half_extents(cell);
    // By descending extent, the lower axis first on ties.
    var first = 0u;
    var second = 1u;
    var third = 2u;
    if half.y > half.x {
        first = 1u;
        second = 0u;
    }
    if half.z > on_axis(half, second) {
        third = second;
        second = 2u;
        if half.z > on_axis(half, first) {
            second = first;
            first = 2u;
        }
    }
    if exponent(on_axis(half, first)) < LEAST_EXPONENT {
        return no_plane();
    }
    var plane = median_on(cell, first);
    if !plane.found {
        plane = median_on(cell, second);
    }
    if !plane.found {
        plane = median_on(cell, third);
    }
    return plane;
}

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

// The plane that cuts empty space off one side of a cell, where it exceeds C_e of the extent.
fn empty_cutoff(cell: Aabb, tight: Aabb, side: u32) -> SplitPlane {
    let axis = side / 2u;
    let low = side % 2u == 0u;
    let lo = on_axis(cell.lo, axis);
    let hi = on_axis(cell.hi, axis);
    let position = select(on_axis(tight.hi, axis), on_axis(tight.lo, axis), low);
    if !(lo < position && position < hi) {
        return no_plane();
    }
    let extent = half_distance(lo, hi);
    if exponent(extent) < LEAST_EXPONENT {
        return no_plane();
    }
    var gap: f32;
    if low {
        gap = half_distance(lo, position);
    } else {
        gap = half_distance(position, hi);
    }
    // C_e is at most 255 / 256: the quotient is exact.
    let limit = product(extent, product(f32(parameters.empty_cutoff), 0x1p-8f));
    return SplitPlane(axis, position, gap > limit);
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

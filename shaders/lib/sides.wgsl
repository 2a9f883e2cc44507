// What a plane makes of a reference. Twin of `goes` and `cut` in core/src/build/reference/kernels.
// Needs the binding `triangles`.

// Whether a reference goes to the left side of a plane, and whether to the right one.
fn sides_of(reference: Reference, axis: u32, position: f32) -> vec2<bool> {
    let lo = on_axis(reference.lo, axis);
    let hi = on_axis(reference.hi, axis);
    var sides = vec2<bool>(goes_left(lo, hi, position), goes_right(hi, position));
    if all(sides) && parameters.clip == 1u {
        // The bounds straddle the plane, but what is left of the triangle may not.
        let corners = corners_of(reference.triangle);
        let bounds = Aabb(reference.lo, reference.hi);
        if !corners_on_both_sides(corners, bounds, axis, position) {
            let parts = clip(corners, bounds, axis, position);
            sides = vec2<bool>(!is_empty(parts.left), !is_empty(parts.right));
        }
    }
    return sides;
}

// The parts of a reference on both sides of a plane. One that goes to one side only may still have bounds that cross the
// plane: its part on the other side came out empty.
fn parts_of(reference: Reference, axis: u32, position: f32) -> Parts {
    let bounds = Aabb(reference.lo, reference.hi);
    var parts = Parts(bounds, bounds);
    if strictly_inside(bounds, axis, position) {
        if parameters.clip == 1u {
            parts = clip(corners_of(reference.triangle), bounds, axis, position);
        } else {
            parts.left.hi = with_axis(bounds.hi, axis, position);
            parts.right.lo = with_axis(bounds.lo, axis, position);
        }
    }
    return parts;
}

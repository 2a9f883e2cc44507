// Twin of `start` in render/src/plane.rs. Needs the binding `frame`.

// The start of a ray that leaves the surface: on the side that the path came from (1) or behind
// (-1), off the triangle by more than all rounding, so that it does not meet it again.
fn start_of(surface: Surface, side: f32) -> vec3<f32> {
    return sum3(surface.point, scaled3(surface.geometric_normal, product(surface.offset, side)));
}

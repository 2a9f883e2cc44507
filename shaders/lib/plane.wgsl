// Twin of `Plane` in render/src/plane.rs.

// In units of 2^-24 of the greatest coordinate of a triangle's corners: how far off its plane a ray
// starts that leaves it.
const OFFSET_UNITS: f32 = 64.0;
// Half a unit in the last place of 1.
const UNIT: f32 = 0x1p-24f;

// A triangle's edges, its normal from edges brought near 1 by a power of two, and that power.
struct Plane {
    first_edge: vec3<f32>,
    power: i32,
    second_edge: vec3<f32>,
    // How far off the plane a new ray must start.
    offset: f32,
    scaled_normal: vec3<f32>,
}

fn plane_of(corners: Triangle) -> Plane {
    let first_edge = difference3(corners.b, corners.a);
    let second_edge = difference3(corners.c, corners.a);
    let power = -exponent(most(reach(first_edge), reach(second_edge)));
    let factor = power_of_two(power);
    let scaled_normal = cross3(scaled3(first_edge, factor), scaled3(second_edge, factor));
    let farthest = greatest(vec3<f32>(reach(corners.a), reach(corners.b), reach(corners.c)));
    let offset = product(farthest, product(OFFSET_UNITS, UNIT));
    return Plane(first_edge, power, second_edge, offset, scaled_normal);
}

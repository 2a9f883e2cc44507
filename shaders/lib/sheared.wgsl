// Triangles as rays see them: twin of the images in core/src/query/intersect/watertight.rs.

// Edge functions below this are looked at again: their products may be subnormal.
const EDGE_LEAST: f32 = 0x1p-98f;

// A triangle as seen from the origin: corners less origin in sheared axis order, and their images.
struct Sheared {
    away_a: vec3<f32>,
    away_b: vec3<f32>,
    away_c: vec3<f32>,
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

// A vector in the order of the sheared axes.
fn along(axes: vec3<u32>, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(on_axis(v, axes.x), on_axis(v, axes.y), on_axis(v, axes.z));
}

// A corner less the origin, in the order of the sheared axes.
fn corner_away(axes: vec3<u32>, corner: vec3<f32>, origin: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        difference(on_axis(corner, axes.x), on_axis(origin, axes.x)),
        difference(on_axis(corner, axes.y), on_axis(origin, axes.y)),
        difference(on_axis(corner, axes.z), on_axis(origin, axes.z)),
    );
}

// The image of a corner in the plane across the ray.
fn shear_corner(away: vec3<f32>, shear: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(
        difference(away.x, product(shear.x, away.z)),
        difference(away.y, product(shear.y, away.z)),
    );
}

// The image of corner 0, 1 or 2.
fn corner_image(seen: Sheared, corner: u32) -> vec2<f32> {
    return select(select(seen.a, seen.b, corner == 1u), seen.c, corner == 2u);
}

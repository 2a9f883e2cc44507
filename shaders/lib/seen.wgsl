// A ray as an instance of a scene sees it: twin of `ObjectSpace::ray`, and of the limits in `PackedScene::trace_in`.

// The bit of an instance's sides for a reflection.
const MIRRORED: u32 = 4u;

// The bits of the limit of a ray that has found something: the lesser of its own, and of the float after `t`, where one below
// the least normal number counts as that.
fn limit_after(own: u32, t: f32) -> u32 {
    let bits = bitcast<u32>(t);
    let negative = (bits >> 31u) == 1u && bits != 0x80000000u;
    let after = select(max(bits & 0x7fffffffu, 0x00800000u) + 1u, bits - 1u, negative);
    return select(own, after, limit_key(after) < limit_key(own));
}

// One coordinate of a direction as an instance sees it, from a row of its inverse.
fn seen_direction(row: vec4<u32>, d: vec3<f32>) -> f32 {
    let m = bitcast<vec4<f32>>(row);
    return snapped_sum(snapped_sum(snapped_product(m.x, d.x), snapped_product(m.y, d.y)), snapped_product(m.z, d.z));
}

// One coordinate of a point, likewise.
fn seen_point(row: vec4<u32>, p: vec3<f32>) -> f32 {
    return snapped_sum(seen_direction(row, p), bitcast<f32>(row.w));
}

// A ray as an instance sees it, up to a limit. Twin of `ObjectSpace::ray`.
fn seen_by(instance: u32, ray: Ray, t_max_bits: u32) -> Ray {
    let x = instances[8u * instance];
    let y = instances[8u * instance + 1u];
    let z = instances[8u * instance + 2u];
    let p = snap3(ray.origin);
    let d = snap3(ray.direction);
    let origin = vec3<f32>(seen_point(x, p), seen_point(y, p), seen_point(z, p));
    let direction = vec3<f32>(seen_direction(x, d), seen_direction(y, d), seen_direction(z, d));
    return Ray(origin, ray.t_min, direction, bitcast<f32>(t_max_bits));
}

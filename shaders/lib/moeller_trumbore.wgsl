// Twin of core/src/query/intersect: the fast test, Moeller and Trumbore 1997. Not watertight, and not
// the same bits on every device: its operations may fuse.

// The fast test: where the ray meets the triangle within its limits.
fn moeller_trumbore(ray: PreparedRay, triangle: Triangle, culling: u32) -> Candidate {
    let ab = triangle.b - triangle.a;
    let ac = triangle.c - triangle.a;
    let p = cross(ray.direction, ac);
    let det = dot(ab, p);
    let culled = (culling == CULL_BACK && det < 0.0) || (culling == CULL_FRONT && det > 0.0);
    if !is_finite_bits(bitcast<u32>(det)) || det == 0.0 || culled {
        return no_candidate();
    }
    let inverse = free_reciprocal(det);
    let ao = ray.origin - triangle.a;
    let q = cross(ao, ab);
    let found = vec3<f32>(
        dot(ac, q) * inverse,
        dot(ao, p) * inverse,
        dot(ray.direction, q) * inverse,
    );
    // Overflow is told by the bits: comparisons may take it for what they like.
    let inside = all_finite(found) && found.y >= 0.0 && found.z >= 0.0 && found.y + found.z <= 1.0
        && found.x >= ray.t_min && found.x <= ray.t_max;
    return Candidate(inside, false, found.x, vec3<f32>(found.y, found.z, 1.0));
}

// u and v of a hit.
fn barycentric(ray: PreparedRay, triangle: u32, weights: vec3<f32>) -> vec2<f32> {
    return weights.xy;
}

// The triangle test of this shader.
fn test_triangle(ray: PreparedRay, triangle: u32, culling: u32, stop: f32) -> Candidate {
    return moeller_trumbore(ray, corners_of(triangle), culling);
}

// Nothing is left open.
fn looks_closer() -> bool {
    return false;
}

fn test_closely(ray: PreparedRay, triangle: u32, culling: u32) -> Candidate {
    return no_candidate();
}

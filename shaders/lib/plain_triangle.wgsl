// Of triangles that take a closer look the ray is deferred: left to a shader with any_triangle.wgsl.

fn looks_closer() -> bool {
    return false;
}

fn test_closely(ray: PreparedRay, triangle: u32, culling: u32) -> Candidate {
    return no_candidate();
}

// An inner limit, from the key of the caller's: it takes no register meanwhile, and few triangles need it.
fn inner_limit(ray: PreparedRay, key: u32) -> f32 {
    let bits = select(~key, key ^ 0x80000000u, (key >> 31u) == 1u);
    return scale_bits(bits, exponent_of(ray));
}

fn inner_limits(ray: PreparedRay) -> vec2<f32> {
    return vec2<f32>(inner_limit(ray, ray.least_key), inner_limit(ray, ray.greatest_key));
}

// u and v of a hit: computed again from the triangle, so that no weights take registers during the traversal.
fn barycentric(ray: PreparedRay, triangle: u32, weights: vec3<f32>) -> vec2<f32> {
    let edges = edge_functions(sheared(ray, triangle));
    let det = sum(sum(edges.x, edges.y), edges.z);
    return weights_over(vec3<f32>(edges.y, edges.z, det));
}

// `reach_of`, from corners that are read again: few triangles need it, and the first six distances would take registers
// until then. No compiler can tell that the index is the same.
fn reach_again(origin: vec3<f32>, index: u32, seen: Sheared) -> f32 {
    let again = corners_of(index ^ opaque_zero);
    let a = abs(distance3(again.a, origin));
    let b = abs(distance3(again.b, origin));
    let c = abs(distance3(again.c, origin));
    let most_away = max(max(a, b), c);
    return max(max(most_away.x, most_away.y), most_away.z);
}

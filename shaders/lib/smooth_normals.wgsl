// Twin of `smooth_normal` in render/src/surface.rs; for scenes without normals at corners there is
// flat_normals.wgsl. Needs the bindings `frame` and `scene_words`.

// The normal between those of the corners, on the side of the triangle that the ray came from; the
// triangle's own where there is none, or where it would face away from the ray.
fn shading_normal(
    triangle: u32,
    weights: vec3<f32>,
    geometric_normal: vec3<f32>,
    direction: vec3<f32>,
) -> vec3<f32> {
    // Sections of scenes without normals are empty.
    if frame.normals_at == frame.texcoords_at {
        return geometric_normal;
    }
    let at = frame.normals_at + 9u * triangle;
    let between =
        weighted3(scene_vector(at), scene_vector(at + 3u), scene_vector(at + 6u), weights);
    var normal = normalized(between);
    if dot3(normal, geometric_normal) < 0.0 {
        normal = -normal;
    }
    if dot3(normal, direction) < 0.0 {
        return normal;
    }
    return geometric_normal;
}

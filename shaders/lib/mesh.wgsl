// The triangles of the mesh. Needs the binding `triangles`: nine words a triangle, snapped.

// Three corners.
struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

// The corners of a triangle.
fn corners_of(triangle: u32) -> Triangle {
    let first = triangle * 9u;
    return Triangle(
        vec3<f32>(triangles[first], triangles[first + 1u], triangles[first + 2u]),
        vec3<f32>(triangles[first + 3u], triangles[first + 4u], triangles[first + 5u]),
        vec3<f32>(triangles[first + 6u], triangles[first + 7u], triangles[first + 8u]),
    );
}

// The triangles of the mesh. Needs the binding `triangles`: nine words a triangle, snapped.

// Three corners.
struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

// The corners of a triangle, each in the order of these axes.
fn corners_along(triangle: u32, axes: vec3<u32>) -> Triangle {
    let x = triangle * 9u + axes.x;
    let y = triangle * 9u + axes.y;
    let z = triangle * 9u + axes.z;
    return Triangle(
        vec3<f32>(triangles[x], triangles[y], triangles[z]),
        vec3<f32>(triangles[x + 3u], triangles[y + 3u], triangles[z + 3u]),
        vec3<f32>(triangles[x + 6u], triangles[y + 6u], triangles[z + 6u]),
    );
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

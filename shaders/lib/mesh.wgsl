// The triangles of the mesh. Needs the binding `triangles`: nine words a triangle, snapped.

// An element of the binding: a triangle, so that its words lie at constant offsets from one address.
alias TriangleWords = array<f32, 9>;

// Three corners.
struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

// The corners of a triangle.
fn corners_of(triangle: u32) -> Triangle {
    return Triangle(
        vec3<f32>(triangles[triangle][0], triangles[triangle][1], triangles[triangle][2]),
        vec3<f32>(triangles[triangle][3], triangles[triangle][4], triangles[triangle][5]),
        vec3<f32>(triangles[triangle][6], triangles[triangle][7], triangles[triangle][8]),
    );
}

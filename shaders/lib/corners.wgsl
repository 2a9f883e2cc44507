// Snapped corners by triangle index. Needs the binding `triangles`: nine words a triangle.

fn corners_of(triangle: u32) -> Corners {
    let at = 9u * triangle;
    return Corners(
        vec3<f32>(triangles[at], triangles[at + 1u], triangles[at + 2u]),
        vec3<f32>(triangles[at + 3u], triangles[at + 4u], triangles[at + 5u]),
        vec3<f32>(triangles[at + 6u], triangles[at + 7u], triangles[at + 8u]),
    );
}

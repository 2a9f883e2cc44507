// The triangles of the mesh where one binding does not hold them, for kernels that have none to spare: what the binding `triangles`
// lacks stands behind the words of the scene. In place of mesh.wgsl.

// Three corners.
struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

// A word of the list of triangles.
fn triangle_word(at: u32) -> f32 {
    let here = arrayLength(&triangles);
    if at < here {
        return triangles[at];
    }
    return bitcast<f32>(scene_words[frame.tail_at + (at - here)]);
}

// The corners of a triangle, each in the order of these axes.
fn corners_along(triangle: u32, axes: vec3<u32>) -> Triangle {
    let x = triangle * 9u + axes.x;
    let y = triangle * 9u + axes.y;
    let z = triangle * 9u + axes.z;
    return Triangle(
        vec3<f32>(triangle_word(x), triangle_word(y), triangle_word(z)),
        vec3<f32>(triangle_word(x + 3u), triangle_word(y + 3u), triangle_word(z + 3u)),
        vec3<f32>(triangle_word(x + 6u), triangle_word(y + 6u), triangle_word(z + 6u)),
    );
}

// The corners of a triangle.
fn corners_of(triangle: u32) -> Triangle {
    let first = triangle * 9u;
    return Triangle(
        vec3<f32>(triangle_word(first), triangle_word(first + 1u), triangle_word(first + 2u)),
        vec3<f32>(triangle_word(first + 3u), triangle_word(first + 4u), triangle_word(first + 5u)),
        vec3<f32>(triangle_word(first + 6u), triangle_word(first + 7u), triangle_word(first + 8u)),
    );
}

// Twin of the end of render/src/fresnel.rs: mirrors.

// The mirrored direction; `cosine` is that of the reversed direction to the normal.
fn reflected(direction: vec3<f32>, normal: vec3<f32>, cosine: f32) -> vec3<f32> {
    return sum3(direction, scaled3(normal, product(2.0, cosine)));
}

// Cosine between a ray's reversed direction and a normal on its side, within 0 to 1.
fn incidence(direction: vec3<f32>, normal: vec3<f32>) -> f32 {
    return least(1.0, most(0.0, -dot3(direction, normal)));
}

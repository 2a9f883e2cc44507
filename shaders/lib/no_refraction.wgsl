// In place of refraction.wgsl, for scenes without clear bodies.

fn is_dielectric(material: u32) -> bool {
    return false;
}

fn refract_through(direction: vec3<f32>, weight: vec3<f32>, surface: Surface) -> Bounce {
    return Bounce(surface.point, direction, weight);
}

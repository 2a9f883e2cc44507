// Twin of `reflect` and `refract` in render/src/surface.rs. Needs the binding `scene_words`.

// A ray that goes on, and its path.
struct Bounce {
    origin: vec3<f32>,
    direction: vec3<f32>,
    weight: vec3<f32>,
}

fn reflect_off(direction: vec3<f32>, weight: vec3<f32>, surface: Surface) -> Bounce {
    let cosine = incidence(direction, surface.normal);
    let mirrored = reflected(direction, surface.normal, cosine);
    var part = product3(weight, second_colour(surface.material));
    if is_dielectric(surface.material) {
        part = scaled3(weight, surface.scattering.x);
    }
    return Bounce(start_of(surface, 1.0), normalized(mirrored), part);
}

// Twin of `refract` in render/src/surface.rs; for scenes without clear bodies there is
// no_refraction.wgsl. Needs the binding `scene_words`.

fn is_dielectric(material: u32) -> bool {
    return material_kind(material) == DIELECTRIC;
}

fn refract_through(direction: vec3<f32>, weight: vec3<f32>, surface: Surface) -> Bounce {
    let tinted = product3(weight, second_colour(surface.material));
    let part = scaled3(tinted, difference(1.0, surface.scattering.x));
    let cosine = incidence(direction, surface.normal);
    let out = refracted(direction, surface.normal, cosine, surface.scattering.z, surface.scattering.y);
    return Bounce(start_of(surface, -1.0), normalized(out), part);
}

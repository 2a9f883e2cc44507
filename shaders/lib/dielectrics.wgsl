// Twin of `shade_dielectric` in render/src/surface.rs; for scenes without clear bodies there is
// no_dielectrics.wgsl. Needs the bindings `frame` and `scene_words`.

fn is_dielectric(material: u32) -> bool {
    return material_kind(material) == DIELECTRIC;
}

fn shade_dielectric(
    given: Surface,
    direction: vec3<f32>,
    path: Path,
    from_front: bool,
    last: bool,
) -> Surface {
    var surface = given;
    surface.light = product3(path.weight, emission(surface.material));
    var ratio = refractive_index(surface.material);
    if from_front {
        ratio = quotient(1.0, ratio);
    }
    var cosine = incidence(direction, surface.normal);
    var parting = part(cosine, ratio);
    let out = refracted(direction, surface.normal, cosine, ratio, parting.cosine);
    let mirrored = reflected(direction, surface.normal, cosine);
    let above = dot3(mirrored, surface.geometric_normal) > 0.0;
    let below = parting.reflectance >= 1.0 || dot3(out, surface.geometric_normal) < 0.0;
    if !(above && below) {
        surface.normal = surface.geometric_normal;
        cosine = incidence(direction, surface.normal);
        parting = part(cosine, ratio);
    }
    surface.scattering = vec3<f32>(parting.reflectance, parting.cosine, ratio);
    if last {
        return surface;
    }
    if worthwhile(scaled3(path.weight, parting.reflectance)) {
        surface.flags |= SURFACE_REFLECTS;
    }
    let tinted = product3(path.weight, second_colour(surface.material));
    if worthwhile(scaled3(tinted, difference(1.0, parting.reflectance))) {
        surface.flags |= SURFACE_REFRACTS;
    }
    return surface;
}

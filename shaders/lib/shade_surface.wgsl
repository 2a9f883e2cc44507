// Twin of `shade` in render/src/surface.rs. Needs the bindings `frame`, `triangles` and `scene_words`.

// Nothing known yet.
fn no_surface() -> Surface {
    let zero = vec3<f32>(0.0);
    return Surface(zero, 0.0, zero, 0u, zero, 0u, zero, 0u, zero, 0u);
}

// Whether a path of this weight goes on.
fn worthwhile(weight: vec3<f32>) -> bool {
    return greatest(weight) >= frame.minimum_weight;
}

// What a path's ray met and what follows from it.
fn shade(direction: vec3<f32>, path: Path, hit: Hit, wave: u32) -> Surface {
    var surface = no_surface();
    if is_unfinished(hit) {
        surface.flags = SURFACE_UNFINISHED;
        return surface;
    }
    if !is_hit(hit) {
        surface.light = product3(path.weight, environment_radiance(direction));
        return surface;
    }
    let corners = corners_of(hit.triangle);
    let plane = plane_of(corners);
    let weights = vec3<f32>(difference(difference(1.0, hit.u), hit.v), hit.u, hit.v);
    let along_u = scaled3(plane.first_edge, hit.u);
    let along_v = scaled3(plane.second_edge, hit.v);
    surface.point = sum3(corners.a, sum3(along_u, along_v));
    surface.offset = plane.offset;
    var geometric_normal = normalized(plane.scaled_normal);
    // From the front the corners run counter-clockwise.
    let from_front = dot3(geometric_normal, direction) < 0.0;
    if all(geometric_normal == vec3<f32>(0.0)) {
        // Seen exactly from its edge, a triangle without area has no side of its own.
        geometric_normal = -direction;
    } else if !from_front {
        geometric_normal = -geometric_normal;
    }
    surface.geometric_normal = geometric_normal;
    surface.material = material_of(hit.triangle);
    surface.normal = shading_normal(hit.triangle, weights, geometric_normal, direction);
    let last = wave >= frame.depth;
    if is_dielectric(surface.material) {
        return shade_dielectric(surface, direction, path, from_front, last);
    }
    let texture = texture_colour(material_texture(surface.material), hit.triangle, weights);
    surface.scattering = product3(diffuse_colour(surface.material), texture);
    surface = shade_opaque(surface, direction, path, last);
    if greatest(surface.scattering) > 0.0 {
        surface.lights = may_be_lit(surface, path, wave);
    }
    return surface;
}

fn shade_opaque(given: Surface, direction: vec3<f32>, path: Path, last: bool) -> Surface {
    var surface = given;
    var received = scaled3(environment_irradiance(surface.normal), frame.ambient);
    let cosine = incidence(direction, surface.normal);
    received = sum3(received, vec3<f32>(product(frame.headlight, cosine)));
    let sent = sum3(emission(surface.material), product3(surface.scattering, received));
    surface.light = product3(path.weight, sent);
    if last || !worthwhile(product3(path.weight, second_colour(surface.material))) {
        return surface;
    }
    surface.flags = SURFACE_REFLECTS;
    let mirrored = reflected(direction, surface.normal, cosine);
    if dot3(mirrored, surface.geometric_normal) <= 0.0 {
        // The mirrored ray would go into the surface: the flat mirror does not.
        surface.normal = surface.geometric_normal;
    }
    return surface;
}

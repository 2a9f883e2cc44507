// As through_glass.wgsl, for hits that are certain: a ray goes on only where the distance of what it has met is known to
// the last bit. In place of that file. Needs rounded.wgsl.

// Clear surfaces that a shadow ray passes; behind more of them it is dark.
const MOST_CLEAR_LAYERS: u32 = 16u;

// What is left of the light of this invocation's ray. See `begin_light`.
var<private> light_left: vec3<f32>;
// Clear surfaces that it has passed.
var<private> layers_passed: u32;
// Whether it was stopped.
var<private> is_dark: bool;
// Whether it was left at a clear surface, whose distance is not certain.
var<private> is_left: bool;

// Begins a ray that would bring this light.
fn begin_light(light: vec3<f32>) {
    light_left = light;
    layers_passed = 0u;
    is_dark = false;
    is_left = false;
}

// Whether the ray passes what it has met.
fn passes(search: Search) -> bool {
    if !search.found || greatest_t(search.best) >= search.doubt {
        return false;
    }
    let material = material_of(search.triangle);
    if layers_passed == MOST_CLEAR_LAYERS || material_kind(material) != DIELECTRIC {
        is_dark = true;
        return false;
    }
    layers_passed += 1u;
    light_left = product3(light_left, second_colour(material));
    return greatest(light_left) > 0.0;
}

// The ray behind what it has met. Both ends are closed, so it starts at the next float; `t` is not negative. A ray that is
// left to the CPU meets nothing any more.
fn passed(ray: PreparedRay, search: Search) -> PreparedRay {
    var behind = ray;
    let power = exponent_of(ray);
    let distance = rounded_distance(search.best.t, search.best.error, power);
    is_left = !distance.some;
    if is_left {
        behind.t_max = -GREATEST;
        behind.greatest_key = 0u;
        return behind;
    }
    let next = bitcast<u32>(distance.value) + 1u;
    behind.least_key = limit_key(next);
    behind.t_min = scale_bits(next, power);
    return behind;
}

// Whether the CPU has to trace the ray.
fn is_undecided(hit: Hit) -> bool {
    return hit.triangle == UNDECIDED_HIT || is_left;
}

// A traversal goes on behind the clear surfaces that it meets, which tint the light, up to one that is opaque. In place of
// one_hit.wgsl.

// Clear surfaces that a shadow ray passes; behind more of them it is dark.
const MOST_CLEAR_LAYERS: u32 = 16u;

// What is left of the light of this invocation's ray. See `begin_light`.
var<private> light_left: vec3<f32>;
// Clear surfaces that it has passed.
var<private> layers_passed: u32;
// Whether it was stopped.
var<private> is_dark: bool;

// Begins a ray that would bring this light.
fn begin_light(light: vec3<f32>) {
    light_left = light;
    layers_passed = 0u;
    is_dark = false;
}

// Whether the ray passes what it has met.
fn passes(search: Search) -> bool {
    if !search.found {
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

// The ray behind what it has met. Both ends are closed, so it starts at the next float; `t` is not negative. The caller's
// limit decides what is met: the inner one may stay.
fn passed(ray: PreparedRay, search: Search) -> PreparedRay {
    var behind = ray;
    behind.least_key = limit_key(bitcast<u32>(search.t) + 1u);
    return behind;
}

// Whether the CPU has to trace the ray: none.
fn is_undecided(hit: Hit) -> bool {
    return false;
}

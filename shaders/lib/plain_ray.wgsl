// Rays of the plain case only: they start near the scene, and all exponents are in range. Every other is deferred: left
// to a shader with any_ray.wgsl, which gives the plain ones the same hits, bit for bit.

// Whether the ray of this invocation is left to another shader.
var<private> deferred: bool;

fn is_deferred() -> bool {
    return deferred;
}

fn place(given: vec3<f32>, direction: vec3<f32>, least_t: f32, greatest_t: f32) -> Placed {
    let origin = origin_in_range(given);
    if scene.wide != 0u || !is_near(given) || is_out_of_range(origin) {
        deferred = true;
        return not_placed();
    }
    return Placed(true, false, 0.0, origin, least_t, greatest_t);
}

// Computed when it is needed, which takes no registers meanwhile. In range: nothing overflows.
fn slack_of(reciprocal: vec3<f32>) -> vec3<f32> {
    return vec3<f32>();
}

fn slack_on(ray: PreparedRay, axis: u32, reciprocal: f32) -> f32 {
    return free_mul(scene.slack, abs(reciprocal));
}

fn wide_plane_interval(origin: f32, reciprocal: f32, slack: f32, position: f32) -> vec2<f32> {
    return vec2<f32>(-GREATEST, GREATEST);
}

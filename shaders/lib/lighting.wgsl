// Twin of render/src/lighting.rs but for surfaces that shine, which are in area_lights.wgsl. Light
// sample `l` is light `l` without a size; those that follow are samples of the triangles that shine.
// Needs the bindings `frame`, `triangles` and `scene_words`.

const ONE_OVER_PI: f32 = 0.31830988618379067;
const LIGHT_WORDS: u32 = 8u;
const DIRECTIONAL: u32 = 1u;

// The light samples that are on the surface's side: what a shadow ray is worth casting to.
fn may_be_lit(surface: Surface, path: Path, wave: u32) -> u32 {
    var lights = 0u;
    let samples = frame.lights + frame.area_samples;
    for (var sample = 0u; sample < samples; sample++) {
        var towards: vec3<f32>;
        if sample < frame.lights {
            let at = frame.lights_at + LIGHT_WORDS * sample;
            towards = scene_vector(at + 1u);
            if scene_words[at] != DIRECTIONAL {
                towards = difference3(towards, surface.point);
            }
        } else {
            towards = difference3(area_point(path, wave, sample), surface.point);
        }
        let faces = dot3(surface.normal, towards) > 0.0;
        if faces && dot3(surface.geometric_normal, towards) > 0.0 {
            lights |= 1u << sample;
        }
    }
    return lights;
}

// A ray towards a light sample, and the light that the path gets when nothing is in its way. It has no
// end where `endless`, else it ends at 1.
struct ShadowRay {
    origin: vec3<f32>,
    endless: bool,
    direction: vec3<f32>,
    light: vec3<f32>,
}

fn shadow_ray(surface: Surface, path: Path, wave: u32, sample: u32) -> ShadowRay {
    let start = start_of(surface, 1.0);
    let albedo = scaled3(product3(path.weight, surface.scattering), ONE_OVER_PI);
    if sample >= frame.lights {
        return area_shadow_ray(surface, path, wave, sample, start, albedo);
    }
    let at = frame.lights_at + LIGHT_WORDS * sample;
    let place = scene_vector(at + 1u);
    let irradiance = scene_vector(at + 4u);
    if scene_words[at] == DIRECTIONAL {
        let light = product3(albedo, scaled3(irradiance, dot3(surface.normal, place)));
        return ShadowRay(start, true, place, light);
    }
    let towards = difference3(place, surface.point);
    let falloff = quotient(scene_float(at + 7u), length3(towards));
    let cosine = dot3(surface.normal, normalized(towards));
    let share = product(product(falloff, falloff), cosine);
    let light = product3(albedo, scaled3(irradiance, share));
    return ShadowRay(start, false, difference3(place, start), light);
}

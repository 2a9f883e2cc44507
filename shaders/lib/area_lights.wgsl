// Twin of what render/src/lighting.rs has for surfaces that shine; for scenes without there is
// no_area_lights.wgsl. Needs the bindings `frame`, `triangles` and `scene_words`.

const EMITTER_WORDS: u32 = 4u;

// A point of a triangle that shines.
struct AreaSample {
    point: vec3<f32>,
    // Half the cross product's length: the area times 4^power.
    scaled_area: f32,
    // Unit normal of the triangle.
    normal: vec3<f32>,
    power: i32,
    // Radiance over the probability of the triangle.
    radiance: vec3<f32>,
    // How far off the triangle a ray must end, so that it does not meet it.
    offset: f32,
}

// Where the words of the triangle start that shines and whose share of 2^32 holds this word.
fn emitter_at(random: u32) -> u32 {
    // The first whose greatest word is not below; the last one's is 2^32 - 1.
    var low = 0u;
    var high = frame.emitters - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        if scene_words[frame.emitters_at + EMITTER_WORDS * middle + 1u] >= random {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    return frame.emitters_at + EMITTER_WORDS * low;
}

fn area_sample(path: Path, wave: u32, sample: u32) -> AreaSample {
    let index = path.sequence * frame.area_samples + (sample - frame.lights);
    let random = light_sample(path.pixel, wave, frame.seed, index);
    let emitter = emitter_at(random.z);
    let triangle = scene_words[emitter];
    let corners = corners_of(triangle);
    let plane = plane_of(corners);
    // Evenly over the parallelogram, its far half folded back.
    var u = unit(random.x);
    var v = unit(random.y);
    if sum(u, v) > 1.0 {
        u = difference(1.0, u);
        v = difference(1.0, v);
    }
    let weights = vec3<f32>(difference(difference(1.0, u), v), u, v);
    let share = quotient(1.0, scene_float(emitter + 2u));
    return AreaSample(
        weighted3(corners.a, corners.b, corners.c, weights),
        product(length3(plane.scaled_normal), 0.5),
        normalized(plane.scaled_normal),
        plane.power,
        scaled3(emission(material_of(triangle)), share),
        plane.offset,
    );
}

fn area_point(path: Path, wave: u32, sample: u32) -> vec3<f32> {
    return area_sample(path, wave, sample).point;
}

fn area_shadow_ray(
    surface: Surface,
    path: Path,
    wave: u32,
    sample: u32,
    start: vec3<f32>,
    albedo: vec3<f32>,
) -> ShadowRay {
    let area = area_sample(path, wave, sample);
    let towards = difference3(area.point, surface.point);
    let direction = normalized(towards);
    var normal = area.normal;
    if dot3(normal, direction) > 0.0 {
        normal = -normal;
    }
    let end = sum3(area.point, scaled3(normal, area.offset));
    // The solid angle: area over squared distance, the power of two taken to the distance first.
    let inverse = quotient(1.0, product(length3(towards), power_of_two(area.power)));
    let cosines = product(dot3(surface.normal, direction), -dot3(normal, direction));
    let solid_angle = product(product(product(area.scaled_area, inverse), inverse), cosines);
    let share = quotient(solid_angle, f32(frame.area_samples));
    let light = product3(albedo, scaled3(area.radiance, share));
    return ShadowRay(start, false, difference3(end, start), light);
}

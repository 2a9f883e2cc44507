// Twin of render/src/scene_words.rs: reads a scene's looks from its words. Needs the bindings `frame`
// and `scene_words`.

const NONE: u32 = 0xffffffffu;
const MATERIAL_WORDS: u32 = 16u;
const DIELECTRIC: u32 = 1u;

fn scene_float(at: u32) -> f32 {
    return bitcast<f32>(scene_words[at]);
}

fn scene_vector(at: u32) -> vec3<f32> {
    return vec3<f32>(scene_float(at), scene_float(at + 1u), scene_float(at + 2u));
}

// The material of a triangle.
fn material_of(triangle: u32) -> u32 {
    return scene_words[frame.material_of_at + triangle];
}

fn material_kind(material: u32) -> u32 {
    return scene_words[MATERIAL_WORDS * material];
}

fn material_texture(material: u32) -> u32 {
    return scene_words[MATERIAL_WORDS * material + 1u];
}

fn refractive_index(material: u32) -> f32 {
    return scene_float(MATERIAL_WORDS * material + 2u);
}

fn diffuse_colour(material: u32) -> vec3<f32> {
    return scene_vector(MATERIAL_WORDS * material + 4u);
}

// Reflectance of a mirror, or tint of a dielectric.
fn second_colour(material: u32) -> vec3<f32> {
    return scene_vector(MATERIAL_WORDS * material + 8u);
}

fn emission(material: u32) -> vec3<f32> {
    return scene_vector(MATERIAL_WORDS * material + 12u);
}

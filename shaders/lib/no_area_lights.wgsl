// In place of area_lights.wgsl, for scenes in which no surface shines.

fn area_point(path: Path, wave: u32, sample: u32) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn area_shadow_ray(
    surface: Surface,
    path: Path,
    wave: u32,
    sample: u32,
    start: vec3<f32>,
    albedo: vec3<f32>,
) -> ShadowRay {
    return ShadowRay(start, false, start, vec3<f32>(0.0));
}

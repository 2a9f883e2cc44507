// In place of dielectrics.wgsl, for scenes without clear bodies.

fn is_dielectric(material: u32) -> bool {
    return false;
}

fn shade_dielectric(
    given: Surface,
    direction: vec3<f32>,
    path: Path,
    from_front: bool,
    last: bool,
) -> Surface {
    return given;
}

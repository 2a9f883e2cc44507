// No ray is left to the CPU. In place of undecided.wgsl for triangle tests that decide every ray.

fn leave_undecided(
    count: u32,
    index: u32,
    triangle: u32,
    first: vec4<u32>,
    second: vec4<u32>,
    light: vec3<f32>,
) {}

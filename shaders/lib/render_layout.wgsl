// Twin of render/src/layout.rs: the records that the ray tracer's kernels exchange. See there for what
// each field means.

struct Frame {
    eye: vec3<f32>,
    zero: u32,
    corner: vec3<f32>,
    width: u32,
    step_x: vec3<f32>,
    height: u32,
    step_y: vec3<f32>,
    samples: u32,
    zenith: vec3<f32>,
    depth: u32,
    horizon: vec3<f32>,
    area_samples: u32,
    nadir: vec3<f32>,
    seed: u32,
    minimum_weight: f32,
    ambient: f32,
    headlight: f32,
    exposure: f32,
    sample_weight: f32,
    slice_pixels: u32,
    path_room: u32,
    shadow_room: u32,
    lights: u32,
    emitters: u32,
    materials: u32,
    triangles: u32,
    lights_at: u32,
    emitters_at: u32,
    textures_at: u32,
    srgb_at: u32,
    material_of_at: u32,
    normals_at: u32,
    texcoords_at: u32,
    texels_at: u32,
    culling: u32,
    ignore: u32,
    tail_at: u32,
    transport: u32,
    first_sequence: u32,
    sky_samples: u32,
    // Arrays of a uniform have elements of 16 bytes.
    padding_0: u32,
    padding_1: u32,
    padding_2: array<vec4<u32>, 2>,
}

struct Path {
    weight: vec3<f32>,
    pixel: u32,
    sequence: u32,
    density: f32,
    sky_density: f32,
    history: u32,
}

struct Surface {
    point: vec3<f32>,
    offset: f32,
    geometric_normal: vec3<f32>,
    material: u32,
    normal: vec3<f32>,
    lights: u32,
    scattering: vec3<f32>,
    flags: u32,
    light: vec3<f32>,
    incoming: u32,
}

const SURFACE_REFLECTS: u32 = 1u;
const SURFACE_REFRACTS: u32 = 2u;
const SURFACE_UNFINISHED: u32 = 4u;

struct Spawned {
    shadow_rays: u32,
    next_paths: u32,
}

struct FirstCost {
    nodes: u32,
    triangles: u32,
}

// Rays that a surface asks for: towards lights, and of the next wave.
fn spawned_by(surface: Surface) -> vec2<u32> {
    let next = surface.flags & (SURFACE_REFLECTS | SURFACE_REFRACTS);
    return vec2<u32>(countOneBits(surface.lights), countOneBits(next));
}

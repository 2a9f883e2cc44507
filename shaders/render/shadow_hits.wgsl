// Removes the light of shadow rays that hit something.
// One invocation a shadow ray; each chunk has a workgroup of its own.
// Reads: shadow rays; nodes, references, corners and scale of the scene.
// Writes: no light where there is a hit; 1 in the last component where the driver did not follow the ray
// to its end.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> shadow_rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> shadow_light: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_SHADOW_RAYS];
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = group.x * CHUNK + lane;
    if index < count {
        let ray = ray_of_words(shadow_rays[2u * index], shadow_rays[2u * index + 1u]);
        let hit = trace_ray(ray, options, true);
        if hit.triangle != NO_TRIANGLE {
            let unfinished = select(0.0, 1.0, hit.triangle == UNFINISHED);
            shadow_light[index] = vec4<f32>(0.0, 0.0, 0.0, unfinished);
        }
    }
}

// Removes the light of shadow rays that hit something opaque; clear surfaces only tint it.
// One invocation a shadow ray.
// Reads: shadow rays; the materials; nodes, references, corners and scale of the scene.
// Writes: what is left of the light; 1 in the last component where the driver did not follow the ray to
// its end.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> shadow_rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> scene_words: array<u32>;
@group(0) @binding(4) var<storage, read_write> shadow_light: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(7) var<storage, read> triangles: array<f32>;
@group(0) @binding(8) var<uniform> scene: Scene;

// Clear surfaces that a shadow ray passes; behind more of them it is dark.
const MOST_CLEAR_LAYERS: u32 = 16u;

// The next float: both ends of a ray are closed, so this leaves out what was just hit. `t` is not
// negative.
fn after(t: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(t) + 1u);
}

// What is left of the light at the end of a ray.
fn through_glass(given: Ray, light: vec3<f32>, options: QueryOptions) -> vec4<f32> {
    var ray = given;
    var left = light;
    // Says whether the loop came to its end: see `trace_ray`.
    var rounds = MOST_CLEAR_LAYERS + 1u;
    for (var layer = 0u; layer <= MOST_CLEAR_LAYERS; layer++) {
        let hit = trace_ray(ray, options, false);
        if hit.triangle == UNFINISHED {
            return vec4<f32>(0.0, 0.0, 0.0, 1.0);
        }
        if !is_hit(hit) {
            rounds = 0u;
            break;
        }
        let material = material_of(hit.triangle);
        if layer == MOST_CLEAR_LAYERS || material_kind(material) != DIELECTRIC {
            return vec4<f32>(0.0);
        }
        left = product3(left, second_colour(material));
        if greatest(left) <= 0.0 {
            rounds = 0u;
            break;
        }
        ray.t_min = after(hit.t);
    }
    if (rounds ^ opaque_zero) != 0u {
        return vec4<f32>(0.0, 0.0, 0.0, 1.0);
    }
    return vec4<f32>(left, 0.0);
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_SHADOW_RAYS];
    let options = QueryOptions(frame.culling, frame.ignore);
    for (var chunk = group.x; chunk < chunks_of(count); chunk += groups.x) {
        let index = chunk * CHUNK + lane;
        if index < count {
            let ray = ray_of_words(shadow_rays[2u * index], shadow_rays[2u * index + 1u]);
            shadow_light[index] = through_glass(ray, shadow_light[index].xyz, options);
        }
    }
}

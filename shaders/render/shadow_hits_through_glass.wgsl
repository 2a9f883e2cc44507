// Removes the light of shadow rays that hit something opaque; clear surfaces only tint it, as far as a lean traversal can tell.
// One invocation a shadow ray, in workgroups of TRACED.
// Reads: shadow rays; the materials; nodes and their references (the tree's or compressed ones), corners and scale of the scene.
// Writes: what is left of the light; 1 in the last component where the driver did not follow the ray to
// its end.
// In any order: the indices of those that are left to `shadow_hits_through_glass_retry`, and what is left to the CPU.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> shadow_rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> shadow_light: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;
@group(0) @binding(8) var<storage, read_write> deferred_rays: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read> scene_words: array<u32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    begin_stack(lane);
    let count = counters[COUNTER_SHADOW_RAYS];
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = group.x * TRACED + lane;
    if index < count {
        begin_light(shadow_light[index].xyz);
        let first = shadow_rays[2u * index];
        let second = shadow_rays[2u * index + 1u];
        let ray = ray_of_words(first, second);
        let hit = trace_ray(ray, options, false);
        if hit.triangle == DEFERRED {
            defer_ray(DEFERRED_SHADOW_RAYS, index, vec3<u32>());
            // Until it is taken up.
            shadow_light[index].w = 1.0;
        } else if hit.triangle == UNFINISHED {
            shadow_light[index] = vec4<f32>(0.0, 0.0, 0.0, 1.0);
        } else if is_undecided(hit) {
            let light = shadow_light[index].xyz;
            leave_undecided(UNDECIDED_SHADOW_RAYS, index, NO_TRIANGLE, first, second, light);
        } else if is_dark {
            shadow_light[index] = vec4<f32>(0.0);
        } else {
            shadow_light[index] = vec4<f32>(light_left, 0.0);
        }
    }
}

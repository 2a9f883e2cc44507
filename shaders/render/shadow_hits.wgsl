// Removes the light of shadow rays that hit something, as far as a lean traversal can tell.
// One invocation a shadow ray, in workgroups of TRACED.
// Reads: shadow rays; nodes and their references (the tree's or compressed ones), corners and scale of the scene.
// Writes: no light where there is a hit; 1 in the last component where the driver did not follow the ray
// to its end.
// In any order: the indices of those that are left to `shadow_hits_retry`, and what is left to the CPU.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> shadow_rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> shadow_light: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;
@group(0) @binding(8) var<storage, read_write> deferred_rays: array<atomic<u32>>;

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
        let first = shadow_rays[2u * index];
        let second = shadow_rays[2u * index + 1u];
        let ray = ray_of_words(first, second);
        let hit = trace_ray(ray, options, true);
        if hit.triangle == DEFERRED || hit.triangle == UNSETTLED {
            defer_ray(DEFERRED_SHADOW_RAYS, index, left_aside(hit));
            // Until it is taken up.
            shadow_light[index].w = 1.0;
        } else if hit.triangle == UNDECIDED_HIT {
            let light = shadow_light[index].xyz;
            leave_undecided(UNDECIDED_SHADOW_RAYS, index, NO_TRIANGLE, first, second, light);
        } else if hit.triangle != NO_TRIANGLE {
            let unfinished = select(0.0, 1.0, hit.triangle == UNFINISHED);
            shadow_light[index] = vec4<f32>(0.0, 0.0, 0.0, unfinished);
        }
    }
}

// The closest hit of every path's ray, as far as a lean traversal can tell.
// One invocation a path, in workgroups of TRACED.
// Reads: rays; nodes and their references (the tree's or compressed ones), corners and scale of the scene.
// Writes: a hit a ray; UNFINISHED in place of the triangle where the driver did not follow it to its end.
// Ties: among equal `t` the lower triangle index.
// The indices of those that are left to `closest_hits_retry`, in any order.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
// 16 bytes a hit. As bits, since the `t` of a miss is infinite.
@group(0) @binding(3) var<storage, read_write> hits: array<vec4<u32>>;
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
    let count = counters[COUNTER_PATHS];
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = group.x * TRACED + lane;
    if index < count {
        let ray = ray_of_words(rays[2u * index], rays[2u * index + 1u]);
        let hit = closest_hit(ray, options);
        hits[index] = hit_words(hit);
        if hit.triangle == DEFERRED || hit.triangle == UNSETTLED {
            defer_ray(DEFERRED_PATHS, index, left_aside(hit));
        }
    }
}

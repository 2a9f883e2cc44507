// What `shadow_hits_through_glass` leaves to this kernel: removes the light of shadow rays that hit something opaque; clear surfaces only tint it, for any ray.
// One invocation a shadow ray of the list, or fewer that take several, as many apart as there are; those beyond it do nothing.
// Reads: shadow rays; the materials; nodes, references, corners and scale of the scene; the list.
// Writes: what is left of the light; 1 in the last component where the driver did not follow the ray to
// its end. In any order, what is left to the CPU.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> shadow_rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> shadow_light: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;
@group(0) @binding(8) var<storage, read_write> deferred_rays: array<atomic<u32>>;
@group(0) @binding(9) var<storage, read> scene_words: array<u32>;

fn take_entry(place: u32) {
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = atomicLoad(&deferred_rays[DEFERRED_HEAD + 4u * place]);
    begin_light(shadow_light[index].xyz);
    shadow_light[index].w = 0.0;
    let first = shadow_rays[2u * index];
    let second = shadow_rays[2u * index + 1u];
    let ray = ray_of_words(first, second);
    let hit = trace_ray(ray, options, false);
    if hit.triangle == UNFINISHED {
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

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    take_entries(group.x * TRACED + lane, atomicLoad(&deferred_rays[DEFERRED_SHADOW_RAYS]), groups.x * TRACED);
}

// What `closest_hits` leaves to this kernel: the closest hit of every path's ray, for any ray.
// One invocation a path of the list, or fewer that take several, as many apart as there are; those beyond it do nothing.
// Reads: rays; nodes, references, corners and scale of the scene; the list.
// Writes: a hit a ray; UNFINISHED in place of the triangle where the driver did not follow it to its end.
// Ties: among equal `t` the lower triangle index.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
// 16 bytes a hit. As bits, since the `t` of a miss is infinite.
@group(0) @binding(3) var<storage, read_write> hits: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;
@group(0) @binding(8) var<storage, read_write> deferred_rays: array<u32>;

fn take_entry(place: u32) {
    let options = QueryOptions(frame.culling, frame.ignore);
    let at = DEFERRED_HEAD + 4u * place;
    let index = deferred_rays[at];
    to_take_up = vec3<u32>(deferred_rays[at + 1u], deferred_rays[at + 2u], deferred_rays[at + 3u]);
    let ray = ray_of_words(rays[2u * index], rays[2u * index + 1u]);
    hits[index] = hit_words(closest_hit(ray, options));
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    take_entries(group.x * TRACED + lane, deferred_rays[DEFERRED_PATHS], groups.x * TRACED);
}

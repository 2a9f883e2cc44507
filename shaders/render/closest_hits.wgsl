// The closest hit of every path's ray.
// One invocation a path; each chunk has a workgroup of its own.
// Reads: rays; nodes, references, corners and scale of the scene.
// Writes: a hit a ray; UNFINISHED in place of the triangle where the driver did not follow it to its end.
// Ties: among equal `t` the lower triangle index.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
// 16 bytes a hit. As bits, since the `t` of a miss is infinite.
@group(0) @binding(3) var<storage, read_write> hits: array<vec4<u32>>;
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
    let count = counters[COUNTER_PATHS];
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = group.x * CHUNK + lane;
    if index < count {
        let ray = ray_of_words(rays[2u * index], rays[2u * index + 1u]);
        hits[index] = hit_words(closest_hit(ray, options));
    }
}

// Notes what the traversal of the first ray of every pixel cost.
// One invocation a path; each chunk has a workgroup of its own. Only first ones do something.
// Reads: rays and paths; nodes, references, corners and scale of the scene.
// Writes: nodes visited and triangles tested, by pixel; of a ray that the driver did not follow to its
// end, those until then.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paths: array<Path>;
@group(0) @binding(4) var<storage, read_write> first_costs: array<FirstCost>;
@group(0) @binding(5) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(7) var<storage, read> triangles: array<f32>;
@group(0) @binding(8) var<uniform> scene: Scene;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PATHS];
    let options = QueryOptions(frame.culling, frame.ignore);
    let index = group.x * CHUNK + lane;
    if index < count && paths[index].sequence == 0u {
        counted = vec2<u32>(0u);
        trace_ray(ray_of_words(rays[2u * index], rays[2u * index + 1u]), options, false);
        first_costs[paths[index].pixel] = FirstCost(counted.x, counted.y);
    }
}

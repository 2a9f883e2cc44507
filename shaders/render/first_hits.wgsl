// Notes what the first ray of every pixel met.
// One invocation a path; only first ones do something.
// Reads: rays, paths and hits; corners.
// Writes: depth, unit normal on the side of the eye, triangle and weights, by pixel.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paths: array<Path>;
@group(0) @binding(4) var<storage, read> hits: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> triangles: array<f32>;
// Normal and depth; triangle and weights. As bits, since the depth of a miss is infinite.
@group(0) @binding(6) var<storage, read_write> first_hits: array<vec4<u32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PATHS];
    for (var chunk = group.x; chunk < chunks_of(count); chunk += groups.x) {
        let index = chunk * CHUNK + lane;
        if index < count && paths[index].sequence == 0u {
            let hit = hits[index];
            var normal = vec3<f32>(0.0);
            if hit.y < UNSETTLED {
                normal = normalized(plane_of(corners_of(hit.y)).scaled_normal);
                let direction = bitcast<vec3<f32>>(rays[2u * index + 1u].xyz);
                if dot3(normal, direction) > 0.0 {
                    normal = -normal;
                }
            }
            let pixel = paths[index].pixel;
            first_hits[2u * pixel] = vec4<u32>(bitcast<vec3<u32>>(normal), hit.x);
            first_hits[2u * pixel + 1u] = vec4<u32>(hit.yzw, 0u);
        }
    }
}

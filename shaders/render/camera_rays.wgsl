// A ray through every sample of the slice's pixels.
// One invocation a path.
// Reads: the camera.
// Writes: rays, and paths of weight 1.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
// 32 bytes a ray: origin and t_min, direction and t_max. As bits, since limits may be infinite.
@group(0) @binding(2) var<storage, read_write> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> paths: array<Path>;

// The direction through a sample of a pixel, of length 1, so that `t` is a distance.
fn camera_direction(pixel: u32, sequence: u32) -> vec3<f32> {
    let row = pixel / frame.width;
    let column = pixel - row * frame.width;
    let offset = sample_offset(sequence);
    let across = scaled3(frame.step_x, sum(f32(column), offset.x));
    let down = scaled3(frame.step_y, sum(f32(row), offset.y));
    return normalized(sum3(sum3(frame.corner, across), down));
}

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
        if index < count {
            let slice_pixel = index / frame.samples;
            let pixel = counters[COUNTER_FIRST_PIXEL] + slice_pixel;
            let sequence = index - slice_pixel * frame.samples;
            let direction = camera_direction(pixel, sequence);
            rays[2u * index] = vec4<u32>(bitcast<vec3<u32>>(frame.eye), 0u);
            rays[2u * index + 1u] = vec4<u32>(bitcast<vec3<u32>>(direction), INFINITY_BITS);
            paths[index] = Path(vec3<f32>(1.0), pixel, sequence, 0.0, 0.0, 0u);
        }
    }
}

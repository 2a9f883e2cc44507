// Radiance to what a screen shows.
// One invocation a pixel.
// Reads: radiance; the table of sRGB.
// Writes: 8 bits each of red, green, blue and alpha.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> radiance: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> scene_words: array<u32>;
@group(0) @binding(4) var<storage, read_write> pixels: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PIXELS];
    for (var chunk = group.x; chunk < chunks_of(count); chunk += groups.x) {
        let index = chunk * CHUNK + lane;
        if index < count {
            pixels[index] = shown(radiance[index]);
        }
    }
}

// What every path's ray met: the surface, the light it sends back by itself, and which rays it asks for.
// One workgroup a chunk, one invocation a path.
// Reads: rays, paths and hits; corners; the looks of the scene.
// Writes: a surface a path; how many rays the chunk asks for.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paths: array<Path>;
@group(0) @binding(4) var<storage, read> hits: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> triangles: array<f32>;
@group(0) @binding(6) var<storage, read> scene_words: array<u32>;
@group(0) @binding(7) var<storage, read_write> surfaces: array<Surface>;
@group(0) @binding(8) var<storage, read_write> spawned: array<Spawned>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PATHS];
    let wave = counters[COUNTER_WAVE];
    for (var chunk = group.x; chunk < chunks_of(count); chunk += groups.x) {
        let index = chunk * CHUNK + lane;
        var asked = vec2<u32>(0u);
        if index < count {
            let words = hits[index];
            // The `t` of a miss is infinite; it is not looked at.
            let hit = Hit(0.0, words.y, bitcast<f32>(words.z), bitcast<f32>(words.w));
            let direction = bitcast<vec3<f32>>(rays[2u * index + 1u].xyz);
            let surface = shade(direction, paths[index], hit, wave);
            surfaces[index] = surface;
            asked = spawned_by(surface);
        }
        exclusive_scan(lane, vec4<u32>(asked, 0u, 0u));
        if lane == 0u {
            let total = scan_total();
            spawned[chunk] = Spawned(total.x, total.y);
        }
    }
}

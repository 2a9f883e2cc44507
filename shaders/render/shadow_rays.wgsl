// A ray towards every light that may light a surface, in the order of paths and lights.
// One workgroup a chunk, one invocation a path.
// Reads: paths and surfaces; corners; the looks of the scene; how many shadow rays come before the chunk's.
// Writes: shadow rays, and the light that each brings when nothing is in its way.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> paths: array<Path>;
@group(0) @binding(3) var<storage, read> triangles: array<f32>;
@group(0) @binding(4) var<storage, read> scene_words: array<u32>;
@group(0) @binding(5) var<storage, read> surfaces: array<Surface>;
@group(0) @binding(6) var<storage, read> spawned: array<Spawned>;
@group(0) @binding(7) var<storage, read_write> shadow_rays: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> shadow_light: array<vec4<f32>>;

const LANES: u32 = 256u;

// The bits of 1, where a shadow ray ends at its light.
const ONE_BITS: u32 = 0x3f800000u;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PATHS];
    let wave = counters[COUNTER_WAVE];
    // Beyond the room of a frame that is void nothing is written.
    let room = counters[COUNTER_SHADOW_RAYS];
    for (var chunk = group.x; chunk < chunks_of(count); chunk += groups.x) {
        let index = chunk * CHUNK + lane;
        var left = 0u;
        if index < count {
            left = surfaces[index].lights;
        }
        let before = exclusive_scan(lane, vec4<u32>(countOneBits(left), 0u, 0u, 0u)).x;
        if left != 0u {
            let surface = surfaces[index];
            let path = paths[index];
            var place = spawned[chunk].shadow_rays + before;
            while left != 0u && place < room {
                let sent = shadow_ray(surface, path, wave, firstTrailingBit(left));
                left &= left - 1u;
                let t_max = select(ONE_BITS, INFINITY_BITS, sent.endless);
                shadow_rays[2u * place] = vec4<u32>(bitcast<vec3<u32>>(sent.origin), 0u);
                shadow_rays[2u * place + 1u] = vec4<u32>(bitcast<vec3<u32>>(sent.direction), t_max);
                shadow_light[place] = vec4<f32>(sent.light, 0.0);
                place += 1u;
            }
        }
    }
}

// The reflected and refracted rays of the next wave, in the order of the paths that they go on from.
// One workgroup a chunk, one invocation a path.
// Reads: rays, paths and surfaces; the materials; how many rays of the next wave come before the chunk's.
// Writes: rays and paths of the next wave.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paths: array<Path>;
@group(0) @binding(4) var<storage, read> scene_words: array<u32>;
@group(0) @binding(5) var<storage, read> surfaces: array<Surface>;
@group(0) @binding(6) var<storage, read> spawned: array<Spawned>;
@group(0) @binding(7) var<storage, read_write> next_rays: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read_write> next_paths: array<Path>;

const LANES: u32 = 256u;

fn put(place: u32, bounce: Bounce, path: Path) {
    // Beyond the room of a frame that is void nothing is written.
    if place < counters[COUNTER_NEXT_PATHS] {
        next_rays[2u * place] = vec4<u32>(bitcast<vec3<u32>>(bounce.origin), 0u);
        next_rays[2u * place + 1u] = vec4<u32>(bitcast<vec3<u32>>(bounce.direction), INFINITY_BITS);
        next_paths[place] = Path(bounce.weight, path.pixel, path.sequence, 0.0, 0.0, 0u);
    }
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
        var flags = 0u;
        if index < count {
            flags = surfaces[index].flags & (SURFACE_REFLECTS | SURFACE_REFRACTS);
        }
        let before = exclusive_scan(lane, vec4<u32>(countOneBits(flags), 0u, 0u, 0u)).x;
        if flags != 0u {
            let surface = surfaces[index];
            let path = paths[index];
            let direction = bitcast<vec3<f32>>(rays[2u * index + 1u].xyz);
            var place = spawned[chunk].next_paths + before;
            if (flags & SURFACE_REFLECTS) != 0u {
                put(place, reflect_off(direction, path.weight, surface), path);
                place += 1u;
            }
            if (flags & SURFACE_REFRACTS) != 0u {
                put(place, refract_through(direction, path.weight, surface), path);
            }
        }
    }
}

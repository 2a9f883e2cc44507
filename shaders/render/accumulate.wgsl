// Sums the light of the paths, pixel by pixel. Paths stand in the order of their pixels, so those of one
// pixel are neighbours.
// One workgroup a chunk, one invocation a path; the first path of a pixel sums for all of them.
// Reads: paths and surfaces; how many shadow rays come before the chunk's, and their light.
// Writes: the radiance of the pixels; the last component counts rays not followed to their end.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> paths: array<Path>;
@group(0) @binding(3) var<storage, read> surfaces: array<Surface>;
@group(0) @binding(4) var<storage, read> spawned: array<Spawned>;
@group(0) @binding(5) var<storage, read> shadow_light: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> radiance: array<vec4<f32>>;

const LANES: u32 = 256u;

// The light of the paths of a pixel from `first` on, whose shadow rays begin at `first_shadow`.
fn light_of(first: u32, count: u32, first_shadow: u32) -> vec4<f32> {
    let pixel = paths[first].pixel;
    var light = vec3<f32>(0.0);
    var unfinished = 0u;
    var shadow = first_shadow;
    var path = first;
    while path < count && paths[path].pixel == pixel {
        light = sum3(light, surfaces[path].light);
        unfinished += select(0u, 1u, (surfaces[path].flags & SURFACE_UNFINISHED) != 0u);
        let end = shadow + countOneBits(surfaces[path].lights);
        while shadow < end {
            // Beyond the room of a frame that is void there is none.
            if shadow < counters[COUNTER_SHADOW_RAYS] {
                let brought = shadow_light[shadow];
                light = sum3(light, brought.xyz);
                unfinished += u32(brought.w);
            }
            shadow += 1u;
        }
        // A driver may end loops that run long: see `trace_ray`.
        unfinished += select(0u, 1u, (shadow ^ opaque_zero) < end);
        path += 1u;
    }
    if (path ^ opaque_zero) < count && paths[path].pixel == pixel {
        unfinished += 1u;
    }
    return vec4<f32>(light, f32(unfinished));
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
        var lights = 0u;
        if index < count {
            lights = surfaces[index].lights;
        }
        let before = exclusive_scan(lane, vec4<u32>(countOneBits(lights), 0u, 0u, 0u)).x;
        if index < count {
            let pixel = paths[index].pixel;
            if index == 0u || paths[max(index, 1u) - 1u].pixel != pixel {
                let light = light_of(index, count, spawned[chunk].shadow_rays + before);
                let old = radiance[pixel];
                let updated = sum3(old.xyz, scaled3(light.xyz, frame.sample_weight));
                radiance[pixel] = vec4<f32>(updated, sum(old.w, light.w));
            }
        }
    }
}

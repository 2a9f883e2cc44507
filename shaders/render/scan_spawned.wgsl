// Scans the numbers of rays that chunks ask for.
// One workgroup.
// Reads: the numbers by chunk.
// Writes: those of all chunks before each; shadow rays and paths of the next wave, and whether they fit.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read_write> spawned: array<Spawned>;

const LANES: u32 = 256u;

var<workgroup> chunk_count: u32;

// Adds to a sum of two words, the higher behind the lower.
fn add_to(low: u32, number: u32) {
    let total = counters[low] + number;
    counters[low] = total;
    counters[low + 1u] += select(0u, 1u, total < number);
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        chunk_count = counters[COUNTER_PATH_CHUNKS];
    }
    let chunks = workgroupUniformLoad(&chunk_count);
    var total = vec2<u32>(0u);
    for (var start = 0u; start < chunks; start += LANES) {
        let chunk = start + lane;
        var asked = vec2<u32>(0u);
        if chunk < chunks {
            asked = vec2<u32>(spawned[chunk].shadow_rays, spawned[chunk].next_paths);
        }
        let before = total + exclusive_scan(lane, vec4<u32>(asked, 0u, 0u)).xy;
        if chunk < chunks {
            spawned[chunk] = Spawned(before.x, before.y);
        }
        total += scan_total().xy;
    }
    if lane == 0u {
        if total.y > frame.path_room {
            counters[COUNTER_OVERFLOW] |= OVERFLOW_PATHS;
        }
        if total.x > frame.shadow_room {
            counters[COUNTER_OVERFLOW] |= OVERFLOW_SHADOW_RAYS;
        }
        let shadow_rays = min(total.x, frame.shadow_room);
        let next_paths = min(total.y, frame.path_room);
        counters[COUNTER_SHADOW_RAYS] = shadow_rays;
        counters[COUNTER_NEXT_PATHS] = next_paths;
        add_to(COUNTER_TOTAL_PATHS_LOW, next_paths);
        add_to(COUNTER_TOTAL_SHADOW_RAYS_LOW, shadow_rays);
    }
}

// Makes the next wave this one.
// One invocation.
// Reads: the number of paths of the next wave.
// Writes: it as that of this wave, and the wave's number.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read_write> deferred_rays: array<u32>;

@compute @workgroup_size(1)
fn main() {
    let paths = counters[COUNTER_NEXT_PATHS];
    counters[COUNTER_PATHS] = paths;
    counters[COUNTER_PATH_CHUNKS] = chunks_of(paths);
    counters[COUNTER_NEXT_PATHS] = 0u;
    deferred_rays[DEFERRED_PATHS] = 0u;
    deferred_rays[DEFERRED_SHADOW_RAYS] = 0u;
    deferred_rays[UNDECIDED_PATHS] = 0u;
    deferred_rays[UNDECIDED_SHADOW_RAYS] = 0u;
    counters[COUNTER_SHADOW_RAYS] = 0u;
    counters[COUNTER_WAVE] += 1u;
}

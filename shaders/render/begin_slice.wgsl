// Takes the next slice of the picture.
// One invocation.
// Reads: pixels left.
// Writes: the slice's pixels and the number of its paths.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read_write> deferred_rays: array<u32>;

@compute @workgroup_size(1)
fn main() {
    let left = counters[COUNTER_PIXELS_LEFT];
    let taken = min(left, frame.slice_pixels);
    let paths = taken * frame.samples;
    counters[COUNTER_FIRST_PIXEL] = counters[COUNTER_PIXELS] - left;
    counters[COUNTER_PIXELS_LEFT] = left - taken;
    counters[COUNTER_WAVE] = 0u;
    counters[COUNTER_PATHS] = paths;
    counters[COUNTER_PATH_CHUNKS] = chunks_of(paths);
    counters[COUNTER_NEXT_PATHS] = 0u;
    deferred_rays[DEFERRED_PATHS] = 0u;
    deferred_rays[DEFERRED_SHADOW_RAYS] = 0u;
    deferred_rays[UNDECIDED_PATHS] = 0u;
    deferred_rays[UNDECIDED_SHADOW_RAYS] = 0u;
    counters[COUNTER_SHADOW_RAYS] = 0u;
    let low = counters[COUNTER_TOTAL_PATHS_LOW] + paths;
    counters[COUNTER_TOTAL_PATHS_LOW] = low;
    counters[COUNTER_TOTAL_PATHS_HIGH] += select(0u, 1u, low < paths);
}

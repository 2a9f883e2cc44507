// Twin of render/src/kernel.rs: counters of the ray tracer. Needs the binding `counters`.

// Paths, or whatever a grid stands for, that a workgroup takes at a time.
const CHUNK: u32 = 256u;

// Rays that a workgroup of a kernel that traces takes.
const TRACED: u32 = 64u;

// Words of `deferred_rays` before the list.
const DEFERRED_HEAD: u32 = 4u;
// Where the number of deferred paths is, and that of shadow rays. The list is first of the ones, then of the others.
const DEFERRED_PATHS: u32 = 0u;
const DEFERRED_SHADOW_RAYS: u32 = 1u;
// Where the number of undecided paths is, and that of shadow rays. Their records lie behind the list, and are replaced likewise.
const UNDECIDED_PATHS: u32 = 2u;
const UNDECIDED_SHADOW_RAYS: u32 = 3u;

const COUNTER_PIXELS: u32 = 0u;
const COUNTER_PIXELS_LEFT: u32 = 1u;
const COUNTER_FIRST_PIXEL: u32 = 2u;
const COUNTER_WAVE: u32 = 3u;
const COUNTER_PATHS: u32 = 4u;
const COUNTER_PATH_CHUNKS: u32 = 5u;
const COUNTER_NEXT_PATHS: u32 = 6u;
const COUNTER_SHADOW_RAYS: u32 = 7u;
const COUNTER_OVERFLOW: u32 = 8u;
const COUNTER_TOTAL_PATHS_LOW: u32 = 9u;
const COUNTER_TOTAL_PATHS_HIGH: u32 = 10u;
const COUNTER_TOTAL_SHADOW_RAYS_LOW: u32 = 11u;
const COUNTER_TOTAL_SHADOW_RAYS_HIGH: u32 = 12u;

const OVERFLOW_PATHS: u32 = 1u;
const OVERFLOW_SHADOW_RAYS: u32 = 2u;

// The number of chunks of this many items.
fn chunks_of(count: u32) -> u32 {
    return (count + CHUNK - 1u) / CHUNK;
}

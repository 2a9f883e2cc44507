// Twin of render/src/kernel.rs: counters of the ray tracer. Needs the bindings `frame` and `counters`.

// Paths, or whatever a grid stands for, that a workgroup takes at a time.
const CHUNK: u32 = 256u;

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

// A counter; zero once a queue has outgrown its room, so that nothing more is done.
fn live(counter: u32) -> u32 {
    return select(0u, counters[counter], counters[COUNTER_OVERFLOW] == 0u);
}

// The queues of this wave and of the next change places by name alone: their counters do so here.
fn paths_counter() -> u32 {
    return select(COUNTER_PATHS, COUNTER_NEXT_PATHS, frame.swapped == 1u);
}

fn next_paths_counter() -> u32 {
    return select(COUNTER_NEXT_PATHS, COUNTER_PATHS, frame.swapped == 1u);
}

// Paths of this wave.
fn path_count() -> u32 {
    return live(paths_counter());
}

// How many chunks so many things have.
fn chunks_of(count: u32) -> u32 {
    return (count + CHUNK - 1u) / CHUNK;
}

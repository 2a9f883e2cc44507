// The one nearest point of a query, in registers. In place of point_heap.wgsl.

@group(0) @binding(5) var<storage, read> indices: array<u32>;
@group(0) @binding(6) var<storage, read_write> found: array<vec2<u32>>;

fn begin_list(index: u32) {
    stop = vec2<u32>(point_batch.reach, 0xffffffffu);
}

fn visit(place: u32, bits: u32) {
    let key = vec2<u32>(bits, indices[place]);
    if is_before(key, stop) {
        stop = key;
    }
}

// Where no point was found, the key has no index.
fn end_list(index: u32) {
    found[index] = stop;
}

// The list of a query that was not finished.
fn mark_list(index: u32) {
    found[index].x = POINT_BATCH_ENDED_EARLY;
}

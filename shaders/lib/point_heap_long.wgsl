// A heap of any number of keys, where its keys are to be found in the end. In place of point_heap_short.wgsl.

fn heap_key(at: u32) -> vec2<u32> {
    return found[own_query * point_batch.room + at];
}

fn heap_store(at: u32, key: vec2<u32>) {
    found[own_query * point_batch.room + at] = key;
}

fn end_list(index: u32) {
}

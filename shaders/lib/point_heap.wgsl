// The nearest points of a query: a heap of `point_batch.room` keys with the greatest on top. At first it is full of the key
// from which on nothing counts, which has no index; so the greatest is always where the search stops. Where the heap lies
// stands in point_heap_short.wgsl or point_heap_long.wgsl: the functions `heap_key` and `heap_store`.

@group(0) @binding(5) var<storage, read> indices: array<u32>;
@group(0) @binding(6) var<storage, read_write> found: array<vec2<u32>>;

// The query. `begin_list` sets it.
var<private> own_query: u32;

fn begin_list(index: u32) {
    own_query = index;
    stop = vec2<u32>(point_batch.reach, 0xffffffffu);
    for (var at = 0u; at < point_batch.room; at++) {
        heap_store(at, stop);
    }
}

// Puts a key in place of the greatest.
fn replace_greatest(key: vec2<u32>) {
    var at = 0u;
    loop {
        var child = 2u * at + 1u;
        if child >= point_batch.room {
            break;
        }
        var greater = heap_key(child);
        if child + 1u < point_batch.room {
            let other = heap_key(child + 1u);
            if is_before(greater, other) {
                child += 1u;
                greater = other;
            }
        }
        if !is_before(key, greater) {
            break;
        }
        heap_store(at, greater);
        at = child;
    }
    heap_store(at, key);
    stop = heap_key(0u);
}

fn visit(place: u32, bits: u32) {
    let key = vec2<u32>(bits, indices[place]);
    if is_before(key, stop) {
        replace_greatest(key);
    }
}

// The list of a query that was not finished.
fn mark_list(index: u32) {
    found[index * point_batch.room].x = POINT_BATCH_ENDED_EARLY;
}

// A heap of up to 16 keys in the memory of the workgroup, for kernels of 64 invocations. Those of all lanes lie side by side.

const HEAP_SIZE: u32 = LANES * 16u;
var<workgroup> heap_keys: array<vec2<u32>, HEAP_SIZE>;

fn heap_key(at: u32) -> vec2<u32> {
    return heap_keys[at * LANES + own_lane];
}

fn heap_store(at: u32, key: vec2<u32>) {
    heap_keys[at * LANES + own_lane] = key;
}

fn end_list(index: u32) {
    for (var at = 0u; at < point_batch.room; at++) {
        found[index * point_batch.room + at] = heap_key(at);
    }
}

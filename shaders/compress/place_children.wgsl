// Gives the children of the batch their places, in the order of the parts. The next batch waits then.
// One workgroup, each invocation a run of parts.
// Reads: how many children and references each part has.
// Writes: the first child that is a node and the first reference of each; the counters. Where the queue has no room for the
// children, nothing waits and nothing is active.
// Ties: none.

@group(0) @binding(0) var<uniform> compress: Compress;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 8>;
@group(0) @binding(2) var<storage, read> child_counts: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> places: array<vec2<u32>>;

const LANES: u32 = 256u;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    let batch = waiting_count();
    // Queued, and referenced.
    let queued = vec2<u32>(counters[3], counters[4]);
    let run = (batch + LANES - 1u) / LANES;
    let start = min(batch, lane * run);
    let end = min(batch, start + run);
    var own = vec2<u32>(0u);
    for (var index = start; index < end; index++) {
        own += child_counts[index];
    }
    var next = queued + inclusive_scan(lane, own) - own;
    let after = queued + scan_sum();
    // Once it is outgrown nothing more is done.
    let before = counters[5];
    let beyond = max(after.x, compress.part_room) - compress.part_room;
    let outgrown = select(before, beyond, before == 0u);
    if outgrown == 0u {
        for (var index = start; index < end; index++) {
            places[index] = next;
            next += child_counts[index];
        }
    }
    workgroupBarrier();
    if lane != 0u {
        return;
    }
    if outgrown > 0u {
        counters[0] = 0u;
        counters[1] = 0u;
        counters[5] = outgrown;
        return;
    }
    let made = counters[2] + batch;
    counters[0] = min(compress.batch_room, after.x - made);
    counters[1] = batch;
    counters[2] = made;
    counters[3] = after.x;
    counters[4] = after.y;
}

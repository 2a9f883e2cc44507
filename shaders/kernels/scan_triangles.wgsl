// Scans the numbers of triangles kept, bounds the scene, makes the root.
// One workgroup.
// Reads: kept and snapped counts and bounds of the input's chunks.
// Writes: the exclusive scan of the kept counts in their place; the root, on the active list, or as an
// empty leaf when nothing is kept.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read_write> chunk_state: array<u32>;
@group(0) @binding(3) var<storage, read_write> active_nodes: array<LargeNode>;
@group(0) @binding(4) var<storage, read_write> top_nodes: array<TopNode>;

const LANES: u32 = 256u;

var<workgroup> chunk_count: u32;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    opaque_zero = parameters.zero;
    if lane == 0u {
        chunk_count = live(COUNTER_INPUT_CHUNKS);
    }
    let chunks = workgroupUniformLoad(&chunk_count);
    // As many chunks in a row an invocation.
    let share = (chunks + LANES - 1u) / LANES;
    let begin = min(lane * share, chunks);
    let end = min(begin + share, chunks);
    var own = vec2<u32>(0u);
    var bounds = empty_aabb();
    for (var chunk = begin; chunk < end; chunk++) {
        own += load_counts(chunk);
        let here = load_bounds(chunk, 0u);
        bounds = Aabb(least3(bounds.lo, here.lo), most3(bounds.hi, here.hi));
    }
    var before = inclusive_scan(lane, own).x - own.x;
    for (var chunk = begin; chunk < end; chunk++) {
        let counts = load_counts(chunk);
        store_counts(chunk, vec2<u32>(before, counts.y));
        before += counts.x;
    }
    let kept = scan_sum().x;
    let snapped = scan_sum().y;
    reduce_bounds(lane, bounds);
    if lane == 0u {
        let all = reduced_bounds();
        active_nodes[0] = LargeNode(all.lo, 0u, all.hi, kept, 0u, 0u, 0u, chunks, 0u, 0u, 0u, 0u);
        top_nodes[0] = TopNode(EMPTY, 0u, 0u, 0u);
        counters[COUNTER_DROPPED] = counters[COUNTER_TRIANGLES] - kept;
        counters[COUNTER_SNAPPED] = snapped;
        counters[COUNTER_ACTIVE_NODES] = select(0u, 1u, kept > 0u);
        counters[COUNTER_ACTIVE_REFERENCES] = kept;
        counters[COUNTER_CHUNKS] = chunks_of(kept);
        counters[COUNTER_TOP_NODES] = 1u;
        if kept > parameters.reference_room {
            counters[COUNTER_OVERFLOW] = OVERFLOW_REFERENCES;
        }
    }
}

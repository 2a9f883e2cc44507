// Gives the leaves of every middle root their places in the small list.
// One workgroup, each invocation a run of roots.
// Reads: what the roots have counted.
// Writes: the places of their leaves and references; the lengths of both lists. Where a root has outgrown its regions or a
// cap of the configuration might have bound, the build is void, and all lists are empty.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read_write> middle_roots: array<MiddleRoot>;

const LANES: u32 = 256u;
const MOST_EMITTED: u32 = 14u;
// What `outgrown` says: the rules of the stage, a list of the device, a loop that a driver ended.
const OUTGROWN_ROOM: u32 = 2u;
const OUTGROWN_UNFINISHED: u32 = 4u;

var<workgroup> outgrown: atomic<u32>;
var<workgroup> levels: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&outgrown, 0u);
        atomicStore(&levels, 0u);
    }
    let roots = middle_root_count();
    let share = (roots + LANES - 1u) / LANES;
    let start = min(roots, lane * share);
    let end = min(roots, start + share);
    // Leaves, references, nodes beyond the root; growth by halves.
    var sums = vec4<u32>(0u);
    var growth = vec2<u32>(0u);
    var own_levels = 0u;
    var own_outgrown = 0u;
    for (var index = start; index < end; index++) {
        let root = middle_roots[index];
        sums += vec4<u32>(root.leaves, root.references, max(root.nodes, 1u) - 1u, 0u);
        growth += vec2<u32>(root.growth & 0xffffu, root.growth >> 16u);
        own_levels = max(own_levels, root.levels);
        own_outgrown |= root.outgrown;
    }
    let before = exclusive_scan(lane, sums);
    let total = scan_total();
    _ = exclusive_scan(lane, vec4<u32>(growth, 0u, 0u));
    let grown = scan_total().xy;
    atomicMax(&levels, own_levels);
    atomicOr(&outgrown, own_outgrown);
    var place = before.xy;
    for (var index = start; index < end; index++) {
        middle_roots[index].first_leaf = place.x;
        middle_roots[index].first_reference = place.y;
        place += vec2<u32>(middle_roots[index].leaves, middle_roots[index].references);
    }
    workgroupBarrier();
    if lane == 0u && active_node_count() == 0u && live(COUNTER_TRIANGLES) > 0u {
        finish(total, grown);
    }
}

// a + b, at most 2^32 - 1.
fn saturating_sum(a: u32, b: u32) -> u32 {
    return a + min(b, 0xffffffffu - a);
}

fn finish(total: vec4<u32>, grown: vec2<u32>) {
    let state = atomicLoad(&outgrown);
    let high = grown.y + (grown.x >> 16u);
    let growth = select((high << 16u) | (grown.x & 0xffffu), 0xffffffffu, high > 0xffffu);
    let kept = counters[COUNTER_TRIANGLES] - counters[COUNTER_DROPPED];
    let made = saturating_sum(saturating_sum(kept, counters[COUNTER_GROWTH]), growth);
    let nodes = saturating_sum(counters[COUNTER_TOP_NODES], saturating_sum(total.z, MOST_EMITTED));
    if (state & OUTGROWN_UNFINISHED) != 0u {
        counters[COUNTER_OVERFLOW] = OVERFLOW_UNFINISHED;
        return;
    }
    if (state & OUTGROWN_ROOM) != 0u {
        counters[COUNTER_OVERFLOW] = OVERFLOW_MIDDLE_REGIONS;
        return;
    }
    if state != 0u || made > parameters.reference_cap || nodes > parameters.node_cap {
        for (var counter = 0u; counter < 32u; counter++) {
            counters[counter] = 0u;
        }
        counters[COUNTER_OVERFLOW] = OVERFLOW_MIDDLE_STAGE;
        return;
    }
    counters[COUNTER_MIDDLE_LEVELS] = max(counters[COUNTER_LEVELS], atomicLoad(&levels));
    counters[COUNTER_SMALL_ROOTS] = total.x;
    counters[COUNTER_SMALL_REFERENCES] = total.y;
    var overflow = 0u;
    overflow |= select(0u, OVERFLOW_SMALL_ROOTS, total.x > parameters.small_root_room);
    overflow |= select(0u, OVERFLOW_SMALL_REFERENCES, total.y > parameters.small_reference_room);
    if overflow != 0u {
        counters[COUNTER_OVERFLOW] = overflow;
    }
}

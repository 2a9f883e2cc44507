// Gives children their places: next list, small list, top tree.
// One workgroup, one invocation a node of the active list, 256 at a time.
// Reads: active nodes, decisions with counts.
// Writes: where each child's references go; the next list, the small list and the top tree, in the
// order of the active list. Caps bind here, by running sums over the list: nodes beyond them are
// transferred unsplit.
// Without the middle stage lists of nodes are long, and one workgroup would take most of its time for writing them: it
// then leaves that to `allocate_children_retry`, and writes where they begin.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read_write> decisions: array<Decision>;
@group(0) @binding(4) var<storage, read_write> next_nodes: array<LargeNode>;
@group(0) @binding(5) var<storage, read_write> small_roots: array<SmallRoot>;
@group(0) @binding(6) var<storage, read_write> top_nodes: array<TopNode>;
@group(0) @binding(7) var<storage, read_write> level_starts: array<u32>;

const LANES: u32 = 256u;

// The counters before this dispatch.
var<workgroup> counted: array<u32, 32>;
// How many nodes are active, and 1 where a cap may bind in this level.
var<workgroup> level_plan: vec2<u32>;
// Running totals, as of the nodes done so far.
var<workgroup> alive: u32;
var<workgroup> alive_before: u32;
var<workgroup> top_count: u32;
var<workgroup> next_count: u32;
var<workgroup> next_reference_count: u32;
var<workgroup> next_chunk_count: u32;
var<workgroup> small_count: u32;
var<workgroup> small_reference_count: u32;
// Whether the cap on nodes may bind among these 256, so that they must be taken one by one.
var<workgroup> one_by_one: u32;
// 1 when a decision could not be finished.
var<workgroup> unfinished: atomic<u32>;
// By lane: nodes to emit, growth of the references; then what the caps made of them.
var<workgroup> wanted: array<vec2<u32>, LANES>;
var<workgroup> verdicts: array<u32, LANES>;

// Most top nodes of one node: those of six cuts and a split.
const MOST_EMITTED: u32 = 14u;

const SPLIT: u32 = 0u;
// The split is refused, the cuts stay.
const REFUSED: u32 = 1u;
// Cuts and split are refused.
const REFUSED_ALL: u32 = 2u;

// a + b, at most 2^32 - 1.
fn saturating_sum(a: u32, b: u32) -> u32 {
    return a + min(b, 0xffffffffu - a);
}

// The caps, node by node: one that does not fit changes what the next ones find.
fn judge_one_by_one(count: u32) {
    var top = top_count;
    var sum = alive;
    for (var i = 0u; i < count; i++) {
        let cuts = wanted[i].x >> 1u;
        let splits = (wanted[i].x & 1u) == 1u;
        var emitted = 2u * cuts;
        if top + 2u * cuts + 2u > parameters.node_cap {
            verdicts[i] = REFUSED_ALL;
            emitted = 0u;
        } else {
            verdicts[i] = REFUSED;
            if splits {
                sum = saturating_sum(sum, wanted[i].y);
                if sum <= parameters.reference_cap {
                    verdicts[i] = SPLIT;
                    emitted += 2u;
                }
            }
        }
        top += emitted;
    }
    alive = sum;
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    opaque_zero = parameters.zero;
    // One load by each invocation; no later one waits for a counter.
    if lane < 32u {
        counted[lane] = counters[lane];
    }
    workgroupBarrier();
    level = counted[COUNTER_LEVELS];
    if lane == 0u {
        atomicStore(&unfinished, 0u);
        let present = select(0u, counted[COUNTER_ACTIVE_NODES + parameters.swapped], counted[COUNTER_OVERFLOW] == 0u);
        let references = counted[COUNTER_ACTIVE_REFERENCES + parameters.swapped];
        top_count = counted[COUNTER_TOP_NODES];
        alive = counted[COUNTER_SMALL_REFERENCES] + references;
        alive_before = alive;
        next_count = 0u;
        next_reference_count = 0u;
        next_chunk_count = 0u;
        small_count = counted[COUNTER_SMALL_ROOTS];
        small_reference_count = counted[COUNTER_SMALL_REFERENCES];
        if present > 0u && level < parameters.level_room {
            level_starts[level] = top_count;
        }
        // A split adds no more than its node has, since each reference has at most a part on either side.
        let capped = top_count + MOST_EMITTED * present > parameters.node_cap
            || saturating_sum(alive, references) > parameters.reference_cap;
        level_plan = vec2<u32>(present, select(0u, 1u, capped));
    }
    let plan = workgroupUniformLoad(&level_plan);
    let nodes = plan.x;
    for (var start = 0u; start < nodes; start += LANES) {
        place_nodes(start, min(LANES, nodes - start), plan.y == 1u, lane);
    }
    if lane == 0u {
        // With no active nodes the next list becomes empty and all else stays.
        counters[COUNTER_NEXT_NODES - parameters.swapped] = next_count;
        counters[COUNTER_NEXT_REFERENCES - parameters.swapped] = next_reference_count;
        counters[COUNTER_NEXT_CHUNKS - parameters.swapped] = next_chunk_count;
        if nodes > 0u {
            counters[COUNTER_SMALL_ROOTS] = small_count;
            if parameters.hand_over_limit > parameters.small_node_limit {
                counters[COUNTER_MIDDLE_ROOTS] = small_count;
            }
            counters[COUNTER_GROWTH] = saturating_sum(counted[COUNTER_GROWTH], alive - alive_before);
            counters[COUNTER_SMALL_REFERENCES] = small_reference_count;
            counters[COUNTER_TOP_NODES] = top_count;
            counters[COUNTER_LEVELS] = counted[COUNTER_LEVELS] + 1u;
            var overflow = 0u;
            overflow |= select(0u, OVERFLOW_NODES, next_count > parameters.node_room);
            overflow |= select(0u, OVERFLOW_REFERENCES, next_reference_count > parameters.reference_room);
            overflow |= select(0u, OVERFLOW_CHUNKS, next_chunk_count > parameters.chunk_room);
            overflow |= select(0u, OVERFLOW_SMALL_ROOTS, small_count > parameters.small_root_room);
            overflow |= select(0u, OVERFLOW_SMALL_REFERENCES, small_reference_count > parameters.small_reference_room);
            overflow |= select(0u, OVERFLOW_TOP_NODES, top_count > parameters.top_node_room);
            overflow |= select(0u, OVERFLOW_LEVELS, counted[COUNTER_LEVELS] >= parameters.level_room);
            overflow |= select(0u, OVERFLOW_UNFINISHED, atomicLoad(&unfinished) == 1u);
            if overflow != 0u {
                counters[COUNTER_OVERFLOW] = overflow;
            }
        }
    }
}

// Up to 256 nodes, one a lane. `capped` says whether a cap may bind.
fn place_nodes(start: u32, count: u32, capped: bool, lane: u32) {
    let index = start + lane;
    let present = lane < count;
    // Field by field: records lie apart, so that each word of each is an access of its own.
    var decision: Decision;
    var references = 0u;
    var worst = 0u;
    var growth = 0u;
    if present {
        references = active_nodes[index].count;
        decision.cut_count = decisions[index].cut_count;
        decision.cut_sides = decisions[index].cut_sides;
        decision.axis = decisions[index].axis;
        decision.position = decisions[index].position;
        decision.counts = decisions[index].counts;
        if (decision.cut_sides & UNDECIDED) != 0u {
            atomicStore(&unfinished, 1u);
        }
        let splits = decision.axis != TRANSFER;
        let both = decision.counts.x + decision.counts.y;
        growth = select(0u, both - min(both, references), splits);
        wanted[lane] = vec2<u32>(2u * decision.cut_count + select(0u, 1u, splits), growth);
        worst = 2u * decision.cut_count + 2u;
    }
    // Growth of 256 nodes may pass 2^32: low and high halves are summed apart.
    let halves = vec2<u32>(growth & 0xffffu, growth >> 16u);
    if capped {
        judge(count, worst, halves, present, lane);
    }
    var places = vec4<u32>(0u);
    var emitted = 0u;
    var chunks = 0u;
    if present {
        var verdict = select(REFUSED, SPLIT, decision.axis != TRANSFER);
        if capped {
            verdict = verdicts[lane];
        }
        if verdict == REFUSED_ALL {
            decision.cut_count = 0u;
            decisions[index].cut_count = 0u;
        }
        if verdict != SPLIT {
            decision.axis = TRANSFER;
            decision.position = 0.0;
            decision.counts = vec2<u32>(references, 0u);
            decisions[index].axis = decision.axis;
            decisions[index].position = decision.position;
            decisions[index].counts = decision.counts;
        }
        emitted = emitted_by(decision);
        for (var side = 0u; side < 2u; side++) {
            let own = select(decision.counts.x, decision.counts.y, side == 1u);
            if is_large(decision, own) {
                places += vec4<u32>(1u, own, 0u, 0u);
                chunks += chunks_of(own);
            } else if own > 0u {
                places += vec4<u32>(0u, 0u, 1u, own);
            }
        }
    }
    let firsts = exclusive_scan(lane, count, Sums(places, vec4<u32>(emitted, chunks, halves.x, halves.y)));
    let totals = scan_totals(count);
    if present {
        let place = firsts.a + vec4<u32>(next_count, next_reference_count, small_count, small_reference_count);
        let chunk = next_chunk_count + firsts.b.y;
        decision.first_node = top_count + firsts.b.x;
        decision.first = first_references(decision, place.yw);
        decisions[index].first_node = decision.first_node;
        decisions[index].first = decision.first;
        // A tree that outgrows its room is not written: the build will be repeated.
        if decision.first_node + emitted <= parameters.top_node_room {
            if parameters.hand_over_limit > parameters.small_node_limit {
                emit_nodes(index, decision, active_nodes[index], place.x, place.z, chunk);
            } else {
                top_nodes[place_of_places(decision, active_nodes[index].node)] =
                    TopNode(place.x, place.z, chunk, 0u);
            }
        }
    }
    workgroupBarrier();
    if lane == 0u {
        next_count += totals.a.x;
        next_reference_count += totals.a.y;
        small_count += totals.a.z;
        small_reference_count += totals.a.w;
        top_count += totals.b.x;
        if !capped {
            alive = alive_after(totals.b.zw);
        }
        next_chunk_count += totals.b.y;
    }
    workgroupBarrier();
}

// The caps: a verdict for each of up to 256 nodes, from the most top nodes that it may emit and its growth by halves. All
// invocations must call it.
fn judge(count: u32, worst: u32, growth: vec2<u32>, present: bool, lane: u32) {
    let before = exclusive_scan(lane, count, Sums(vec4<u32>(worst, growth.x, growth.y, 0u), vec4<u32>(0u))).a;
    let most = scan_totals(count).a;
    if lane == 0u {
        one_by_one = select(0u, 1u, top_count + most.x > parameters.node_cap);
    }
    if workgroupUniformLoad(&one_by_one) == 1u {
        if lane == 0u {
            judge_one_by_one(count);
        }
        workgroupBarrier();
    } else {
        if present {
            let sum = alive_after(before.yz + growth);
            let splits = (wanted[lane].x & 1u) == 1u;
            verdicts[lane] = select(REFUSED, SPLIT, splits && sum <= parameters.reference_cap);
        }
        workgroupBarrier();
        if lane == 0u {
            alive = alive_after(most.yz);
        }
    }
}

// What is alive after growth that was summed in halves.
fn alive_after(sums: vec2<u32>) -> u32 {
    let high = sums.y + (sums.x >> 16u);
    let grown = select((high << 16u) | (sums.x & 0xffffu), 0xffffffffu, high > 0xffffu);
    return saturating_sum(alive, grown);
}

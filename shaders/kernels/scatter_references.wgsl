// Moves references to the children, clipped, and bounds them by chunk.
// One workgroup a chunk, one invocation a reference; then one invocation each of those that the plane cuts.
// Reads: decisions, sides, counts, references, corners of those that a plane cuts where
// they are clipped.
// Writes: the references of the children, clipped to their side, in order; bounds by chunk and child.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(3) var<storage, read> decisions: array<Decision>;
@group(0) @binding(4) var<storage, read> references: array<Reference>;
@group(0) @binding(5) var<storage, read> triangles: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> chunk_state: array<u32>;
@group(0) @binding(7) var<storage, read_write> next_references: array<Reference>;

const LANES: u32 = 256u;

// Which references go to the left and to the right, eight words each, and how many before each word.
var<workgroup> side_words: array<u32, 16>;
var<workgroup> side_ranks: array<u32, 16>;
// The lanes whose references the plane cuts. Their order may differ from run to run; the places of their parts do not
// depend on it.
var<workgroup> cut_lanes: array<u32, LANES>;
var<workgroup> cut_count: atomic<u32>;
// Bounds of what each lane's reference left, left and right, as 12 coordinates of which the least is sought: those of upper corners
// are negated. Then the least of 8 lanes, and of 32.
var<workgroup> lane_bounds: array<vec4<f32>, 768>;
var<workgroup> part_bounds: array<vec4<f32>, 96>;
var<workgroup> few_bounds: array<vec4<f32>, 24>;

// What the chunks before this one give to both sides. First the counts of those in its span, left in the low half and right in the
// high one, and the sums of whole spans by lane; then sums of 16 of each. What goes left stands in `cut_lanes`, which are not known yet.
var<workgroup> span_rights: array<u32, SPAN>;
var<workgroup> few_before: array<vec2<u32>, 16>;

// Whether a lane's reference goes to a side (0 left, 1 right).
fn goes(side: u32, lane: u32) -> bool {
    return ((side_words[8u * side + lane / 32u] >> (lane % 32u)) & 1u) == 1u;
}

// How many of the chunk's references before a lane's go there.
fn rank(side: u32, lane: u32) -> u32 {
    let word = 8u * side + lane / 32u;
    return side_ranks[word] + countOneBits(side_words[word] & ((1u << (lane % 32u)) - 1u));
}

// A child of `count` references takes one at `place`.
fn store(count: u32, place: u32, bounds: Aabb, triangle: u32) {
    let reference = Reference(bounds.lo, triangle, bounds.hi, 0u);
    if count > parameters.hand_over_limit {
        store_next(place, reference);
    } else {
        store_small(place, reference);
    }
}

// Which references go where, and what the chunks before this one give to both sides: `place` is how many of its node these are.
// Every lane must call it.
fn load_sides(chunk: u32, place: u32, lane: u32) {
    let spans = place / SPAN;
    let first = chunk - place;
    workgroupBarrier();
    // By the last lanes, which have least to load below.
    if lane >= LANES - 16u {
        let word = lane - (LANES - 16u);
        side_words[word] = chunk_state[sides_of(chunk) + word];
    }
    if lane == 0u {
        atomicStore(&cut_count, 0u);
    }
    if lane < SPAN {
        var counts = vec2<u32>(0u);
        if lane < place % SPAN {
            counts = load_counts(first + spans * SPAN + lane);
        }
        cut_lanes[lane] = counts.x | (counts.y << 16u);
    } else {
        var sums = vec2<u32>(0u);
        for (var span = lane - SPAN; span < spans; span += SPAN) {
            let sides = chunks[first + span * SPAN].span_sides;
            sums += vec2<u32>(sides & 0xffffu, sides >> 16u);
        }
        cut_lanes[lane] = sums.x;
        span_rights[lane - SPAN] = sums.y;
    }
    workgroupBarrier();
    if lane >= 32u && lane < 48u {
        let begin = 16u * (lane % 8u);
        var sums = vec2<u32>(0u);
        if lane < 40u {
            var packed = 0u;
            for (var i = 0u; i < 16u; i++) {
                packed += cut_lanes[begin + i];
            }
            sums = vec2<u32>(packed & 0xffffu, packed >> 16u);
        } else {
            for (var i = 0u; i < 16u; i++) {
                sums += vec2<u32>(cut_lanes[SPAN + begin + i], span_rights[begin + i]);
            }
        }
        few_before[lane - 32u] = sums;
    }
    if lane < 16u {
        var count = 0u;
        for (var word = lane & 8u; word < lane; word++) {
            count += countOneBits(side_words[word]);
        }
        side_ranks[lane] = count;
    }
    workgroupBarrier();
}

// The bounds of what a lane's reference left on both sides.
fn put_bounds(lane: u32, left: Aabb, right: Aabb) {
    lane_bounds[lane] = vec4<f32>(left.lo, -left.hi.x);
    lane_bounds[LANES + lane] = vec4<f32>(-left.hi.yz, right.lo.xy);
    lane_bounds[2u * LANES + lane] = vec4<f32>(right.lo.z, -right.hi);
}

// What was put for a lane on one side.
fn put_on(lane: u32, side: u32) -> Aabb {
    let middle = lane_bounds[LANES + lane];
    let other = lane_bounds[2u * LANES * side + lane];
    if side == 0u {
        return Aabb(other.xyz, -vec3<f32>(other.w, middle.xy));
    }
    return Aabb(vec3<f32>(middle.zw, other.x), -other.yzw);
}

// Writes the unions of what was put. Every lane must call it.
fn store_bounds(chunk: u32, lane: u32) {
    workgroupBarrier();
    if lane < 96u {
        let first = (lane / 32u) * LANES + lane % 32u;
        var bounds = lane_bounds[first];
        for (var i = 32u; i < LANES; i += 32u) {
            bounds = min(bounds, lane_bounds[first + i]);
        }
        part_bounds[lane] = bounds;
    }
    workgroupBarrier();
    if lane < 24u {
        let first = (lane / 8u) * 32u + lane % 8u;
        let a = min(part_bounds[first], part_bounds[first + 8u]);
        let b = min(part_bounds[first + 16u], part_bounds[first + 24u]);
        few_bounds[lane] = min(a, b);
    }
    workgroupBarrier();
    if lane < 12u {
        let first = (lane / 4u) * 8u;
        var bound = few_bounds[first][lane % 4u];
        for (var i = 1u; i < 8u; i++) {
            bound = min(bound, few_bounds[first + i][lane % 4u]);
        }
        let is_upper = lane % 6u >= 3u;
        chunk_state[bounds_of(chunk, 0u) + lane] = bitcast<u32>(select(bound, -bound, is_upper));
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(active_chunk_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let chunk = chunks[index];
        let decision = decisions[chunk.node];
        // Uniform: every lane reads the same chunk.
        if !is_seen(chunk, decision) {
            continue;
        }
        let place_of_chunk = select(0u, (chunk.first - decision.source_first) / CHUNK, decision.axis != TRANSFER);
        load_sides(index, place_of_chunk, lane);
        var left_bounds = empty_aabb();
        var right_bounds = left_bounds;
        var places = decision.first;
        for (var i = 0u; i < (place_of_chunk % SPAN + 15u) / 16u; i++) {
            places += few_before[i];
        }
        for (var i = 0u; i < min((place_of_chunk / SPAN + 15u) / 16u, 8u); i++) {
            places += few_before[8u + i];
        }
        if lane < chunk.count {
            let reference = active_reference(chunk.first + lane);
            let bounds = Aabb(reference.lo, reference.hi);
            if decision.axis == TRANSFER {
                let place = decision.first.x + chunk.first - decision.source_first + lane;
                store_small(place, reference);
            } else if strictly_inside(bounds, decision.axis, decision.position) {
                cut_lanes[atomicAdd(&cut_count, 1u)] = lane;
            } else {
                // It goes to one side only.
                let side = select(1u, 0u, goes(0u, lane));
                let count = select(decision.counts.y, decision.counts.x, side == 0u);
                let place = select(places.y, places.x, side == 0u) + rank(side, lane);
                store(count, place, bounds, reference.triangle);
                if side == 0u {
                    left_bounds = bounds;
                } else {
                    right_bounds = bounds;
                }
            }
        }
        put_bounds(lane, left_bounds, right_bounds);
        workgroupBarrier();
        if lane < atomicLoad(&cut_count) {
            let source = cut_lanes[lane];
            let reference = active_reference(chunk.first + source);
            let bounds = Aabb(reference.lo, reference.hi);
            var parts = Parts(bounds, bounds);
            if parameters.clip == 1u {
                parts = clip(corners_of(reference.triangle), bounds, decision.axis, decision.position);
            } else {
                parts.left.hi = with_axis(bounds.hi, decision.axis, decision.position);
                parts.right.lo = with_axis(bounds.lo, decision.axis, decision.position);
            }
            // It may still go to one side only: its part on the other came out empty.
            if !goes(0u, source) {
                parts.left = empty_aabb();
            }
            if !goes(1u, source) {
                parts.right = empty_aabb();
            }
            put_bounds(source, parts.left, parts.right);
            // One side after the other, from memory: in registers both would leave room for fewer workgroups.
            for (var side = 0u; side < 2u; side++) {
                if goes(side, source) {
                    let count = select(decision.counts.y, decision.counts.x, side == 0u);
                    let place = select(places.y, places.x, side == 0u) + rank(side, source);
                    store(count, place, put_on(source, side), reference.triangle);
                }
            }
        }
        store_bounds(index, lane);
    }
}

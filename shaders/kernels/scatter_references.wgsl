// Moves references to the children, clipped, and bounds them by chunk.
// One workgroup a chunk, one invocation a reference.
// Reads: decisions, sides, scanned counts, references, corners of those that a plane cuts where
// they are clipped.
// Writes: the references of the children, clipped to their side, in order; bounds by chunk and child.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(3) var<storage, read> decisions: array<Decision>;
@group(0) @binding(4) var<storage, read> references: array<Reference>;
@group(0) @binding(5) var<storage, read> triangles: array<f32>;
@group(0) @binding(6) var<storage, read_write> chunk_state: array<u32>;
@group(0) @binding(7) var<storage, read_write> next_references: array<Reference>;

const LANES: u32 = 256u;
const BOXES: u32 = 2u;

var<workgroup> side_words: array<u32, 16>;

// Whether this lane's reference goes to a side (0 left, 1 right).
fn goes(side: u32, lane: u32) -> bool {
    return ((side_words[8u * side + lane / 32u] >> (lane % 32u)) & 1u) == 1u;
}

// How many of the chunk's references before this lane's go there.
fn rank(side: u32, lane: u32) -> u32 {
    var count = 0u;
    for (var word = 0u; word < lane / 32u; word++) {
        count += countOneBits(side_words[8u * side + word]);
    }
    return count + countOneBits(side_words[8u * side + lane / 32u] & ((1u << (lane % 32u)) - 1u));
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

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = select(0u, slice_end(active_chunk_count()), active_node_count() > 0u);
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let chunk = chunks[index];
        let decision = decisions[chunk.node];
        // Uniform: every lane reads the same chunk.
        if !is_seen(chunk, decision) {
            continue;
        }
        workgroupBarrier();
        if lane < 16u {
            side_words[lane] = chunk_state[sides_of(index) + lane];
        }
        workgroupBarrier();
        var left_bounds = empty_aabb();
        var right_bounds = empty_aabb();
        if lane < chunk.count {
            let reference = active_reference(chunk.first + lane);
            if decision.axis == TRANSFER {
                let place = decision.first.x + chunk.first - decision.source_first + lane;
                store_small(place, reference);
            } else {
                let bounds = Aabb(reference.lo, reference.hi);
                var parts = Parts(bounds, bounds);
                // A reference that goes to one side only may still have bounds that cross the plane:
                // its part on the other side came out empty.
                if strictly_inside(bounds, decision.axis, decision.position) {
                    if parameters.clip == 1u {
                        let corners = corners_of(reference.triangle);
                        parts = clip(corners, bounds, decision.axis, decision.position);
                    } else {
                        parts.left.hi = with_axis(bounds.hi, decision.axis, decision.position);
                        parts.right.lo = with_axis(bounds.lo, decision.axis, decision.position);
                    }
                }
                let offsets = load_counts(index);
                if goes(0u, lane) {
                    left_bounds = parts.left;
                    let place = decision.first.x + offsets.x + rank(0u, lane);
                    store(decision.counts.x, place, parts.left, reference.triangle);
                }
                if goes(1u, lane) {
                    right_bounds = parts.right;
                    let place = decision.first.y + offsets.y + rank(1u, lane);
                    store(decision.counts.y, place, parts.right, reference.triangle);
                }
            }
        }
        // Nobody reads the last chunk's any more: two barriers stand above.
        put_bounds(lane, 0u, left_bounds);
        put_bounds(lane, 1u, right_bounds);
        reduce_boxes(lane);
        store_reduced_bounds(index, lane);
    }
}

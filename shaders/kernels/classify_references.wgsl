// Finds the sides each reference goes to and counts them by chunk.
// One workgroup a chunk, one invocation a reference; then one invocation each of those that may be cut.
// Reads: decisions, references, corners of those whose bounds a plane cuts where they are clipped.
// Writes: the sides of each reference, and how many of the chunk's go to each; adds these to what the node's decision and the first
// chunk of the span count: whole numbers, whose sums do not depend on order.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
// Chunk and Decision, word by word.
@group(0) @binding(2) var<storage, read_write> chunks: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> decisions: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read> references: array<Reference>;
@group(0) @binding(5) var<storage, read> triangles: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> chunk_state: array<u32>;

const DECISION_WORDS: u32 = 16u;
const DECISION_AXIS: u32 = 8u;
const DECISION_POSITION: u32 = 9u;
const DECISION_COUNTS: u32 = 10u;
const DECISION_SOURCE_FIRST: u32 = 15u;
const CHUNK_WORDS: u32 = 4u;
const CHUNK_SPAN_SIDES: u32 = 3u;

// The lanes whose references' bounds straddle the plane, where references are clipped. Their order may differ from run to
// run; nothing depends on it.
var<workgroup> open_lanes: array<u32, CHUNK>;
var<workgroup> open_count: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(active_chunk_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let own = CHUNK_WORDS * index;
        let first = atomicLoad(&chunks[own + 1u]);
        let count = atomicLoad(&chunks[own + 2u]);
        let decision = DECISION_WORDS * atomicLoad(&chunks[own]);
        let axis = atomicLoad(&decisions[decision + DECISION_AXIS]);
        let position = bitcast<f32>(atomicLoad(&decisions[decision + DECISION_POSITION]));
        if lane == 0u {
            atomicStore(&open_count, 0u);
        }
        workgroupBarrier();
        var left = false;
        var right = false;
        if lane < count {
            if axis == TRANSFER {
                left = true;
            } else {
                let reference = references[first + lane];
                let lo = on_axis(reference.lo, axis);
                let hi = on_axis(reference.hi, axis);
                left = goes_left(lo, hi, position);
                right = goes_right(hi, position);
                if left && right && parameters.clip == 1u {
                    // The bounds straddle the plane, but what is left of the triangle may not.
                    open_lanes[atomicAdd(&open_count, 1u)] = lane;
                    left = false;
                    right = false;
                }
            }
        }
        ballot(lane, left, right);
        if lane < atomicLoad(&open_count) {
            let source = open_lanes[lane];
            let reference = references[first + source];
            let corners = corners_of(reference.triangle);
            let bounds = Aabb(reference.lo, reference.hi);
            var both = vec2<bool>(true);
            if !corners_on_both_sides(corners, bounds, axis, position) {
                let parts = clip(corners, bounds, axis, position);
                both = vec2<bool>(!is_empty(parts.left), !is_empty(parts.right));
            }
            let bit = 1u << (source % 32u);
            if both.x {
                atomicOr(&ballot_words[source / 32u], bit);
            }
            if both.y {
                atomicOr(&ballot_words[8u + source / 32u], bit);
            }
        }
        workgroupBarrier();
        if lane < 16u {
            chunk_state[sides_of(index) + lane] = atomicLoad(&ballot_words[lane]);
        }
        // The counts of both sides.
        if lane < 2u {
            let count = ballot_count(lane);
            chunk_state[2u * index + lane] = count;
            if axis != TRANSFER {
                let place = (first - atomicLoad(&decisions[decision + DECISION_SOURCE_FIRST])) / CHUNK;
                let span = CHUNK_WORDS * (index - place % SPAN);
                atomicAdd(&decisions[decision + DECISION_COUNTS + lane], count);
                atomicAdd(&chunks[span + CHUNK_SPAN_SIDES], count << (16u * lane));
            }
        }
    }
}

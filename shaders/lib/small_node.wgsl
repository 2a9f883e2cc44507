// The small-node stage of Zhou et al. 2008: the subtree of one small root, built by a workgroup of 64
// invocations in workgroup memory, one invocation a triangle. Twin of backend-cpu's build_small.rs.
//
// Candidates are the faces of the references' bounds as they stand in the root. A candidate counts
// only where its own triangle is in the node and the plane lies strictly inside. The masks of all candidates
// lie in workgroup memory. Depth first, left before right.
//
// The kernel says what becomes of nodes and references: `put_node`, `put_right`, `put_reference`.
// Needs the bindings `parameters` and `small_references`.

const MAX_DEPTH: u32 = 96u;
const SMALL_ROOT_NODES: u32 = 511u;
const SMALL_ROOT_REFERENCES: u32 = 1023u;

// A node not yet decided. 40 bytes of payload.
struct Pending {
    lo: vec3<f32>,
    mask_low: u32,
    hi: vec3<f32>,
    mask_high: u32,
    depth: u32,
    // The interior node whose right child this is, and its axis below; NO_PARENT for a left child.
    parent: u32,
}

const NO_PARENT: u32 = 0xffffffffu;

var<workgroup> bounds_lo: array<vec3<f32>, 64>;
var<workgroup> bounds_hi: array<vec3<f32>, 64>;
var<workgroup> stack: array<Pending, MAX_DEPTH>;
// The current node.
var<workgroup> pending: Pending;
var<workgroup> stack_top: u32;
// Emitted so far.
var<workgroup> emitted: vec2<u32>;
// Allocated so far, those pending included: what the caps of a root count.
var<workgroup> allocated: vec2<u32>;
// 1 while nodes are pending.
var<workgroup> running: u32;
// The least rank among candidates, word by word.
var<workgroup> best_cost: atomic<u32>;
var<workgroup> best_axis: atomic<u32>;
var<workgroup> best_order: atomic<u32>;
// The masks of the six candidate planes of every invocation, those of the low face of an axis before those of the high
// one: left low, left high, right low, right high. In registers they would leave room for half as many workgroups.
var<workgroup> plane_sides: array<vec4<u32>, 384>;
// The masks of the chosen plane: left low, left high, right low, right high.
var<workgroup> chosen: array<atomic<u32>, 4>;

// The masks of an invocation's six planes, one word of each: of the planes at the low faces of its bounds and of those
// at the high faces, by axis.
struct PlaneMasks {
    low_left: vec3<u32>,
    low_right: vec3<u32>,
    high_left: vec3<u32>,
    high_right: vec3<u32>,
}

// Which of the references from `first` to below `end`, at most 32, go to which side of the planes at `lo` and `hi`
// (Zhou et al. 2008, small-node stage). One loop for all twelve masks, since the bounds are what it waits for.
fn masks_of_planes(lo: vec3<f32>, hi: vec3<f32>, first: u32, end: u32) -> PlaneMasks {
    var masks: PlaneMasks;
    for (var i = first; i < end; i++) {
        let other_lo = bounds_lo[i];
        let other_hi = bounds_hi[i];
        let bit = vec3<u32>(1u << (i - first));
        let none = vec3<u32>();
        // `goes_left` and `goes_right` on three axes at once.
        masks.low_left |= select(none, bit, (other_lo < lo) | (other_hi <= lo));
        masks.low_right |= select(none, bit, other_hi > lo);
        masks.high_left |= select(none, bit, (other_lo < hi) | (other_hi <= hi));
        masks.high_right |= select(none, bit, other_hi > hi);
    }
    return masks;
}

fn count_mask(mask: vec2<u32>) -> u32 {
    return countOneBits(mask.x) + countOneBits(mask.y);
}

// Whether triangle `index` is in the set.
fn contains(mask: vec2<u32>, index: u32) -> bool {
    return ((select(mask.x, mask.y, index >= 32u) >> (index % 32u)) & 1u) == 1u;
}

// How many triangles of the set stand before `index`.
fn rank_in(mask: vec2<u32>, index: u32) -> u32 {
    let below = (1u << (index % 32u)) - 1u;
    if index < 32u {
        return countOneBits(mask.x & below);
    }
    return countOneBits(mask.x) + countOneBits(mask.y & below);
}

// The first `count` triangles.
fn first_mask(count: u32) -> vec2<u32> {
    let low = select((1u << count) - 1u, 0xffffffffu, count >= 32u);
    let high = select((1u << (max(count, 32u) - 32u)) - 1u, 0xffffffffu, count >= 64u);
    return vec2<u32>(low, high);
}

// A candidate's rank: cost, axis, position in order.
struct Candidate {
    cost: u32,
    axis: u32,
    order: u32,
}

fn precedes(a: Candidate, b: Candidate) -> bool {
    if a.cost != b.cost {
        return a.cost < b.cost;
    }
    if a.axis != b.axis {
        return a.axis < b.axis;
    }
    return a.order < b.order;
}

// The candidate of one face, whose masks are at `place`, if it counts and is better than `best`.
fn consider(
    best: Candidate,
    place: u32,
    axis: u32,
    position: f32,
    mask: vec2<u32>,
    cell: Aabb,
    extents: Extents,
    area: u32,
) -> Candidate {
    if !strictly_inside(cell, axis, position) {
        return best;
    }
    let sides = plane_sides[place];
    let left = blocks(count_mask(sides.xy & mask));
    let right = blocks(count_mask(sides.zw & mask));
    let offset = quantised_offset(extents, on_axis(cell.lo, axis), position);
    let areas = split_areas(extents, axis, offset);
    let cost = parameters.traversal_cost * area
        + parameters.intersection_cost * (left * areas.x + right * areas.y);
    let here = Candidate(cost, axis, ordered_bits(position));
    if precedes(here, best) {
        return here;
    }
    return best;
}

// The float of these ordered bits.
fn from_ordered_bits(order: u32) -> f32 {
    return bitcast<f32>(select(~order, order & 0x7fffffffu, (order >> 31u) == 1u));
}

// The references that a dispatch sees, where one binding does not hold all: those of the first half or of the second.
// A root of at most T references is worked on where its first reference is; the binding reaches so far beyond its
// half that it holds the others too. Without halves the first has all.
fn first_seen() -> u32 {
    return select(0u, parameters.small_reference_half, (parameters.view & 1u) != 0u);
}

fn end_seen() -> u32 {
    return select(parameters.small_reference_half, 0xffffffffu, (parameters.view & 1u) != 0u);
}

// Whether a root's first reference is seen.
fn begins_here(root: SmallRoot) -> bool {
    return root.first >= first_seen() && root.first < end_seen();
}

// Whether a dispatch works on a root: of a leaf too large to split it sees a part.
fn is_seen(root: SmallRoot) -> bool {
    return begins_here(root) || root.count > parameters.small_node_limit;
}

// Builds the subtree of a root and returns how many nodes and references it has. All 64 invocations
// must call it.
fn build_subtree(root: SmallRoot, lane: u32) -> vec2<u32> {
    if root.count > parameters.small_node_limit {
        // A leaf too large to split.
        let end = min(root.first + root.count, end_seen());
        for (var place = max(root.first, first_seen()) + lane; place < end; place += 64u) {
            put_reference(place - root.first, small_references[place - first_seen()].triangle);
        }
        if lane == 0u && begins_here(root) {
            put_node(0u, vec2<u32>(0u, (root.count << 2u) | 3u));
        }
        return vec2<u32>(1u, root.count);
    }
    workgroupBarrier();
    var triangle = 0u;
    if lane < root.count {
        let reference = small_references[root.first + lane - first_seen()];
        triangle = reference.triangle;
        bounds_lo[lane] = reference.lo;
        bounds_hi[lane] = reference.hi;
    }
    if lane == 0u {
        let mask = first_mask(root.count);
        pending = Pending(root.lo, mask.x, root.hi, mask.y, root.depth, NO_PARENT);
        stack_top = 0u;
        emitted = vec2<u32>(0u);
        allocated = vec2<u32>(1u, root.count);
    }
    workgroupBarrier();
    var lo = vec3<f32>(0.0);
    var hi = vec3<f32>(0.0);
    if lane < root.count {
        lo = bounds_lo[lane];
        hi = bounds_hi[lane];
        // The first 32 references, and the others.
        let near = masks_of_planes(lo, hi, 0u, min(root.count, 32u));
        let rest = masks_of_planes(lo, hi, 32u, root.count);
        for (var axis = 0u; axis < 3u; axis++) {
            let place = 2u * axis * 64u + lane;
            plane_sides[place] = vec4<u32>(
                near.low_left[axis], rest.low_left[axis], near.low_right[axis], rest.low_right[axis]);
            plane_sides[place + 64u] = vec4<u32>(
                near.high_left[axis], rest.high_left[axis], near.high_right[axis], rest.high_right[axis]);
        }
    }
    loop {
        let node = pending;
        let mask = vec2<u32>(node.mask_low, node.mask_high);
        let cell = Aabb(node.lo, node.hi);
        let count = count_mask(mask);
        let extents = extents_of(cell);
        let area = half_area(extents.cells);
        let leaf_cost = parameters.intersection_cost * blocks(count) * area;
        let open = count > 0u && node.depth < parameters.max_depth && extents.large_enough
            && leaf_cost > parameters.traversal_cost * area;
        // Only what costs less than a leaf counts: no candidate has this cost, axis and position.
        let none = Candidate(leaf_cost, 0u, 0u);
        var best = none;
        if open && contains(mask, lane) {
            for (var plane = 0u; plane < 6u; plane++) {
                let axis = plane / 2u;
                let position = on_axis(select(lo, hi, plane % 2u == 1u), axis);
                best = consider(best, plane * 64u + lane, axis, position, mask, cell, extents, area);
            }
        }
        if lane == 0u {
            atomicStore(&best_cost, leaf_cost);
            atomicStore(&best_axis, 3u);
            atomicStore(&best_order, 0xffffffffu);
        }
        if lane < 4u {
            atomicStore(&chosen[lane], 0u);
        }
        workgroupBarrier();
        // Word by word: minima of integers do not depend on order.
        if best.cost < leaf_cost {
            atomicMin(&best_cost, best.cost);
        }
        workgroupBarrier();
        let least_cost = atomicLoad(&best_cost);
        if best.cost < leaf_cost && best.cost == least_cost {
            atomicMin(&best_axis, best.axis);
        }
        workgroupBarrier();
        let axis = atomicLoad(&best_axis);
        if best.cost < leaf_cost && best.cost == least_cost && best.axis == axis {
            atomicMin(&best_order, best.order);
        }
        workgroupBarrier();
        let position = from_ordered_bits(atomicLoad(&best_order));
        let found = axis < 3u;
        if found && contains(mask, lane) {
            let bit = 1u << (lane % 32u);
            let word = lane / 32u;
            if goes_left(on_axis(lo, axis), on_axis(hi, axis), position) {
                atomicOr(&chosen[word], bit);
            }
            if goes_right(on_axis(hi, axis), position) {
                atomicOr(&chosen[2u + word], bit);
            }
        }
        workgroupBarrier();
        let left = vec2<u32>(atomicLoad(&chosen[0]), atomicLoad(&chosen[1]));
        let right = vec2<u32>(atomicLoad(&chosen[2]), atomicLoad(&chosen[3]));
        let after = allocated.y + count_mask(left) + count_mask(right) - count;
        let splits = found && allocated.x + 2u <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES;
        let index = emitted.x;
        let first = emitted.y;
        if !splits && contains(mask, lane) {
            put_reference(first + rank_in(mask, lane), triangle);
        }
        workgroupBarrier();
        if lane == 0u {
            if node.parent != NO_PARENT {
                put_right(node.parent >> 2u, node.parent & 3u, index);
            }
            running = 1u;
            if splits {
                allocated = vec2<u32>(allocated.x + 2u, after);
                put_node(index, vec2<u32>(bitcast<u32>(position), axis));
                var right_lo = with_axis(cell.lo, axis, position);
                stack[stack_top] = Pending(
                    right_lo, right.x, cell.hi, right.y, node.depth + 1u, (index << 2u) | axis);
                stack_top += 1u;
                pending = Pending(
                    cell.lo, left.x, with_axis(cell.hi, axis, position), left.y, node.depth + 1u, NO_PARENT);
            } else {
                put_node(index, vec2<u32>(first, (count << 2u) | 3u));
                emitted.y += count;
                if stack_top == 0u {
                    running = 0u;
                } else {
                    stack_top -= 1u;
                    pending = stack[stack_top];
                }
            }
            emitted.x += 1u;
        }
        if workgroupUniformLoad(&running) == 0u {
            break;
        }
    }
    // A driver may end the loop early (see split_median.wgsl). The zero keeps a compiler from concluding
    // that it does not.
    if (running ^ opaque_zero) != 0u {
        return vec2<u32>(0xffffffffu);
    }
    return emitted;
}

// Splits what the levels have handed over until it has T references or cannot be split.
// One workgroup a middle root, all levels of its tree in turn; one invocation a node where it is decided, as many
// references for each where they are looked at and moved.
// Reads: what was handed over and its references; corners of those that a plane cuts where they are clipped.
// Writes: the tree of each root, its leaves and their references; what the root has counted.
// Ties: axes in order, then lower positions.
//
// References of levels and leaves lie in parts of a pool that are taken as they are needed, in any order: nothing depends
// on where. The nodes of a level and of the next stand behind the leaves, every second place each.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> small_roots: array<SmallRoot>;
@group(0) @binding(3) var<storage, read> small_references: array<Reference>;
@group(0) @binding(4) var<storage, read> triangles: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> middle_roots: array<MiddleRoot>;
@group(0) @binding(6) var<storage, read_write> middle_references: array<Reference>;
@group(0) @binding(7) var<storage, read_write> middle_nodes: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> middle_leaves: array<SmallRoot>;

const LANES: u32 = 256u;
const SWEEP_SAMPLES: u32 = 64u;
// In place of an axis: the node is to be swept.
const TO_BE_SWEPT: u32 = 4u;
// In place of a next node: the child is none.
const NO_NEXT: u32 = 0xffu;
// What `outgrown` says: the rules of the stage, a list of the device, a loop that a driver ended.
const OUTGROWN_RULES: u32 = 1u;
const OUTGROWN_ROOM: u32 = 2u;
const OUTGROWN_UNFINISHED: u32 = 4u;

// What a root's invocations share of it: in registers it would stand in the way of clipping.
struct Root {
    first: u32,
    count: u32,
    node: u32,
    level: u32,
    // Where its regions begin, and end.
    first_node: u32,
    first_leaf: u32,
    end_node: u32,
    end_leaf: u32,
}
var<workgroup> own: Root;
// The level: its nodes, its references, and where these begin.
var<workgroup> node_count: u32;
var<workgroup> reference_count: u32;
var<workgroup> source: u32;
// Parts of the pool for the references of levels, by turns, and how many each holds.
var<workgroup> list_first: array<u32, 2>;
var<workgroup> list_room: array<u32, 2>;
// Where the references of this level's leaves begin in the pool.
var<workgroup> leaf_source: u32;
// A part of the pool for both parts of each reference that the level's planes cut, and how many references it is for.
var<workgroup> cut_first: u32;
var<workgroup> cut_room: u32;
// So far: nodes of the tree, leaves and their references.
var<workgroup> emitted: u32;
var<workgroup> leaves: u32;
var<workgroup> leaf_references: u32;
var<workgroup> growth: atomic<u32>;
var<workgroup> outgrown: atomic<u32>;
// The first node of the level that is still to be swept; NO_NODE if there is none.
var<workgroup> swept: atomic<u32>;
// Copies of what atomics hold, for decisions that all invocations share.
var<workgroup> swept_now: u32;
var<workgroup> outgrown_now: u32;
// By node of the level: its first reference, and behind the last node the end of all; tight bounds in order, its cuts and
// plane, where children get references.
var<workgroup> first: array<u32, ACTIVE_NODES + 1u>;
// Which next nodes its children are, 8 bits each, NO_NEXT for leaves.
var<workgroup> children: array<u32, ACTIVE_NODES>;
var<workgroup> tight: array<atomic<u32>, 6u * ACTIVE_NODES>;
var<workgroup> plane_axis: array<u32, ACTIVE_NODES>;
var<workgroup> plane_position: array<f32, ACTIVE_NODES>;
var<workgroup> places: array<vec2<u32>, ACTIVE_NODES>;
// By 32 references of the level, a bit each: those that begin a node, those that its plane cuts, those that go left, and
// right.
var<workgroup> marks: array<atomic<u32>, 1024>;
const STARTS: u32 = 0u;
const CUTS: u32 = 256u;
const LEFTS: u32 = 512u;
const RIGHTS: u32 = 768u;
// A sweep counts here what is on the two sides of the faces of its samples: left in the low half, right in the high one.
const SWEEP_SIDES: u32 = LEFTS;
const SWEEP_FACES: u32 = 384u;
// How many there are before these 32: nodes in the low 8 bits, cut ones above; left in the low half, right in the high one.
var<workgroup> starts_before: array<u32, 256>;
var<workgroup> sides_before: array<u32, 257>;

// The best plane of a sweep, word by word.
var<workgroup> best_high: atomic<u32>;
var<workgroup> best_low: atomic<u32>;
var<workgroup> best_axis: atomic<u32>;
var<workgroup> best_order: atomic<u32>;

var<private> cut_short: bool;

// The references of the level, those handed over or those in the pool.
fn level_reference(handed: bool, i: u32) -> Reference {
    if handed {
        return small_references[source + i];
    }
    return middle_references[source + i];
}

// The first reference of an invocation's share of the level: as many in a row each, whichever nodes they belong to.
fn share_start(lane: u32) -> u32 {
    return min(lane * ((reference_count + LANES - 1u) / LANES), reference_count);
}

// The node of the level that a reference belongs to.
fn node_of(i: u32) -> u32 {
    let upto = 0xffffffffu >> (31u - i % 32u);
    let here = countOneBits(atomicLoad(&marks[STARTS + i / 32u]) & upto);
    return (starts_before[i / 32u] & 0xffu) + here - 1u;
}

// How many of the references before one are cut.
fn cuts_before(i: u32) -> u32 {
    let below = (1u << (i % 32u)) - 1u;
    return (starts_before[i / 32u] >> 8u) + countOneBits(atomicLoad(&marks[CUTS + i / 32u]) & below);
}

// How many of the references before one go left, and right.
fn before(i: u32) -> vec2<u32> {
    let word = i / 32u;
    let sums = sides_before[word];
    var here = vec2<u32>(sums & 0xffffu, sums >> 16u);
    if i % 32u != 0u {
        let below = (1u << (i % 32u)) - 1u;
        here += vec2<u32>(
            countOneBits(atomicLoad(&marks[LEFTS + word]) & below),
            countOneBits(atomicLoad(&marks[RIGHTS + word]) & below),
        );
    }
    return here;
}

fn from_order(order: u32) -> f32 {
    return bitcast<f32>(select(~order, order & 0x7fffffffu, (order >> 31u) == 1u));
}

// The place of a node of a level among the leaves. `turn` is 0 and 1 by turns.
fn slot(node: u32, turn: u32) -> u32 {
    return own.end_leaf - 1u - 2u * node - turn;
}

fn put_node(place: u32, node: TopNode) {
    let at = 4u * place;
    atomicStore(&middle_nodes[at], node.kind);
    atomicStore(&middle_nodes[at + 1u], node.split);
    atomicStore(&middle_nodes[at + 2u], node.left);
    atomicStore(&middle_nodes[at + 3u], node.right);
}

// A part of the pool. What does not fit is not written.
fn take(size: u32) -> u32 {
    let begin = atomicAdd(&middle_nodes[0], size);
    if begin + size > parameters.middle_reference_room || begin + size < begin {
        atomicOr(&outgrown, OUTGROWN_ROOM);
    }
    return begin;
}

// What is left of a cell when the empty space on a side is cut off.
fn cut_off(cell: Aabb, bounds: Aabb, side: u32) -> Aabb {
    var rest = cell;
    let axis = side / 2u;
    if side % 2u == 0u {
        rest.lo = with_axis(cell.lo, axis, on_axis(bounds.lo, axis));
    } else {
        rest.hi = with_axis(cell.hi, axis, on_axis(bounds.hi, axis));
    }
    return rest;
}

fn tight_bounds(node: u32) -> Aabb {
    let at = 6u * node;
    return Aabb(
        vec3<f32>(
            from_order(atomicLoad(&tight[at])),
            from_order(atomicLoad(&tight[at + 1u])),
            from_order(atomicLoad(&tight[at + 2u])),
        ),
        vec3<f32>(
            from_order(atomicLoad(&tight[at + 3u])),
            from_order(atomicLoad(&tight[at + 4u])),
            from_order(atomicLoad(&tight[at + 5u])),
        ),
    );
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(middle_root_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        workgroupBarrier();
        let levels = build(index, lane);
        workgroupBarrier();
        if lane == 0u {
            // A driver may end a loop early (see split_median.wgsl). The zero keeps a compiler from concluding that it
            // does not.
            if (node_count ^ opaque_zero) != 0u && atomicLoad(&outgrown) == 0u {
                atomicStore(&outgrown, OUTGROWN_UNFINISHED);
            }
            let state = atomicLoad(&outgrown);
            var middle = MiddleRoot(
                own.node, own.first, own.count, own.level + levels, emitted, leaves, leaf_references,
                atomicLoad(&growth), 0u, 0u, state, 0u);
            if state != 0u {
                middle = MiddleRoot(own.node, own.first, own.count, 0u, 0u, 0u, 0u, 0u, 0u, 0u, state, 0u);
            }
            middle_roots[index] = middle;
        }
    }
}

// Builds the tree of a root. Returns how many levels it has. All invocations must call it.
fn build(index: u32, lane: u32) -> u32 {
    if lane == 0u {
        let root = small_roots[index];
        own = Root(
            root.first, root.count, root.node, root.level,
            first_middle_node(root.first, index), first_middle_leaf(root.first, index),
            first_middle_node(root.first + root.count, index + 1u),
            first_middle_leaf(root.first, index) + root.count / 4u + 64u);
        atomicStore(&growth, 0u);
        atomicStore(&outgrown, 0u);
        outgrown_now = 0u;
        list_room = array<u32, 2>();
        list_first = array<u32, 2>();
        cut_room = 0u;
        cut_first = 0u;
        leaf_references = 0u;
        leaves = 0u;
        emitted = 1u;
        node_count = 0u;
        reference_count = root.count;
        source = root.first;
        leaf_source = 0u;
        if root.count > parameters.hand_over_limit {
            atomicStore(&outgrown, OUTGROWN_RULES);
        } else if own.end_node > parameters.middle_node_room || own.end_leaf > parameters.middle_leaf_room {
            atomicStore(&outgrown, OUTGROWN_ROOM);
        } else {
            put_node(own.first_node, TopNode(EMPTY, 0u, 0u, NO_NODE));
            if root.count <= parameters.small_node_limit {
                leaf_source = take(root.count);
                put_node(own.first_node, TopNode(SMALL_ROOT, 0u, 0u, NO_NODE));
                middle_leaves[own.first_leaf] = SmallRoot(
                    root.lo, 0u, root.hi, root.count, root.node, root.depth, root.level, leaf_source);
                leaf_references = root.count;
                leaves = 1u;
            } else {
                node_count = 1u;
                middle_leaves[slot(0u, 0u)] =
                    SmallRoot(root.lo, 0u, root.hi, root.count, 0u, root.depth, 0u, 0u);
            }
        }
    }
    storageBarrier();
    workgroupBarrier();
    if lane < own.count && own.count <= parameters.small_node_limit && atomicLoad(&outgrown) == 0u {
        middle_references[leaf_source + lane] = small_references[own.first + lane];
    }
    var levels = 0u;
    loop {
        let nodes = workgroupUniformLoad(&node_count);
        if nodes == 0u {
            break;
        }
        let handed = levels == 0u;
        let turn = levels % 2u;
        begin_level(turn, lane);
        if handed {
            bound_root(lane);
        }
        decide(turn, lane);
        while workgroupUniformLoad(&swept_now) != NO_NODE {
            sweep(handed, turn, lane);
        }
        divide(handed, lane);
        cut_references(handed, lane);
        let found = emit(nodes, turn, lane);
        levels += 1u;
        if workgroupUniformLoad(&outgrown_now) == 1u {
            break;
        }
        place_children(found, turn, lane);
        scatter(handed, nodes, lane);
        if lane == 0u {
            source = list_first[turn];
            node_count = found_nodes;
            reference_count = found_references;
        }
        storageBarrier();
        workgroupBarrier();
    }
    return levels;
}

// What the level leaves to the next one.
var<workgroup> found_nodes: u32;
var<workgroup> found_references: u32;

// Which references begin a node of the level.
fn begin_level(turn: u32, lane: u32) {
    let nodes = node_count;
    for (var word = lane; word < 1024u; word += LANES) {
        atomicStore(&marks[word], 0u);
    }
    if lane == 0u {
        atomicStore(&swept, NO_NODE);
        first[nodes] = reference_count;
    }
    workgroupBarrier();
    if lane < nodes {
        let begin = middle_leaves[slot(lane, turn)].first;
        first[lane] = begin;
        atomicOr(&marks[STARTS + begin / 32u], 1u << (begin % 32u));
    }
    workgroupBarrier();
    // How many nodes begin before these 32 references: nodes are in order.
    var before = 0u;
    for (var step = 64u; step > 0u; step /= 2u) {
        let last = before + step;
        // No more than there are, so that the place is one of the list.
        if last <= nodes && first[min(last, ACTIVE_NODES) - 1u] < 32u * lane {
            before = last;
        }
    }
    starts_before[lane] = before;
    workgroupBarrier();
}

// Bounds that hold nothing, of this many nodes. All invocations must call it.
fn clear_bounds(nodes: u32, lane: u32) {
    for (var i = lane; i < 6u * nodes; i += LANES) {
        atomicStore(&tight[i], select(0u, 0xffffffffu, i % 6u < 3u));
    }
    workgroupBarrier();
}

// Widens the tight bounds of a node.
fn widen(node: u32, bounds: Aabb) {
    let at = 6u * node;
    atomicMin(&tight[at], ordered_bits(bounds.lo.x));
    atomicMin(&tight[at + 1u], ordered_bits(bounds.lo.y));
    atomicMin(&tight[at + 2u], ordered_bits(bounds.lo.z));
    atomicMax(&tight[at + 3u], ordered_bits(bounds.hi.x));
    atomicMax(&tight[at + 4u], ordered_bits(bounds.hi.y));
    atomicMax(&tight[at + 5u], ordered_bits(bounds.hi.z));
}

// The tight bounds of the root. Those of other nodes are known when their references are moved.
fn bound_root(lane: u32) {
    clear_bounds(1u, lane);
    var bounds = empty_aabb();
    for (var i = lane; i < reference_count; i += LANES) {
        let reference = small_references[source + i];
        bounds = joined(bounds, reference);
    }
    if lane < reference_count {
        widen(0u, bounds);
    }
    workgroupBarrier();
}

// The plane of each node of the level, an invocation a node.
fn decide(turn: u32, lane: u32) {
    if lane < node_count {
        let node = middle_leaves[slot(lane, turn)];
        let rest = without_empty_space(Aabb(node.lo, node.hi), tight_bounds(lane));
        let levels_left = parameters.max_depth - node.depth;
        // Its cuts, until its children have places.
        places[lane] = vec2<u32>(first_sides(rest.sides, levels_left), 0u);
        let splits = countOneBits(rest.sides) < levels_left;
        var plane = no_plane();
        if splits && node.padding == 0u {
            plane = spatial_median(rest.cell);
        }
        plane_axis[lane] = select(TRANSFER, plane.axis, plane.found);
        plane_position[lane] = select(0.0, plane.position, plane.found);
        if splits && node.padding == 1u {
            plane_axis[lane] = TO_BE_SWEPT;
            atomicMin(&swept, lane);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        swept_now = atomicLoad(&swept);
    }
}

// That the median does not separate does not mean that no plane does: the best plane by SAH among the faces of up to 64
// references, evenly spread over the node's. One node at a time.
fn sweep(handed: bool, turn: u32, lane: u32) {
    let place = swept_now;
    let node = middle_leaves[slot(place, turn)];
    let cell = without_empty_space(Aabb(node.lo, node.hi), tight_bounds(place)).cell;
    let extents = extents_of(cell);
    let begin = first[place];
    let size = first[place + 1u] - begin;
    let samples = min(size, SWEEP_SAMPLES);
    if lane == 0u {
        atomicStore(&best_high, 0xffffffffu);
        atomicStore(&best_low, 0xffffffffu);
        atomicStore(&best_axis, TRANSFER);
        atomicStore(&best_order, 0xffffffffu);
        atomicStore(&swept, NO_NODE);
    }
    workgroupBarrier();
    // Four invocations a sample, a quarter of the references each.
    let sample = lane / 4u;
    if sample < samples {
        let faces = level_reference(handed, begin + sample * size / samples);
        var low = vec3<u32>(0u);
        var high = vec3<u32>(0u);
        for (var i = lane % 4u; i < size; i += 4u) {
            let other = level_reference(handed, begin + i);
            low += sides_of_planes(other, faces.lo);
            high += sides_of_planes(other, faces.hi);
        }
        for (var axis = 0u; axis < 3u; axis++) {
            atomicAdd(&marks[SWEEP_SIDES + 6u * sample + axis], low[axis]);
            atomicAdd(&marks[SWEEP_SIDES + 6u * sample + 3u + axis], high[axis]);
        }
    }
    workgroupBarrier();
    // The cost of a leaf comes before every plane: only what costs less counts.
    let leaf_cost = wide_product(half_area(extents.cells), size);
    var cost = leaf_cost;
    var axis = TRANSFER;
    var order = 0xffffffffu;
    for (var face = lane; face < 6u * samples; face += LANES) {
        let here = level_reference(handed, begin + (face / 6u) * size / samples);
        let on = face % 3u;
        let position = on_axis(select(here.lo, here.hi, face % 6u >= 3u), on);
        if strictly_inside(cell, on, position) && extents.large_enough {
            let sides = atomicLoad(&marks[SWEEP_SIDES + face]);
            let offset = quantised_offset(extents, on_axis(cell.lo, on), position);
            let areas = split_areas(extents, on, offset);
            let sum = wide_sum(wide_product(areas.x, sides & 0xffffu), wide_product(areas.y, sides >> 16u));
            let equal = all(sum == cost);
            let earlier = on < axis || (on == axis && ordered_bits(position) < order);
            if wide_less(sum, cost) || (equal && axis < TRANSFER && earlier) {
                cost = sum;
                axis = on;
                order = ordered_bits(position);
            }
        }
    }
    let found = axis < TRANSFER;
    if found {
        atomicMin(&best_high, cost.y);
    }
    workgroupBarrier();
    let is_high = found && cost.y == atomicLoad(&best_high);
    if is_high {
        atomicMin(&best_low, cost.x);
    }
    workgroupBarrier();
    let is_low = is_high && cost.x == atomicLoad(&best_low);
    if is_low {
        atomicMin(&best_axis, axis);
    }
    workgroupBarrier();
    if is_low && axis == atomicLoad(&best_axis) {
        atomicMin(&best_order, order);
    }
    workgroupBarrier();
    if lane == 0u {
        let best = atomicLoad(&best_axis);
        plane_axis[place] = best;
        plane_position[place] = select(0.0, from_order(atomicLoad(&best_order)), best < TRANSFER);
    }
    for (var face = lane; face < SWEEP_FACES; face += LANES) {
        atomicStore(&marks[SWEEP_SIDES + face], 0u);
    }
    workgroupBarrier();
    if lane < node_count && plane_axis[lane] == TO_BE_SWEPT {
        atomicMin(&swept, lane);
    }
    workgroupBarrier();
    if lane == 0u {
        swept_now = atomicLoad(&swept);
    }
}

// On which sides of three planes a reference is: left in the low half, right in the high one.
fn sides_of_planes(reference: Reference, planes: vec3<f32>) -> vec3<u32> {
    let none = vec3<u32>(0u);
    return select(none, vec3<u32>(1u), (reference.lo < planes) | (reference.hi <= planes))
        + select(none, vec3<u32>(0x10000u), reference.hi > planes);
}

// The sides of the references that are on one side of their node's plane, and which ones the plane cuts.
fn divide(handed: bool, lane: u32) {
    workgroupBarrier();
    var i = share_start(lane);
    let end = share_start(lane + 1u);
    var node = 0u;
    if i < end {
        node = node_of(i);
    }
    var left = 0u;
    var right = 0u;
    var bit = 1u << (i % 32u);
    while i < end {
        let last = min(end, first[node + 1u]);
        let axis = plane_axis[node];
        let position = plane_position[node];
        for (; i < last; i++) {
            var sides = vec2<bool>(true, false);
            if axis != TRANSFER {
                let reference = level_reference(handed, i);
                let hi = on_axis(reference.hi, axis);
                let up = goes_right(hi, position);
                sides = vec2<bool>((on_axis(reference.lo, axis) < position) | !up, up);
            }
            left |= select(0u, bit, sides.x);
            right |= select(0u, bit, sides.y);
            bit <<= 1u;
            if bit == 0u {
                mark_sides(i / 32u, left, right);
                left = 0u;
                right = 0u;
                bit = 1u;
            }
        }
        node += 1u;
    }
    if (left | right) != 0u {
        mark_sides((i - 1u) / 32u, left, right);
    }
    workgroupBarrier();
}

// What seems to go to both sides is to be looked at.
fn mark_sides(word: u32, left: u32, right: u32) {
    let both = left & right;
    mark(CUTS, word, both);
    mark(LEFTS, word, left ^ both);
    mark(RIGHTS, word, right ^ both);
}

fn mark(kind: u32, word: u32, bits: u32) {
    if bits != 0u {
        atomicOr(&marks[kind + word], bits);
    }
}

// Cuts the references that planes cut, as many for each invocation, and says where their parts go. How many there are
// before each 32.
fn cut_references(handed: bool, lane: u32) {
    let cuts = countOneBits(atomicLoad(&marks[CUTS + lane]));
    let upto = inclusive_scan(lane, vec2<u32>(cuts, 0u)).x;
    starts_before[lane] |= (upto - cuts) << 8u;
    let total = scan_sum().x;
    if lane == 0u {
        if total > cut_room {
            cut_room = total + total / 4u;
            cut_first = take(2u * cut_room);
        }
        outgrown_now = select(0u, 1u, atomicLoad(&outgrown) != 0u);
    }
    let room = workgroupUniformLoad(&outgrown_now) == 0u;
    let share = (total + LANES - 1u) / LANES;
    var k = min(lane * share, total);
    let end = min(k + share, total);
    if room && k < end {
        // The last word with no more than k before it, and in it the next bit.
        var word = 0u;
        for (var step = 128u; step > 0u; step /= 2u) {
            word += select(0u, step, (starts_before[word + step] >> 8u) <= k);
        }
        var bits = atomicLoad(&marks[CUTS + word]);
        for (var skipped = starts_before[word] >> 8u; skipped < k; skipped++) {
            bits &= bits - 1u;
        }
        while k < end {
            if bits == 0u {
                word += 1u;
                bits = atomicLoad(&marks[CUTS + word]);
            } else {
                cut_reference(handed, 32u * word + firstTrailingBit(bits), k);
                bits &= bits - 1u;
                k += 1u;
            }
        }
    }
    storageBarrier();
    workgroupBarrier();
    let lefts = countOneBits(atomicLoad(&marks[LEFTS + lane]));
    let here = lefts | (countOneBits(atomicLoad(&marks[RIGHTS + lane])) << 16u);
    let sum = inclusive_scan(lane, vec2<u32>(here, 0u)).x;
    sides_before[lane] = sum - here;
    if lane == 255u {
        sides_before[256] = sum;
    }
    workgroupBarrier();
}

// The parts of a reference whose bounds are on both sides of its node's plane. What is left of the triangle may not be.
fn cut_reference(handed: bool, i: u32, k: u32) {
    var both = true;
    var edge = no_parts();
    if parameters.clip == 1u {
        let node = node_of(i);
        let reference = level_reference(handed, i);
        let corners = corners_of(reference.triangle);
        both = corners_on_both_sides(
            corners, Aabb(reference.lo, reference.hi), plane_axis[node], plane_position[node]);
        edge = clip_edges(corners, plane_axis[node], plane_position[node]);
    }
    // Read again: kept meanwhile it would take registers.
    let again = i ^ opaque_zero;
    let node = node_of(again);
    let reference = level_reference(handed, again);
    let parts = limited(edge, Aabb(reference.lo, reference.hi), plane_axis[node], plane_position[node]);
    let bit = 1u << (again % 32u);
    let place = cut_first + 2u * k;
    if both || !is_empty(parts.left) {
        middle_references[place] = Reference(parts.left.lo, reference.triangle, parts.left.hi, 0u);
        mark(LEFTS, again / 32u, bit);
    }
    if both || !is_empty(parts.right) {
        middle_references[place + 1u] = Reference(parts.right.lo, reference.triangle, parts.right.hi, 0u);
        mark(RIGHTS, again / 32u, bit);
    }
}

// What a node gives to the lists of its level, and before it all other nodes: references of next nodes and of leaves, next
// nodes, leaves, nodes of the tree.
struct Found {
    // Two numbers in the first word, 16 bits each; three in the second, 8, 8 and 16.
    packed: vec2<u32>,
    counts: vec2<u32>,
}

// Counts the children of the level, and takes parts of the pool for their references.
fn emit(nodes: u32, turn: u32, lane: u32) -> Found {
    var packed = vec2<u32>(0u);
    var counts = vec2<u32>(0u);
    if lane < node_count {
        let size = first[lane + 1u] - first[lane];
        let splits = plane_axis[lane] != TRANSFER;
        counts = before(first[lane + 1u]) - before(first[lane]);
        let cuts = countOneBits(places[lane].x);
        packed.y = (2u * cuts + select(0u, 2u, splits)) << 16u;
        for (var side = 0u; side < 2u; side++) {
            if splits && counts[side] > parameters.small_node_limit {
                packed += vec2<u32>(counts[side], 1u);
            } else if counts[side] > 0u {
                packed += vec2<u32>(counts[side] << 16u, 0x100u);
            }
        }
        if splits {
            atomicAdd(&growth, max(counts.x + counts.y, size) - size);
        }
    }
    let upto = inclusive_scan_of(nodes, lane, packed);
    let total = scan_sum_of(nodes);
    if lane == 0u {
        found_references = total.x & 0xffffu;
        found_nodes = total.y & 0xffu;
        let more_leaves = (total.y >> 8u) & 0xffu;
        let kept = own.first_leaf + leaves + more_leaves + 2u * max(node_count, found_nodes);
        let references = leaf_references + (total.x >> 16u);
        if found_references > LEVEL_REFERENCES || found_nodes > ACTIVE_NODES || kept > own.end_leaf
            || references > 8u * own.count + 256u
            || emitted + (total.y >> 16u) > own.count / 2u + 128u {
            atomicOr(&outgrown, OUTGROWN_RULES);
        } else {
            leaf_source = take(total.x >> 16u);
            if found_references > list_room[turn] {
                list_room[turn] = found_references + found_references / 4u;
                list_first[turn] = take(list_room[turn]);
            }
        }
        outgrown_now = select(0u, 1u, atomicLoad(&outgrown) != 0u);
    }
    return Found(upto - packed, counts);
}

// Writes the nodes that each node of the level emits, its leaves and the next nodes, and says where references go.
fn place_children(found: Found, turn: u32, lane: u32) {
    let first_node = own.first_node;
    if lane < node_count {
        let node = middle_leaves[slot(lane, turn)];
        let bounds = tight_bounds(lane);
        var cell = Aabb(node.lo, node.hi);
        var current = node.node;
        var depth = node.depth;
        var top = emitted + (found.packed.y >> 16u);
        var successor = atomicLoad(&middle_nodes[4u * (first_node + current) + 3u]);
        for (var cuts = places[lane].x; cuts != 0u; cuts &= cuts - 1u) {
            let side = firstTrailingBit(cuts);
            let low = side % 2u == 0u;
            let left = select(top + 1u, top, low);
            let right = select(top, top + 1u, low);
            let position = on_axis(select(bounds.hi, bounds.lo, vec3<bool>(low)), side / 2u);
            put_node(first_node + current, TopNode(side / 2u, bitcast<u32>(position), left, right));
            // The empty leaf comes first, whichever side it is on.
            put_node(first_node + top, TopNode(EMPTY, 0u, 0u, select(successor, right, low)));
            successor = select(left - 1u, successor, low);
            cell = cut_off(cell, bounds, side);
            current = top + 1u;
            top += 2u;
            depth += 1u;
        }
        let axis = plane_axis[lane];
        var place = vec4<u32>(
            found.packed.x & 0xffffu, found.packed.x >> 16u, found.packed.y & 0xffu, (found.packed.y >> 8u) & 0xffu);
        var next = vec2<u32>(NO_NEXT);
        if axis == TRANSFER {
            put_leaf(current, successor, Aabb(cell.lo, cell.hi), depth, node.count, place);
            places[lane] = vec2<u32>(leaf_source + place.y - before(first[lane]).x, 0u);
        } else {
            let position = plane_position[lane];
            put_node(first_node + current, TopNode(axis, bitcast<u32>(position), top, top + 1u));
            let rank = before(first[lane]);
            let inseparable = all(found.counts == vec2<u32>(node.count));
            // The zero keeps compilers from writing both out, which takes registers.
            for (var child = 0u; child < 2u + opaque_zero; child++) {
                var part = cell;
                if child == 0u {
                    part.hi = with_axis(cell.hi, axis, position);
                } else {
                    part.lo = with_axis(cell.lo, axis, position);
                }
                let own_successor = select(successor, top + 1u, child == 0u);
                let references = found.counts[child];
                if references > parameters.small_node_limit {
                    put_node(first_node + top + child, TopNode(EMPTY, 0u, 0u, own_successor));
                    middle_leaves[slot(place.z, 1u - turn)] = SmallRoot(
                        part.lo, place.x, part.hi, references, top + child, depth + 1u, 0u,
                        select(0u, 1u, inseparable));
                    next = select(vec2<u32>(place.z, next.y), vec2<u32>(next.x, place.z), child == 1u);
                    places[lane][child] = list_first[turn] + place.x - rank[child];
                    place += vec4<u32>(references, 0u, 1u, 0u);
                } else {
                    put_leaf(top + child, own_successor, part, depth + 1u, references, place);
                    places[lane][child] = leaf_source + place.y - rank[child];
                    place += vec4<u32>(0u, references, 0u, select(0u, 1u, references > 0u));
                }
            }
        }
        children[lane] = next.x | (next.y << 8u);
    }
    storageBarrier();
    workgroupBarrier();
    clear_bounds(found_nodes, lane);
}

// A leaf of `references` references. Its places are those that the nodes before it leave: see `place_children`.
fn put_leaf(
    node: u32, successor: u32, cell: Aabb, depth: u32, references: u32, place: vec4<u32>,
) {
    if references == 0u {
        put_node(own.first_node + node, TopNode(EMPTY, 0u, 0u, successor));
        return;
    }
    let leaf = leaves + place.w;
    put_node(own.first_node + node, TopNode(SMALL_ROOT, 0u, leaf, successor));
    middle_leaves[own.first_leaf + leaf] = SmallRoot(
        cell.lo, leaf_references + place.y, cell.hi, references, own.node, depth, own.level, leaf_source + place.y);
}

// Moves references to the children, and bounds the next nodes.
fn scatter(handed: bool, nodes: u32, lane: u32) {
    var i = share_start(lane);
    let end = share_start(lane + 1u);
    var node = 0u;
    var k = 0u;
    var rank = vec2<u32>(0u);
    if i < end {
        node = node_of(i);
        k = cut_first + 2u * cuts_before(i);
        rank = before(i);
    }
    // The marks of 32 references, and where the next 32 begin.
    var marked = vec3<u32>(0u);
    var marked_end = i;
    while i < end {
        let last = min(end, first[node + 1u]);
        let place = places[node];
        var next = place + rank;
        var left = empty_aabb();
        var right = left;
        for (; i < last; i++) {
            if i == marked_end {
                let word = i / 32u;
                marked = vec3<u32>(
                    atomicLoad(&marks[LEFTS + word]), atomicLoad(&marks[RIGHTS + word]), atomicLoad(&marks[CUTS + word]));
                marked = marked >> vec3<u32>(i % 32u);
                marked_end = 32u * word + 32u;
            }
            let here = marked & vec3<u32>(1u);
            marked = marked >> vec3<u32>(1u);
            if here.z == 0u {
                let reference = level_reference(handed, i);
                if here.x == 1u {
                    middle_references[next.x] = reference;
                    left = joined(left, reference);
                } else {
                    middle_references[next.y] = reference;
                    right = joined(right, reference);
                }
            } else {
                if here.x == 1u {
                    let reference = middle_references[k];
                    middle_references[next.x] = reference;
                    left = joined(left, reference);
                }
                if here.y == 1u {
                    let reference = middle_references[k + 1u];
                    middle_references[next.y] = reference;
                    right = joined(right, reference);
                }
                k += 2u;
            }
            next += here.xy;
        }
        rank = next - place;
        bound_child(children[node] & 0xffu, left);
        bound_child(children[node] >> 8u, right);
        node += 1u;
    }
    storageBarrier();
    workgroupBarrier();
    if lane == 0u {
        let total = scan_sum_of(nodes);
        emitted += total.y >> 16u;
        leaves += (total.y >> 8u) & 0xffu;
        leaf_references += total.x >> 16u;
    }
}

fn joined(bounds: Aabb, reference: Reference) -> Aabb {
    return Aabb(min(bounds.lo, reference.lo), max(bounds.hi, reference.hi));
}

// What goes to a child is in its tight bounds.
fn bound_child(child: u32, bounds: Aabb) {
    if child != NO_NEXT && !is_empty(bounds) {
        widen(child, bounds);
    }
}

// Splits what the levels have handed over until it has T references or cannot be split.
// One workgroup a middle root, all levels of its tree in turn; one invocation a node where it is decided, a reference where
// references move.
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
@group(0) @binding(4) var<storage, read> triangles: array<f32>;
@group(0) @binding(5) var<storage, read_write> middle_roots: array<MiddleRoot>;
@group(0) @binding(6) var<storage, read_write> middle_references: array<Reference>;
@group(0) @binding(7) var<storage, read_write> middle_nodes: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> middle_leaves: array<SmallRoot>;

const LANES: u32 = 256u;
const SWEEP_SAMPLES: u32 = 64u;
// In place of an axis: the node is to be swept.
const TO_BE_SWEPT: u32 = 4u;
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
// By node of the level: its references, tight bounds in order, its cuts and plane, where children get references.
var<workgroup> first: array<u32, ACTIVE_NODES>;
var<workgroup> count: array<u32, ACTIVE_NODES>;
var<workgroup> tight: array<atomic<u32>, 6u * ACTIVE_NODES>;
var<workgroup> plane_axis: array<u32, ACTIVE_NODES>;
var<workgroup> plane_position: array<f32, ACTIVE_NODES>;
var<workgroup> places: array<vec2<u32>, ACTIVE_NODES>;
// By 32 references of the level, a bit each: those that begin a node, those that go left, and right.
var<workgroup> starts: array<atomic<u32>, 256>;
var<workgroup> lefts: array<atomic<u32>, 256>;
var<workgroup> rights: array<atomic<u32>, 256>;
// How many there are before these: nodes; left in the low half, right in the high one.
var<workgroup> starts_before: array<u32, 256>;
var<workgroup> sides_before: array<u32, 257>;

// By face of the samples of a sweep: references that go left in the low half, right in the high one.
var<workgroup> sweep_sides: array<atomic<u32>, 384>;
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
    return starts_before[i / 32u] + countOneBits(atomicLoad(&starts[i / 32u]) & upto) - 1u;
}

// How many of the references before one go left, and right.
fn before(i: u32) -> vec2<u32> {
    let word = i / 32u;
    let sums = sides_before[word];
    var here = vec2<u32>(sums & 0xffffu, sums >> 16u);
    if i % 32u != 0u {
        let below = (1u << (i % 32u)) - 1u;
        here += vec2<u32>(
            countOneBits(atomicLoad(&lefts[word]) & below),
            countOneBits(atomicLoad(&rights[word]) & below),
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

// The next cut of empty space off a cell, at this side or a later one; not found where there is none.
struct Cut {
    plane: SplitPlane,
    side: u32,
}

fn next_cut(cell: Aabb, bounds: Aabb, from_side: u32) -> Cut {
    for (var side = from_side; side < 6u; side++) {
        let plane = empty_cutoff(cell, bounds, side);
        if plane.found {
            return Cut(plane, side);
        }
    }
    return Cut(no_plane(), 6u);
}

fn cut_off(cell: Aabb, cut: Cut) -> Aabb {
    var rest = cell;
    if cut.side % 2u == 0u {
        rest.lo = with_axis(cell.lo, cut.plane.axis, cut.plane.position);
    } else {
        rest.hi = with_axis(cell.hi, cut.plane.axis, cut.plane.position);
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

// What the cuts of a node leave, and how many there are; split where levels are left.
struct Rest {
    cell: Aabb,
    cuts: u32,
    splits: bool,
}

fn rest_of(node: SmallRoot, place: u32) -> Rest {
    let bounds = tight_bounds(place);
    let levels_left = parameters.max_depth - node.depth;
    var rest = Rest(Aabb(node.lo, node.hi), 0u, false);
    var side = 0u;
    while side < 6u && rest.cuts < levels_left {
        let cut = next_cut(rest.cell, bounds, side);
        if cut.plane.found {
            rest.cell = cut_off(rest.cell, cut);
            rest.cuts += 1u;
        }
        side = cut.side + 1u;
    }
    rest.splits = rest.cuts < levels_left;
    return rest;
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
    while workgroupUniformLoad(&node_count) > 0u {
        let handed = levels == 0u;
        let turn = levels % 2u;
        begin_level(handed, turn, lane);
        decide(turn, lane);
        while workgroupUniformLoad(&swept_now) != NO_NODE {
            sweep(handed, turn, lane);
        }
        classify(handed, lane);
        let found = emit(turn, lane);
        levels += 1u;
        if workgroupUniformLoad(&outgrown_now) == 1u {
            break;
        }
        place_children(found, turn, lane);
        scatter(handed, lane);
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

// Which references begin a node of the level, and the tight bounds of each node.
fn begin_level(handed: bool, turn: u32, lane: u32) {
    let nodes = node_count;
    atomicStore(&starts[lane], 0u);
    atomicStore(&lefts[lane], 0u);
    atomicStore(&rights[lane], 0u);
    for (var i = lane; i < 6u * nodes; i += LANES) {
        atomicStore(&tight[i], select(0u, 0xffffffffu, i % 6u < 3u));
    }
    if lane == 0u {
        atomicStore(&swept, NO_NODE);
    }
    workgroupBarrier();
    if lane < nodes {
        let place = slot(lane, turn);
        let begin = middle_leaves[place].first;
        first[lane] = begin;
        count[lane] = middle_leaves[place].count;
        atomicOr(&starts[begin / 32u], 1u << (begin % 32u));
    }
    workgroupBarrier();
    let here = countOneBits(atomicLoad(&starts[lane]));
    starts_before[lane] = inclusive_scan(lane, vec2<u32>(here, 0u)).x - here;
    workgroupBarrier();
    var i = share_start(lane);
    let end = share_start(lane + 1u);
    var node = 0u;
    if i < end {
        node = node_of(i);
    }
    while i < end {
        let last = min(end, first[node] + count[node]);
        var bounds = empty_aabb();
        for (; i < last; i++) {
            let reference = level_reference(handed, i);
            bounds = Aabb(least3(bounds.lo, reference.lo), most3(bounds.hi, reference.hi));
        }
        let at = 6u * node;
        atomicMin(&tight[at], ordered_bits(bounds.lo.x));
        atomicMin(&tight[at + 1u], ordered_bits(bounds.lo.y));
        atomicMin(&tight[at + 2u], ordered_bits(bounds.lo.z));
        atomicMax(&tight[at + 3u], ordered_bits(bounds.hi.x));
        atomicMax(&tight[at + 4u], ordered_bits(bounds.hi.y));
        atomicMax(&tight[at + 5u], ordered_bits(bounds.hi.z));
        node += 1u;
    }
    workgroupBarrier();
}

// The plane of each node of the level, an invocation a node.
fn decide(turn: u32, lane: u32) {
    if lane < node_count {
        let node = middle_leaves[slot(lane, turn)];
        let rest = rest_of(node, lane);
        // Its cuts, until its children have places.
        places[lane] = vec2<u32>(rest.cuts, 0u);
        var plane = no_plane();
        if rest.splits && node.padding == 0u {
            plane = spatial_median(rest.cell);
        }
        plane_axis[lane] = select(TRANSFER, plane.axis, plane.found);
        plane_position[lane] = select(0.0, plane.position, plane.found);
        if rest.splits && node.padding == 1u {
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
    let rest = rest_of(middle_leaves[slot(place, turn)], place);
    let extents = extents_of(rest.cell);
    let begin = first[place];
    let size = count[place];
    let samples = min(size, SWEEP_SAMPLES);
    for (var face = lane; face < 384u; face += LANES) {
        atomicStore(&sweep_sides[face], 0u);
    }
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
            atomicAdd(&sweep_sides[6u * sample + axis], low[axis]);
            atomicAdd(&sweep_sides[6u * sample + 3u + axis], high[axis]);
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
        if strictly_inside(rest.cell, on, position) && extents.large_enough {
            let sides = atomicLoad(&sweep_sides[face]);
            let offset = quantised_offset(extents, on_axis(rest.cell.lo, on), position);
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

// The sides that each reference goes to, and how many there are before each 32.
fn classify(handed: bool, lane: u32) {
    workgroupBarrier();
    // Neighbours go to different invocations: where one is cut, others often are.
    for (var i = lane; i < reference_count; i += LANES) {
        let node = node_of(i);
        let axis = plane_axis[node];
        var sides = vec2<bool>(true, false);
        if axis != TRANSFER {
            sides = sides_of(level_reference(handed, i), axis, plane_position[node]);
        }
        if sides.x {
            atomicOr(&lefts[i / 32u], 1u << (i % 32u));
        }
        if sides.y {
            atomicOr(&rights[i / 32u], 1u << (i % 32u));
        }
    }
    workgroupBarrier();
    let here = countOneBits(atomicLoad(&lefts[lane])) | (countOneBits(atomicLoad(&rights[lane])) << 16u);
    let sum = inclusive_scan(lane, vec2<u32>(here, 0u)).x;
    sides_before[lane] = sum - here;
    if lane == 255u {
        sides_before[256] = sum;
    }
    workgroupBarrier();
}

// What a node gives to the lists of its level, and before it all other nodes: references of next nodes and of leaves, next
// nodes, leaves, nodes of the tree.
struct Found {
    // Two numbers in the first word, 16 bits each; three in the second, 8, 8 and 16.
    packed: vec2<u32>,
    counts: vec2<u32>,
}

// Counts the children of the level, and takes parts of the pool for their references.
fn emit(turn: u32, lane: u32) -> Found {
    var packed = vec2<u32>(0u);
    var counts = vec2<u32>(0u);
    if lane < node_count {
        let size = count[lane];
        let splits = plane_axis[lane] != TRANSFER;
        counts = before(first[lane] + size) - before(first[lane]);
        let cuts = places[lane].x;
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
    let upto = inclusive_scan(lane, packed);
    let total = scan_sum();
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
        let cuts = places[lane].x;
        var cell = Aabb(node.lo, node.hi);
        var current = node.node;
        var depth = node.depth;
        var top = emitted + (found.packed.y >> 16u);
        var successor = atomicLoad(&middle_nodes[4u * (first_node + current) + 3u]);
        var side = 0u;
        for (var i = 0u; i < cuts; i++) {
            let cut = next_cut(cell, bounds, side);
            let low = cut.side % 2u == 0u;
            let left = select(top + 1u, top, low);
            let right = select(top, top + 1u, low);
            put_node(first_node + current, TopNode(cut.plane.axis, bitcast<u32>(cut.plane.position), left, right));
            // The empty leaf comes first, whichever side it is on.
            put_node(first_node + top, TopNode(EMPTY, 0u, 0u, select(successor, right, low)));
            successor = select(left - 1u, successor, low);
            cell = cut_off(cell, cut);
            current = top + 1u;
            top += 2u;
            depth += 1u;
            side = cut.side + 1u;
        }
        let axis = plane_axis[lane];
        var place = vec4<u32>(
            found.packed.x & 0xffffu, found.packed.x >> 16u, found.packed.y & 0xffu, (found.packed.y >> 8u) & 0xffu);
        if axis == TRANSFER {
            let children = Aabb(cell.lo, cell.hi);
            put_leaf(current, successor, children, depth, node.count, place);
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
                    places[lane][child] = list_first[turn] + place.x - rank[child];
                    place += vec4<u32>(references, 0u, 1u, 0u);
                } else {
                    put_leaf(top + child, own_successor, part, depth + 1u, references, place);
                    places[lane][child] = leaf_source + place.y - rank[child];
                    place += vec4<u32>(0u, references, 0u, select(0u, 1u, references > 0u));
                }
            }
        }
    }
    storageBarrier();
    workgroupBarrier();
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

// Moves references to the children, cut at the plane.
fn scatter(handed: bool, lane: u32) {
    for (var i = lane; i < reference_count; i += LANES) {
        let node = node_of(i);
        let reference = level_reference(handed, i);
        let axis = plane_axis[node];
        let rank = before(i);
        if axis == TRANSFER {
            middle_references[places[node].x + rank.x] = reference;
        } else {
            let parts = parts_of(reference, axis, plane_position[node]);
            let bit = 1u << (i % 32u);
            if (atomicLoad(&lefts[i / 32u]) & bit) != 0u {
                middle_references[places[node].x + rank.x] =
                    Reference(parts.left.lo, reference.triangle, parts.left.hi, 0u);
            }
            if (atomicLoad(&rights[i / 32u]) & bit) != 0u {
                middle_references[places[node].y + rank.y] =
                    Reference(parts.right.lo, reference.triangle, parts.right.hi, 0u);
            }
        }
    }
    storageBarrier();
    workgroupBarrier();
    if lane == 0u {
        let total = scan_sum();
        emitted += total.y >> 16u;
        leaves += (total.y >> 8u) & 0xffu;
        leaf_references += total.x >> 16u;
    }
}

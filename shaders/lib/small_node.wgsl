// The small-node stage of Zhou et al. 2008: the subtree of one small root, built by a workgroup in workgroup
// memory. The kernel says how many invocations it has: SMALL_LANES, a multiple of 32. Twin of backend-cpu's small_root.rs.
//
// Candidates are the faces of the references' bounds as they stand in the root. A candidate counts
// only where its own triangle is in the node and the plane lies strictly inside. So faces outside the root's cell
// are no planes, and faces at one place are one plane, which belongs to several triangles. One of the first 32
// invocations has two references until the planes are known. Then an invocation has every plane SMALL_LANES apart: it makes
// the plane's masks once, and evaluates the plane for every node. Depth first, left before right.
//
// References are in two halves of equal length, one bit in one of two words each: the first half in the first word.
//
// The kernel says what becomes of interior nodes and of leaves: `put_node`, `put_right`, `put_leaf`.
// Needs the bindings `parameters` and `small_references`.

const MAX_DEPTH: u32 = 96u;
const SMALL_ROOT_NODES: u32 = 511u;
const SMALL_ROOT_REFERENCES: u32 = 1023u;

// Six faces of 64 references.
const MOST_PLANES: u32 = 384u;
// From an axis to the next in `scratch`: one more than the lanes, so that lanes at different axes read different banks.
const FACES_STRIDE: u32 = 33u;
const SLOTS: u32 = 256u;

// First, per axis and lane: the low faces of its two references, then the high ones, as bits.
// Then: right children to come, two each: cell, mask.
var<workgroup> scratch: array<vec4<u32>, 192>;
// First: a hash table of the faces within the root's cell: one more than the name of a face, the greatest of those that
// meet. A face is named by 128 axis + 32 (2 high + second half) + lane.
// Then, of right children to come: depth, index of the parent and axis.
var<workgroup> links: array<atomic<u32>, SLOTS>;
var<workgroup> plane_count: atomic<u32>;
// Of each plane the bits of its position, and the name of a face at its place, 16 bits. The order of planes may differ from
// run to run; nothing depends on it, since the least rank is sought.
var<workgroup> positions: array<u32, MOST_PLANES>;
var<workgroup> names: array<atomic<u32>, 192>;
// By the name of a plane, the triangles that have a face there: a set of two words.
var<workgroup> owners: array<atomic<u32>, 768>;
// The triangles left and right of each plane, two words each.
var<workgroup> plane_sides: array<vec4<u32>, MOST_PLANES>;
// Of the current node, by axis: lower and upper side, half of the lower, half extent in whole numbers; then what makes a
// half area of another extent e: e * x + y.
var<workgroup> measures: array<vec4<u32>, 6>;
// What the current node is.
var<workgroup> state: u32;
// The least rank among candidates, one part after the other: cost; axis and position but for its last two bits; these and
// the plane.
var<workgroup> best_cost: atomic<u32>;
var<workgroup> best_place: atomic<u32>;
var<workgroup> best_plane: atomic<u32>;

const NOTHING: u32 = 0xffffffffu;
// What `state` may be: no node is left; a leaf; a node that may be split.
const DONE: u32 = 0u;
const LEAF: u32 = 1u;
const OPEN: u32 = 2u;

// A node not yet decided.
struct Pending {
    cell: Aabb,
    mask: vec2<u32>,
    depth: u32,
    // The interior node whose right child this is, and its axis below; NOTHING for a left child.
    parent: u32,
}

// `on_axis` of whole numbers.
fn whole_on_axis(v: vec3<u32>, axis: u32) -> u32 {
    return select(select(v.x, v.y, axis == 1u), v.z, axis == 2u);
}

// ceil(count / W) of at most 64, by a product: `inverse` is floor(65535 / W) + 1, which is 2^16 / W and less than one more.
fn blocks_of(count: u32, inverse: u32) -> u32 {
    return ((count + parameters.block_width - 1u) * inverse) >> 16u;
}

fn slot_of(bits: u32, axis: u32) -> u32 {
    return ((bits + axis) * 0x9e3779b1u) >> 24u;
}

// The bits of the face of this name.
fn position_of(name: u32) -> u32 {
    return scratch[(name >> 7u) * FACES_STRIDE + (name & 31u)][(name >> 5u) & 3u];
}

fn name_of(plane: u32) -> u32 {
    return (atomicLoad(&names[plane / 2u]) >> (16u * (plane % 2u))) & 511u;
}

// Whether the face of this name lies within the root's cell.
fn is_within(root: SmallRoot, name: u32, position: f32) -> bool {
    let axis = name >> 7u;
    return on_axis(root.lo, axis) < position && position < on_axis(root.hi, axis);
}

// Faces are numbered without gaps, so that all invocations have as many: axis by axis, side by side, half by half.
fn name_of_face(face: u32, half: u32, inverse: u32) -> u32 {
    let row = (face * inverse) >> 16u;
    return 32u * row + face - row * half;
}

// A face within the cell asks for its slot, and is its own plane's only triangle so far. Whether it is.
fn claim(root: SmallRoot, name: u32) -> bool {
    let bits = position_of(name);
    let within = is_within(root, name, bitcast<f32>(bits));
    if within {
        atomicMax(&links[slot_of(bits, name >> 7u)], name + 1u);
        let bit = 1u << (name & 31u);
        let second = (name & 32u) != 0u;
        atomicStore(&owners[2u * name], select(bit, 0u, second));
        atomicStore(&owners[2u * name + 1u], select(0u, bit, second));
    }
    return within;
}

// A face within the cell is a plane, or its triangle joins those of the plane that has its slot. A face whose slot another plane has
// is a plane too, even if several are at its place.
fn settle(name: u32) {
    let bits = position_of(name);
    let axis = name >> 7u;
    let other = atomicLoad(&links[slot_of(bits, axis)]) - 1u;
    if other != name && other >> 7u == axis && position_of(other) == bits {
        atomicOr(&owners[2u * other + ((name >> 5u) & 1u)], 1u << (name & 31u));
    } else {
        let plane = atomicAdd(&plane_count, 1u);
        positions[plane] = bits;
        atomicOr(&names[plane / 2u], name << (16u * (plane % 2u)));
    }
}

// Completes a plane: which references, of two halves of `half`, go to which side.
fn complete(index: u32, half: u32) {
    let position = vec2<f32>(bitcast<f32>(positions[index]));
    let first = (name_of(index) >> 7u) * FACES_STRIDE;
    var below = vec2<u32>();
    var above = vec2<u32>();
    var bit = vec2<u32>(1u);
    // Four lanes' a round. The last may be none's: no mask has their bits.
    for (var i = first; i < first + half; i += 4u) {
        let a = scratch[i];
        let b = scratch[i + 1u];
        let c = scratch[i + 2u];
        let d = scratch[i + 3u];
        let none = vec2<u32>();
        let b_bit = bit << vec2<u32>(1u);
        let c_bit = bit << vec2<u32>(2u);
        let d_bit = bit << vec2<u32>(3u);
        below |= select(none, bit, bitcast<vec2<f32>>(a.xy) < position);
        above |= select(none, bit, bitcast<vec2<f32>>(a.zw) > position);
        below |= select(none, b_bit, bitcast<vec2<f32>>(b.xy) < position);
        above |= select(none, b_bit, bitcast<vec2<f32>>(b.zw) > position);
        below |= select(none, c_bit, bitcast<vec2<f32>>(c.xy) < position);
        above |= select(none, c_bit, bitcast<vec2<f32>>(c.zw) > position);
        below |= select(none, d_bit, bitcast<vec2<f32>>(d.xy) < position);
        above |= select(none, d_bit, bitcast<vec2<f32>>(d.zw) > position);
        bit <<= vec2<u32>(4u);
    }
    // `goes_left` and `goes_right`: what does not reach above goes left, planar in the plane or not.
    plane_sides[index] = vec4<u32>(below | ~above, above);
}

// A candidate's rank, in the parts that are sought one after the other.
struct Candidate {
    cost: u32,
    place: u32,
    plane: u32,
}

// The plane at `index`, if it counts in a node and is better than `best`. `base` is K_T times the cell's half area, `whole`
// K_I times that. `lesser` is the most that the lesser of both sides' masks, halves together, may be.
fn consider(
    best: Candidate, index: u32, mask: vec2<u32>, scale: f32, base: u32, whole: u32, lesser: u32, inverse: u32,
) -> Candidate {
    let sides = plane_sides[index] & mask.xyxy;
    if min(sides.x | sides.y, sides.z | sides.w) > lesser {
        return best;
    }
    let left = blocks_of(count_mask(sides.xy), inverse);
    let right = blocks_of(count_mask(sides.zw), inverse);
    // The half areas of both parts are together no less than the cell's.
    if base + min(left, right) * whole > best.cost {
        return best;
    }
    let position = bitcast<f32>(positions[index]);
    let name = name_of(index);
    let axis = name >> 7u;
    let extent = measures[axis];
    let owned = (atomicLoad(&owners[2u * name]) & mask.x) | (atomicLoad(&owners[2u * name + 1u]) & mask.y);
    if !(bitcast<f32>(extent.x) < position && position < bitcast<f32>(extent.y) && owned != 0u) {
        return best;
    }
    // `quantised_offset`, with the lower side's half at hand.
    let distance = snapped_difference(snapped_product(position, 0.5), bitcast<f32>(extent.z));
    let offset = quantise(distance, scale);
    let rest = max(extent.w, offset) - offset;
    let area = measures[3u + axis];
    let areas = left * (max(offset, 1u) * area.x + area.y) + right * (max(rest, 1u) * area.x + area.y);
    let cost = base + parameters.intersection_cost * areas;
    if cost > best.cost {
        return best;
    }
    let order = ordered_bits(position);
    let here = Candidate(cost, (axis << 30u) | (order >> 2u), ((order & 3u) << 9u) | index);
    if cost == best.cost && (best.place < here.place || (best.place == here.place && best.plane < here.plane)) {
        return best;
    }
    return here;
}

// Leaves in `measures` what all candidates of a node need, one axis each of the first three lanes.
fn put_measures(cell: Aabb, cells: vec3<u32>, rims: vec3<u32>, caps: vec3<u32>, lane: u32) {
    if lane < 3u {
        let lower = on_axis(cell.lo, lane);
        measures[lane] = vec4<u32>(
            bitcast<u32>(lower),
            bitcast<u32>(on_axis(cell.hi, lane)),
            bitcast<u32>(snapped_product(lower, 0.5)),
            whole_on_axis(cells, lane),
        );
        measures[3u + lane] = vec4<u32>(whole_on_axis(rims, lane), whole_on_axis(caps, lane), 0u, 0u);
    }
}

// One word by each of the first nine lanes.
fn push(place: u32, cell: Aabb, mask: vec2<u32>, link: u32, lane: u32) {
    if lane < 8u {
        let corner = select(cell.lo, cell.hi, lane >= 4u);
        let of_cell = bitcast<u32>(on_axis(corner, lane % 4u));
        let of_mask = select(mask.x, mask.y, lane >= 4u);
        scratch[2u * place + lane / 4u][lane % 4u] = select(of_cell, of_mask, lane % 4u == 3u);
    }
    if lane == 8u {
        atomicStore(&links[place], link);
    }
}

fn pop(place: u32) -> Pending {
    let lower = scratch[2u * place];
    let upper = scratch[2u * place + 1u];
    let link = atomicLoad(&links[place]);
    let cell = Aabb(bitcast<vec3<f32>>(lower.xyz), bitcast<vec3<f32>>(upper.xyz));
    return Pending(cell, vec2<u32>(lower.w, upper.w), link >> 11u, link & 2047u);
}

// The references of a root's lane into workgroup memory: the lane's of the first half and of the second.
fn put_faces(root: SmallRoot, half: u32, lane: u32) {
    let at = root.first + lane - first_seen();
    let first = small_references[at];
    var second = Reference(vec3<f32>(GREATEST), 0u, vec3<f32>(-GREATEST), 0u);
    // Of an odd number one is missing.
    if half + lane < root.count {
        second = small_references[at + half];
    }
    for (var axis = 0u; axis < 3u; axis++) {
        scratch[axis * FACES_STRIDE + lane] = bitcast<vec4<u32>>(vec4<f32>(
            on_axis(first.lo, axis),
            on_axis(second.lo, axis),
            on_axis(first.hi, axis),
            on_axis(second.hi, axis),
        ));
    }
    own_triangles[lane] = vec2<u32>(first.triangle, second.triangle);
}

// The planes of a root and their masks. All invocations must call it.
fn find_planes(root: SmallRoot, half: u32, lane: u32) {
    workgroupBarrier();
    let faces = 12u * half;
    // floor(face / half) of a face below 384, by a product: 2^16 / half and less than one more.
    let inverse = 65535u / half + 1u;
    // Which of the invocation's faces are within the cell: a bit each, twelve at most.
    var within = 0u;
    var bit = 1u;
    for (var face = lane; face < faces; face += SMALL_LANES) {
        within |= select(0u, bit, claim(root, name_of_face(face, half, inverse)));
        bit <<= 1u;
    }
    workgroupBarrier();
    for (var rest = within; rest != 0u; rest &= rest - 1u) {
        settle(name_of_face(lane + SMALL_LANES * firstTrailingBit(rest), half, inverse));
    }
    workgroupBarrier();
    let count = atomicLoad(&plane_count);
    for (var index = lane; index < count; index += SMALL_LANES) {
        complete(index, half);
    }
}

// Builds the subtree of a root of at most T references and returns how many nodes and references it has. All invocations
// must call it.
fn build_subtree(root: SmallRoot, lane: u32) -> vec2<u32> {
    let half = (root.count + 1u) / 2u;
    workgroupBarrier();
    if lane < half {
        put_faces(root, half, lane);
    }
    for (var slot = lane; slot < SLOTS; slot += SMALL_LANES) {
        atomicStore(&links[slot], 0u);
    }
    for (var pair = lane; pair < MOST_PLANES / 2u; pair += SMALL_LANES) {
        atomicStore(&names[pair], 0u);
    }
    if lane == 0u {
        atomicStore(&plane_count, 0u);
    }
    find_planes(root, half, lane);
    let inverse = 65535u / parameters.block_width + 1u;
    let all = vec2<u32>(half, root.count - half);
    // Of 32 bits a shift would leave all.
    let ones = select((vec2<u32>(1u) << all) - vec2<u32>(1u), vec2<u32>(NOTHING), all == vec2<u32>(32u));
    var node = Pending(Aabb(root.lo, root.hi), ones, root.depth, NOTHING);
    // Every invocation keeps the same account.
    var running = true;
    var stack_top = 0u;
    // Emitted so far.
    var emitted = vec2<u32>(0u);
    // Allocated so far, those pending included: what the caps of a root count.
    var allocated = vec2<u32>(1u, root.count);
    loop {
        let count = count_mask(node.mask);
        var scale = 0.0;
        var base = 0u;
        var whole = 0u;
        var leaf_cost = 0u;
        if running && count > 0u {
            let extents = extents_of(node.cell);
            let c = max(extents.cells, vec3<u32>(1u));
            let rims = c.yzx + c.zxy;
            let caps = c.yzx * c.zxy;
            let area = c.x * rims.x + caps.x;
            scale = extents.scale;
            base = parameters.traversal_cost * area;
            whole = parameters.intersection_cost * area;
            leaf_cost = whole * blocks_of(count, inverse);
            let open = node.depth < parameters.max_depth && extents.large_enough && leaf_cost > base;
            leaf_cost = select(0u, leaf_cost, open);
            put_measures(node.cell, extents.cells, rims, caps, lane);
        }
        if lane == 0u {
            state = select(DONE, select(LEAF, OPEN, leaf_cost > 0u), running);
            atomicStore(&best_cost, NOTHING);
        }
        let now = workgroupUniformLoad(&state);
        if now == DONE {
            break;
        }
        var chosen = NOTHING;
        if now == OPEN {
            if lane == 0u {
                // Nobody reads the last node's any more.
                atomicStore(&best_place, NOTHING);
                atomicStore(&best_plane, NOTHING);
            }
            // Only what costs less than a leaf counts.
            let none = Candidate(leaf_cost - 1u, NOTHING, NOTHING);
            // In a node of one block no plane pays that has references on both sides: its parts cost no less than the leaf.
            let lesser = select(NOTHING, 0u, leaf_cost == whole);
            var best = none;
            let planes_end = atomicLoad(&plane_count);
            for (var index = lane; index < planes_end; index += SMALL_LANES) {
                best = consider(best, index, node.mask, scale, base, whole, lesser, inverse);
            }
            // Part by part: minima of integers do not depend on order.
            let found = best.plane != NOTHING;
            if found {
                atomicMin(&best_cost, best.cost);
            }
            workgroupBarrier();
            let cheap = found && best.cost == atomicLoad(&best_cost);
            if cheap {
                atomicMin(&best_place, best.place);
            }
            workgroupBarrier();
            if cheap && best.place == atomicLoad(&best_place) {
                atomicMin(&best_plane, best.plane);
            }
            workgroupBarrier();
            chosen = atomicLoad(&best_plane);
        }
        let index = emitted.x;
        if lane == 0u {
            if node.parent != NOTHING {
                put_right((node.parent >> 2u) & 511u, node.parent & 3u, index);
            }
        }
        var left = vec2<u32>();
        var right = vec2<u32>();
        if chosen != NOTHING {
            let sides = plane_sides[chosen & 511u];
            left = sides.xy & node.mask;
            right = sides.zw & node.mask;
        }
        let after = allocated.y + count_mask(left) + count_mask(right) - count;
        emitted.x += 1u;
        if chosen != NOTHING && allocated.x + 2u <= SMALL_ROOT_NODES && after <= SMALL_ROOT_REFERENCES {
            allocated = vec2<u32>(allocated.x + 2u, after);
            let axis = name_of(chosen & 511u) >> 7u;
            let position = bitcast<f32>(positions[chosen & 511u]);
            let depth = node.depth + 1u;
            if lane == 0u {
                put_node(index, vec2<u32>(bitcast<u32>(position), axis));
            }
            let right_cell = Aabb(with_axis(node.cell.lo, axis, position), node.cell.hi);
            push(stack_top, right_cell, right, (depth << 11u) | (index << 2u) | axis, lane);
            stack_top += 1u;
            node = Pending(Aabb(node.cell.lo, with_axis(node.cell.hi, axis, position)), left, depth, NOTHING);
        } else {
            put_leaf(index, node.mask, emitted.y, lane);
            emitted.y += count;
            running = stack_top > 0u;
            if running {
                stack_top -= 1u;
                node = pop(stack_top);
            }
        }
    }
    // A driver may end the loop early (see split_median.wgsl). The zero keeps a compiler from concluding
    // that it does not.
    if (select(0u, 1u, running) ^ opaque_zero) != 0u {
        return vec2<u32>(NOTHING);
    }
    return emitted;
}

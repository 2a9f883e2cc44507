// Writes the nodes of the batch and their references, and queues the children that become nodes.
// One invocation a node.
// Reads: the children of each part and their places; the tree's references.
// Writes: the nodes and the references of their leaves; the parts that become nodes.
// Ties: none.

@group(0) @binding(0) var<uniform> compress: Compress;
@group(0) @binding(1) var<storage, read> counters: array<u32, 8>;
@group(0) @binding(2) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(3) var<storage, read> children: array<array<Part, 8>>;
@group(0) @binding(4) var<storage, read> places: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> parts: array<Part>;
// Five vectors a node, as `CompressedNode` in core/src/query/compressed.rs says.
@group(0) @binding(6) var<storage, read_write> compressed_nodes: array<array<vec4<u32>, 5>>;
@group(0) @binding(7) var<storage, read_write> compressed_references: array<u32>;

const LANES: u32 = 64u;
// Exponents of quanta.
const LEAST_QUANTUM: i32 = -100;
const MOST_QUANTUM: i32 = 112;
// The exponent of as many quanta as a number from 1 to 2 stands for.
const UNITS: i32 = 15;
// Bits of the first reference, below the number of children that are nodes.
const REFERENCE_BITS: u32 = 26u;

// The float below a snapped one, snapped.
fn lower(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let next = select(min(bits + 1u, 0xff7fffffu), bits - 1u, bits < 0x80000000u);
    return select(snap(bitcast<f32>(next)), -LEAST_NORMAL, x == 0.0);
}

// The float above a snapped one, likewise.
fn upper(x: f32) -> f32 {
    return -lower(-x);
}

// Where a side is, in quanta from the origin; rounded.
fn place_of(side: f32, origin: f32, power: i32) -> f32 {
    return snapped_product(snapped_difference(side, origin), power_of_two(-power));
}

// One quantum below a place that was rounded, in whole quanta.
fn below(place: f32) -> u32 {
    let whole = u32(most(lower(place), 0.0));
    return select(whole - 1u, 0u, whole == 0u);
}

// One quantum above a place that was rounded, in whole quanta.
fn above(place: f32) -> u32 {
    let outer = most(upper(place), 0.0);
    let whole = u32(outer);
    return whole + select(1u, 2u, f32(whole) < outer);
}

// The origin of the quanta on an axis, for sides from `lo` to `hi`, and their exponent.
struct Frame {
    origin: f32,
    power: i32,
}

fn frame(lo: f32, hi: f32) -> Frame {
    // Less than a hundredth of what a float of this magnitude resolves is never needed.
    let finest = exponent(most(abs(lo), abs(hi))) - 32;
    let extent = snapped_difference(hi, lo);
    var power = clamp(max(exponent(extent) - 8, finest), LEAST_QUANTUM, MOST_QUANTUM);
    var origin = 0.0;
    loop {
        // Two quanta below the least side, so that none is negative.
        origin = lower(snapped_difference(lo, power_of_two(power + 1)));
        if above(place_of(hi, origin, power)) <= 255u || power >= MOST_QUANTUM {
            break;
        }
        power++;
    }
    return Frame(origin, power);
}

// The lower or upper side of a child's box on an axis.
fn lower_side(part: Part, axis: u32) -> f32 {
    return lower(snapped_difference(on_axis(part.lo, axis), compress.slack));
}

fn upper_side(part: Part, axis: u32) -> f32 {
    return upper(snapped_sum(on_axis(part.hi, axis), compress.slack));
}

// A byte for each of eight children: two words.
fn with_byte(words: vec2<u32>, child: u32, value: u32) -> vec2<u32> {
    let shift = 8u * (child & 3u);
    let byte = value << shift;
    let others = ~(0xffu << shift);
    return select(
        vec2<u32>(words.x, (words.y & others) | byte),
        vec2<u32>((words.x & others) | byte, words.y),
        child < 4u,
    );
}

fn emit_node(index: u32, node: u32) {
    let place = places[index];
    // Children that are nodes, and all that there are.
    var inner = 0u;
    var count = 0u;
    var end = 0u;
    var ends = vec2<u32>(0u);
    for (var child = 0u; child < CHILDREN; child++) {
        let part = children[index][child];
        if is_node(part) {
            parts[place.x + inner] = part;
            inner++;
            count++;
            continue;
        }
        for (var at = 0u; at < part.count; at++) {
            compressed_references[place.y + end + at] = leaf_references[part.first + at];
        }
        count += select(0u, 1u, part.count > 0u);
        end += part.count;
        ends = with_byte(ends, child, end);
    }
    var origin = vec3<f32>(0.0);
    var exponents = 0u;
    // Lower sides of the first four children and of the others, by axis; then the upper ones.
    var lows = array<vec2<u32>, 3>(vec2<u32>(0xffffffffu), vec2<u32>(0xffffffffu), vec2<u32>(0xffffffffu));
    var highs = array<vec2<u32>, 3>(vec2<u32>(0u), vec2<u32>(0u), vec2<u32>(0u));
    for (var axis = 0u; axis < 3u && count > 0u; axis++) {
        var lo = GREATEST;
        var hi = -GREATEST;
        for (var child = 0u; child < count; child++) {
            lo = least(lo, lower_side(children[index][child], axis));
            hi = most(hi, upper_side(children[index][child], axis));
        }
        let quanta = frame(lo, hi);
        origin[axis] = quanta.origin;
        exponents |= u32(quanta.power + 127 + UNITS) << (8u * axis);
        for (var child = 0u; child < count; child++) {
            let part = children[index][child];
            let low = below(place_of(lower_side(part, axis), quanta.origin, quanta.power));
            let high = above(place_of(upper_side(part, axis), quanta.origin, quanta.power));
            lows[axis] = with_byte(lows[axis], child, min(low, 255u));
            highs[axis] = with_byte(highs[axis], child, min(high, 255u));
        }
    }
    compressed_nodes[node][0] = vec4<u32>(bitcast<vec3<u32>>(origin), exponents);
    compressed_nodes[node][1] = vec4<u32>(place.x, place.y | (inner << REFERENCE_BITS), ends.x, ends.y);
    compressed_nodes[node][2] = vec4<u32>(lows[0].x, lows[1].x, lows[2].x, highs[0].x);
    compressed_nodes[node][3] = vec4<u32>(highs[1].x, highs[2].x, lows[0].y, lows[1].y);
    compressed_nodes[node][4] = vec4<u32>(lows[2].y, highs[0].y, highs[1].y, highs[2].y);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = compress.zero;
    let count = active_count();
    let first = made_count() - count;
    for (var index = workgroup.x * LANES + lane; index < count; index += workgroups.x * LANES) {
        emit_node(index, first + index);
    }
}

// Twin of core/src/layout/points.rs and core/src/build/points.rs: the records and counters of the kernels that build trees of
// points. Needs the bindings `point_build` and `counters`.

struct PointBuild {
    // Points given.
    given: u32,
    dimensions: u32,
    // 1 where axes are the widest, 0 where they take turns.
    widest: u32,
    zero: u32,
}

// A point: coordinates as ordered bits of units, those beyond the dimensions of 0; and its index.
struct PointRecord {
    x: u32,
    y: u32,
    z: u32,
    w: u32,
    point: u32,
}

// Where a large node is divided: what is known of the coordinate, and how many points with just these bits come before the first of the right
// child.
struct PointSplit {
    axis: u32,
    bits: u32,
    rank: u32,
    known: u32,
}

struct PointExtent {
    lower: vec4<u32>,
    upper: vec4<u32>,
}

// Points of a block.
const POINT_BLOCK: u32 = 16u;
// Points of a chunk.
const POINT_CHUNK: u32 = 1024u;
// The height of a node that is a chunk.
const SMALL_HEIGHT: u32 = 6u;
// PointSplit.axis of a node that has no right child.
const UNDIVIDED: u32 = 4u;
const LANES: u32 = 256u;

// By the numbers of the counters.
fn kept_count() -> u32 {
    return counters[1];
}

fn chunk_count() -> u32 {
    return counters[2];
}

fn active_chunk_count() -> u32 {
    return counters[3];
}

fn large_count() -> u32 {
    return counters[4];
}

fn height_of_level() -> u32 {
    return counters[5];
}

fn root_height() -> u32 {
    return counters[6];
}

fn unit_exponent() -> i32 {
    return i32(counters[7]) - 127;
}

fn block_count() -> u32 {
    return (kept_count() + POINT_BLOCK - 1u) / POINT_BLOCK;
}

// The coordinate of a record along an axis.
fn bits_along(record: PointRecord, axis: u32) -> u32 {
    return select(
        select(record.x, record.y, axis == 1u),
        select(record.z, record.w, axis == 3u),
        axis > 1u,
    );
}

// The float of ordered bits.
fn from_ordered(bits: u32) -> f32 {
    return bitcast<f32>(select(~bits, bits & 0x7fffffffu, (bits >> 31u) == 1u));
}

// The block at which the node of this height with this number is divided.
fn middle_of(node: u32, height: u32) -> u32 {
    return (node << height) + (1u << (height - 1u));
}

// The axis of a node whose points reach between these coordinates, where the widest is taken.
fn widest_axis(lower: vec4<u32>, upper: vec4<u32>) -> u32 {
    var best = 0u;
    var greatest = -1.0;
    for (var axis = 0u; axis < point_build.dimensions; axis++) {
        let extent = snapped_difference(from_ordered(upper[axis]), from_ordered(lower[axis]));
        if extent > greatest {
            best = axis;
            greatest = extent;
        }
    }
    return best;
}

// The axis of a node where axes take turns: by the number of nodes above it that are divided.
fn cycled_axis(node: u32, height: u32) -> u32 {
    let blocks = block_count();
    var level = 0u;
    for (var above = height + 1u; above <= root_height(); above++) {
        let middle = middle_of(node >> (above - height), above);
        level += select(0u, 1u, middle < blocks);
    }
    return level % point_build.dimensions;
}

// Whether a coordinate of these bits is finite.
fn is_finite(bits: u32) -> bool {
    return (bits & 0x7f800000u) != 0x7f800000u;
}

// Twin of core/src/points/nearest.rs and distance.rs: the walk of a query through a tree of points, the side of each plane
// first on which the query lies. For kernels of 64 invocations.
//
// The tree is implicit, so the walk needs no stack of nodes: a block and a height name a node. What it keeps of each level
// above a block is one word in the memory of the workgroup: of a far side that is yet to be visited the bound, and of one that
// it is on what the gap along the plane's axis was before.
//
// Where the bounds of both sides are equal, the side with the lowest index comes first, and a side whose bound equals the distance that still
// counts is left out where no index in it is low enough. Points in one place need that: see core/src/points/tree/summary.rs.
//
// What is done with points stands in another part: the function `visit`, which gets a place whose squared distance counts
// and the bits of that, and may lower `stop`.

struct PointBatch {
    count: u32,
    room: u32,
    points: u32,
    height: u32,
    reach: u32,
    filtered: u32,
    zero: u32,
    padding: u32,
    lower: vec4<u32>,
    upper: vec4<u32>,
}

// The plane of each node, and its mark: the axis, whether all points are in one place, and the least index rounded down.
@group(0) @binding(0) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> allowed: array<u32>;
@group(0) @binding(3) var<storage, read> queries: array<vec4<f32>>;
@group(0) @binding(4) var<uniform> point_batch: PointBatch;

// Points of a block.
const POINT_BLOCK: u32 = 16u;
const LANES: u32 = 64u;
// Levels above blocks: 2^30 points have no more.
const LEVELS: u32 = 26u;
const ALL_LEVELS: u32 = (1u << LEVELS) - 1u;
const SLOTS: u32 = LANES * LEVELS;
// The parts of a node's mark.
const MARK_AXIS: u32 = 3u;
const MARK_ONE_PLACE: u32 = 4u;
const MARK_LEAST: u32 = 0xfffffff8u;
// In place of the number of points, or of the bits of the first distance: the driver did not let the query finish.
const POINT_BATCH_ENDED_EARLY: u32 = 0xffffffffu;

// A word a level and invocation.
var<workgroup> level_words: array<u32, SLOTS>;

// The invocation's index in its workgroup. An entry point sets it.
var<private> own_lane: u32;
// Keys from here on do not count: bits of a squared distance, and an index.
var<private> stop: vec2<u32>;

// The query of an invocation: workgroups in rows, since one dimension is not long enough.
fn query_index(workgroup: vec3<u32>, workgroups: vec3<u32>, local: u32) -> u32 {
    return (workgroup.y * workgroups.x + workgroup.x) * LANES + local;
}

// Whether a key comes before another.
fn is_before(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

// Whether the filter lets a place count.
fn is_allowed(place: u32) -> bool {
    if point_batch.filtered == 0u {
        return true;
    }
    return ((allowed[place / 32u] >> (place % 32u)) & 1u) == 1u;
}

// The sum of squares, in the order of axes.
fn sum_of_squares(d: vec4<f32>) -> f32 {
    let two = sum(snapped_product(d.x, d.x), snapped_product(d.y, d.y));
    return sum(sum(two, snapped_product(d.z, d.z)), snapped_product(d.w, d.w));
}

fn distance_squared(a: vec4<f32>, b: vec4<f32>) -> f32 {
    return sum_of_squares(vec4<f32>(
        difference(a.x, b.x),
        difference(a.y, b.y),
        difference(a.z, b.z),
        difference(a.w, b.w),
    ));
}

// One coordinate, by selection: an index that is not constant would send the vector to memory.
fn along(v: vec4<f32>, axis: u32) -> f32 {
    return select(select(v.x, v.y, axis == 1u), select(v.z, v.w, axis == 3u), axis > 1u);
}

// The same vector with another coordinate.
fn with_along(v: vec4<f32>, axis: u32, x: f32) -> vec4<f32> {
    return select(v, vec4<f32>(x), vec4<bool>(axis == 0u, axis == 1u, axis == 2u, axis == 3u));
}

// How far a query is from a plane.
fn gap_to(own: f32, plane: f32) -> f32 {
    let is_left = own < plane;
    return difference(select(own, plane, is_left), select(plane, own, is_left));
}

// How far a coordinate is from a range.
fn gap_outside(own: f32, lower: u32, upper: u32) -> f32 {
    let below = difference(bitcast<f32>(lower), own);
    let above = difference(own, bitcast<f32>(upper));
    return most(most(below, above), 0.0);
}

// How far a query is from the box around all points along each axis.
fn first_gaps(query: vec4<f32>) -> vec4<f32> {
    let lower = point_batch.lower;
    let upper = point_batch.upper;
    return vec4<f32>(
        gap_outside(query.x, lower.x, upper.x),
        gap_outside(query.y, lower.y, upper.y),
        gap_outside(query.z, lower.z, upper.z),
        gap_outside(query.w, lower.w, upper.w),
    );
}

// An index that none of the subtree of this height which begins at a block is below; 0 for a block.
fn least_index(block: u32, above: u32, blocks: u32) -> u32 {
    var height = above;
    while height > 0u {
        height -= 1u;
        let right = block + (1u << height);
        if right < blocks {
            return nodes[right - 1u].y & MARK_LEAST;
        }
    }
    return 0u;
}

// The block at which the node of this height around a block is divided.
fn middle_above(block: u32, height: u32) -> u32 {
    return (((block >> height) << 1u) | 1u) << (height - 1u);
}

// False once a driver ends the loops of the invocation: llvmpipe then lets each loop run once.
fn loops_run() -> bool {
    var rounds = 0u;
    loop {
        if rounds >= (2u ^ opaque_zero) {
            break;
        }
        rounds += 1u;
    }
    return (rounds ^ opaque_zero) == 2u;
}

// Visits all blocks that may hold a key below `stop`. False where the driver did not let the walk finish.
fn walk_points(query: vec4<f32>) -> bool {
    if point_batch.points == 0u {
        return true;
    }
    let blocks = (point_batch.points + POINT_BLOCK - 1u) / POINT_BLOCK;
    var height = point_batch.height;
    var block = 0u;
    // How far the space of the node is from the query along each axis, at least, and the bits of the bound that follows.
    var gaps = first_gaps(query);
    var own_bound = bitcast<u32>(sum_of_squares(gaps));
    if own_bound > stop.x {
        return true;
    }
    // Levels with a side that is yet to be visited, those on whose second side the walk is, and those where the right side came first.
    var waiting = 0u;
    var crossed = 0u;
    var went_right = 0u;
    loop {
        if height > 0u {
            height -= 1u;
            let right = block + (1u << height);
            if right < blocks {
                let node = nodes[right - 1u];
                let axis = node.y & MARK_AXIS;
                let plane = bitcast<f32>(node.x);
                let own = along(query, axis);
                let far = most(along(gaps, axis), gap_to(own, plane));
                var bound = bitcast<u32>(sum_of_squares(with_along(gaps, axis, far)));
                if (node.y & MARK_ONE_PLACE) != 0u {
                    bound = bitcast<u32>(distance_squared(query, points[block * POINT_BLOCK]));
                    own_bound = bound;
                }
                var left_first = own < plane;
                if bound == own_bound {
                    left_first = least_index(block, height, blocks) <= least_index(right, height, blocks);
                }
                let bit = 1u << height;
                went_right = select(went_right | bit, went_right & ~bit, left_first);
                if bound <= stop.x {
                    level_words[height * LANES + own_lane] = bound;
                    waiting |= bit;
                }
                block = select(right, block, left_first);
            }
            continue;
        }
        let first = block * POINT_BLOCK;
        let last = min(point_batch.points, first + POINT_BLOCK);
        for (var place = first; place < last; place++) {
            let bits = bitcast<u32>(distance_squared(query, points[place]));
            if bits <= stop.x && is_allowed(place) {
                visit(place, bits);
            }
        }
        // The lowest level whose second side may still hold something.
        var level = LEVELS;
        while (waiting & ALL_LEVELS) != 0u {
            let lowest = firstTrailingBit(waiting);
            waiting &= waiting - 1u;
            own_bound = level_words[lowest * LANES + own_lane];
            if own_bound < stop.x {
                level = lowest;
                break;
            }
            if own_bound == stop.x {
                let middle = middle_above(block, lowest + 1u);
                let is_right = ((went_right >> lowest) & 1u) == 0u;
                let second = select(middle - (1u << lowest), middle, is_right);
                if least_index(second, lowest, blocks) < stop.y {
                    level = lowest;
                    break;
                }
            }
        }
        if level == LEVELS {
            break;
        }
        // Back from the second sides below it.
        let below = (1u << level) - 1u;
        while (crossed & below) != 0u {
            let lowest = firstTrailingBit(crossed);
            crossed &= crossed - 1u;
            let axis = nodes[middle_above(block, lowest + 1u) - 1u].y & MARK_AXIS;
            gaps = with_along(gaps, axis, bitcast<f32>(level_words[lowest * LANES + own_lane]));
        }
        let middle = middle_above(block, level + 1u);
        let node = nodes[middle - 1u];
        let axis = node.y & MARK_AXIS;
        let plane = bitcast<f32>(node.x);
        let own = along(query, axis);
        let before = along(gaps, axis);
        let is_right = ((went_right >> level) & 1u) == 0u;
        level_words[level * LANES + own_lane] = bitcast<u32>(before);
        // The side that came second is not the far one where bounds were equal.
        let is_far = (own < plane) == is_right;
        gaps = with_along(gaps, axis, select(before, most(before, gap_to(own, plane)), is_far));
        crossed |= 1u << level;
        block = select(middle - (1u << level), middle, is_right);
        height = level;
    }
    // Some drivers end loops that run long: Mesa's llvmpipe after 65,535 rounds of all loops of an invocation.
    return ((waiting ^ opaque_zero) & ALL_LEVELS) == 0u && (height ^ opaque_zero) == 0u && loops_run();
}

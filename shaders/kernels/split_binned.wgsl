// Cuts empty space off every active node and splits it by binned SAH.
// One workgroup an active node, one invocation a border between bins, of which each axis has up to 63.
// Reads: cell and tight bounds of the node; the bins of its chunks.
// Writes: the decision: cuts of empty space, then a split or a transfer to the small list.
// Ties: least expected cost, then axis, then position.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read> node_bounds: array<f32>;
@group(0) @binding(4) var<storage, read> chunk_bins: array<u32>;
@group(0) @binding(5) var<storage, read_write> decisions: array<Decision>;

// One for each axis and bin.
const LANES: u32 = 192u;

// 1 while the current node must be split.
var<workgroup> open: u32;
// The least cost among borders that pay, word by word, and the first lane that has it.
var<workgroup> best_high: atomic<u32>;
var<workgroup> best_low: atomic<u32>;
var<workgroup> best_lane: atomic<u32>;

const NO_LANE: u32 = 0xffffffffu;

// A coordinate of a node's tight bounds: three of the lower corner, then three of the upper.
fn tight_bound(index: u32, coordinate: u32) -> f32 {
    return node_bounds[6u * index + coordinate];
}

// What the node's chunks have in one bin: starts, ends.
fn sum_bins(node: LargeNode, lane: u32) -> vec2<u32> {
    let chunks = chunks_of(node.count);
    var sum = vec2<u32>(0u);
    var at = LANES * node.first_chunk + lane;
    var i = 0u;
    // Eight at a time: see `cut_short`. Halves of a word are at most 256 each, so that eight fit as well.
    for (; i + 8u <= chunks; i += 8u) {
        let first = chunk_bins[at] + chunk_bins[at + LANES];
        let second = chunk_bins[at + 2u * LANES] + chunk_bins[at + 3u * LANES];
        let third = chunk_bins[at + 4u * LANES] + chunk_bins[at + 5u * LANES];
        let fourth = chunk_bins[at + 6u * LANES] + chunk_bins[at + 7u * LANES];
        let eight = first + second + third + fourth;
        sum += vec2<u32>(eight & 0xffffu, eight >> 16u);
        at += 8u * LANES;
    }
    for (; i < chunks; i++) {
        let word = chunk_bins[at];
        sum += vec2<u32>(word & 0xffffu, word >> 16u);
        at += LANES;
    }
    cut_short = cut_short || (i ^ opaque_zero) < chunks;
    return sum;
}

// A plane and its expected cost.
struct Border {
    cost: vec2<u32>,
    position: f32,
    // It lies strictly inside the cell, and with children taken for leaves it costs less than a leaf.
    pays: bool,
}

// The border below bin `index` of an axis, with this many references left and right of it.
fn evaluate(node: LargeNode, bins: BinAxis, axis: u32, index: u32, left: u32, right: u32) -> Border {
    let cell = Aabb(cell_lo, cell_hi);
    let extents = extents_of(cell);
    let position = bin_border(bins, index);
    if !extents.large_enough || !strictly_inside(cell, axis, position) {
        return Border(vec2<u32>(0u), position, false);
    }
    let area = half_area(extents.cells);
    let offset = quantised_offset(extents, on_axis(cell.lo, axis), position);
    let areas = split_areas(extents, axis, offset);
    let pays = wide_less(wide_split_cost(area, areas, left, right), wide_leaf_cost(area, node.count));
    return Border(expected_split_cost(area, areas, left, right), position, pays);
}

// That no border pays does not mean that none will: what is left is halved once, as the paper does. If
// that separates nothing, either, the node stays whole.
fn fallback(node: LargeNode) -> SplitPlane {
    if node.inseparable == 1u {
        return no_plane();
    }
    return spatial_median(Aabb(cell_lo, cell_hi));
}

// Finds the border of least expected cost among those that pay and decides on it.
fn choose(index: u32, node: LargeNode, lane: u32) {
    let axis = lane / MAX_BINS;
    let bin = lane % MAX_BINS;
    let before = exclusive_scan(lane, vec4<u32>(sum_bins(node, lane), 0u, 0u));
    // The scan goes over all axes: take away what stands before this one.
    let below = before - scanned(MAX_BINS * axis);
    if cut_short {
        atomicStore(&unfinished, 1u);
    }
    let bins = bins_between(tight_bound(index, axis), tight_bound(index, axis + 3u));
    var border = Border(vec2<u32>(0u), 0.0, false);
    if bins.divisible && bin > 0u && bin < parameters.bins {
        border = evaluate(node, bins, axis, bin, below.x, node.count - below.y);
    }
    // Word by word: minima of integers do not depend on order.
    if border.pays {
        atomicMin(&best_high, border.cost.y);
    }
    workgroupBarrier();
    let least_high = border.pays && border.cost.y == atomicLoad(&best_high);
    if least_high {
        atomicMin(&best_low, border.cost.x);
    }
    workgroupBarrier();
    if least_high && border.cost.x == atomicLoad(&best_low) {
        atomicMin(&best_lane, lane);
    }
    workgroupBarrier();
    let best = atomicLoad(&best_lane);
    if best == lane {
        decide_on(SplitPlane(axis, border.position, true));
    } else if best == NO_LANE && lane == 0u {
        decide_on(fallback(node));
    }
    workgroupBarrier();
}

@compute @workgroup_size(192)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    if lane == 0u {
        atomicStore(&unfinished, 0u);
    }
    let end = slice_end(active_node_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let node = active_nodes[index];
        workgroupBarrier();
        if lane == 0u {
            open = select(0u, 1u, cut_empty_space(index, node));
            atomicStore(&best_high, 0xffffffffu);
            atomicStore(&best_low, 0xffffffffu);
            atomicStore(&best_lane, NO_LANE);
        }
        if workgroupUniformLoad(&open) == 1u {
            choose(index, node, lane);
        }
        if lane == 0u {
            if atomicLoad(&unfinished) == 1u {
                decided.cut_sides |= UNDECIDED;
            }
            decisions[index] = finished_decision();
        }
    }
}

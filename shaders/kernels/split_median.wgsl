// Names the chunks of every active node, bounds it, cuts empty space off it and chooses its split.
// One workgroup an active node. Its first invocation decides; where the median separated nothing, all
// of them sweep.
// Reads: cell of the node, bounds of its parent's chunks on its side; its references where the median
// separated nothing.
// Writes: the node's chunks; the decision: cuts of empty space, then a split or a transfer to the small list.
// Ties: axes in order, then lower positions.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read> chunk_state: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> references: array<Reference>;
@group(0) @binding(5) var<storage, read_write> chunks: array<Chunk>;
@group(0) @binding(6) var<storage, read_write> decisions: array<Decision>;

const LANES: u32 = 256u;
const SWEEP_SAMPLES: u32 = 64u;

// A plane's rank: least cost (low and high word), then axis, then position.
struct Ranked {
    cost: vec2<u32>,
    axis: u32,
    order: u32,
    position: f32,
}

var<workgroup> ranked: array<Ranked, SWEEP_SAMPLES>;

fn precedes(a: Ranked, b: Ranked) -> bool {
    if a.cost.y != b.cost.y {
        return a.cost.y < b.cost.y;
    }
    if a.cost.x != b.cost.x {
        return a.cost.x < b.cost.x;
    }
    if a.axis != b.axis {
        return a.axis < b.axis;
    }
    return a.order < b.order;
}

// References on the two sides of the three planes of one corner: those that go left, and right.
struct Sides {
    left: vec3<u32>,
    right: vec3<u32>,
}

fn add_sides(sides: Sides, reference: Reference, planes: vec3<f32>) -> Sides {
    let left = (reference.lo < planes) | (reference.hi <= planes);
    let right = reference.hi > planes;
    return Sides(
        sides.left + select(vec3<u32>(0u), vec3<u32>(1u), left),
        sides.right + select(vec3<u32>(0u), vec3<u32>(1u), right),
    );
}

// The better of `best` and a plane through a face of the sample.
fn consider(best: Ranked, cell: Aabb, extents: Extents, axis: u32, planes: vec3<f32>, sides: Sides) -> Ranked {
    let position = on_axis(planes, axis);
    if !strictly_inside(cell, axis, position) {
        return best;
    }
    let offset = quantised_offset(extents, on_axis(cell.lo, axis), position);
    let areas = split_areas(extents, axis, offset);
    let cost = wide_sum(
        wide_product(areas.x, sides.left[axis]),
        wide_product(areas.y, sides.right[axis]),
    );
    let here = Ranked(cost, axis, ordered_bits(position), position);
    if precedes(here, best) {
        return here;
    }
    return best;
}

// The planes of one lane: the faces of one sample, counted against all references of the node.
fn sweep_share(node: LargeNode, cell: Aabb, extents: Extents, lane: u32) -> Ranked {
    let samples = min(node.count, SWEEP_SAMPLES);
    // The cost of a leaf, before every plane: only what costs less counts.
    var best = Ranked(wide_product(half_area(extents.cells), node.count), 0u, 0u, 0.0);
    if lane >= samples {
        return best;
    }
    // Evenly spread: lane * count / samples without overflow.
    let step = node.count / samples;
    let rest = node.count % samples;
    let sample = references[node.first + lane * step + lane * rest / samples];
    var low = Sides(vec3<u32>(0u), vec3<u32>(0u));
    var high = low;
    // Four at a time: see `cut_short`.
    var i = 0u;
    for (; i + 4u <= node.count; i += 4u) {
        let a = references[node.first + i];
        let b = references[node.first + i + 1u];
        let c = references[node.first + i + 2u];
        let d = references[node.first + i + 3u];
        low = add_sides(add_sides(low, a, sample.lo), b, sample.lo);
        low = add_sides(add_sides(low, c, sample.lo), d, sample.lo);
        high = add_sides(add_sides(high, a, sample.hi), b, sample.hi);
        high = add_sides(add_sides(high, c, sample.hi), d, sample.hi);
    }
    for (; i < node.count; i++) {
        low = add_sides(low, references[node.first + i], sample.lo);
        high = add_sides(high, references[node.first + i], sample.hi);
    }
    cut_short = cut_short || (i ^ opaque_zero) < node.count;
    for (var axis = 0u; axis < 3u; axis++) {
        best = consider(best, cell, extents, axis, sample.lo, low);
        best = consider(best, cell, extents, axis, sample.hi, high);
    }
    return best;
}

// A coordinate of the node's tight bounds: three of the lower corner, then three of the upper.
fn tight_bound(index: u32, coordinate: u32) -> f32 {
    return reduced[coordinate];
}

@compute @workgroup_size(256)
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
        name_chunks(index, node, lane);
        bound_node(node, lane);
        if lane == 0u {
            decide(index, node);
        }
        workgroupBarrier();
        // Uniform: every lane reads the same node.
        if node.inseparable == 1u {
            sweep(node, lane);
        }
        if lane == 0u {
            decisions[index] = finished_decision();
        }
    }
}

// That the median does not separate does not mean that no plane does: the best plane by SAH among the
// faces of up to 64 references, evenly spread over the node's.
fn sweep(node: LargeNode, lane: u32) {
    let cell = Aabb(cell_lo, cell_hi);
    let extents = extents_of(cell);
    let open = decided.axis != TRANSFER;
    workgroupBarrier();
    if open && extents.large_enough && lane < SWEEP_SAMPLES {
        ranked[lane] = sweep_share(node, cell, extents, lane);
        if cut_short {
            atomicStore(&unfinished, 1u);
        }
    }
    workgroupBarrier();
    if lane == 0u && atomicLoad(&unfinished) == 1u {
        decided.cut_sides |= UNDECIDED;
    }
    if lane == 0u && open {
        decided.axis = TRANSFER;
        decided.position = 0.0;
        if extents.large_enough {
            let leaf = wide_product(half_area(extents.cells), node.count);
            var best = Ranked(leaf, 0u, 0u, 0.0);
            var found = false;
            for (var i = 0u; i < min(node.count, SWEEP_SAMPLES); i++) {
                if precedes(ranked[i], best) {
                    best = ranked[i];
                    found = true;
                }
            }
            if found {
                decided.axis = best.axis;
                decided.position = best.position;
            }
        }
    }
}

// Cuts and split of one node. For a node that must be swept a split on axis 0 stands for "to be chosen".
fn decide(index: u32, node: LargeNode) {
    if !cut_empty_space(index, node) {
        return;
    }
    if node.inseparable == 1u {
        decided.axis = 0u;
        return;
    }
    decide_on(spatial_median(Aabb(cell_lo, cell_hi)));
}

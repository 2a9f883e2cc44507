// What a workgroup decides on one node, and the part that does not depend on how planes are found: cuts
// of empty space. Twin of `cut_empty_space` in backend-cpu's split_median.rs.
// Needs the binding `parameters`. The kernel says what the node's tight bounds are: `tight_bound`.

// What the first invocation has decided so far, and the cell that is left.
var<workgroup> cell_lo: vec3<f32>;
var<workgroup> cell_hi: vec3<f32>;
var<workgroup> decided: Decision;
// 1 when a lane was cut short.
var<workgroup> unfinished: atomic<u32>;

// Set when a driver ended a loop before its end: Mesa's llvmpipe does so after 65,535 rounds. The loop's
// count is compared with what it should be after an exclusive or with the barrier's zero, which keeps a
// compiler from concluding that it cannot differ.
var<private> cut_short: bool;

// Begins the decision on a node with its cuts. True when what is left is to be split; if not, the node is
// transferred after them, because it is small or at the greatest depth.
fn cut_empty_space(index: u32, node: LargeNode) -> bool {
    decided.cuts = array<f32, 6>();
    decided.cut_count = 0u;
    decided.cut_sides = 0u;
    decided.axis = TRANSFER;
    decided.position = 0.0;
    decided.counts = vec2<u32>(node.count, 0u);
    decided.first = vec2<u32>(0u);
    decided.first_node = 0u;
    decided.source_first = node.first;
    if node.count <= parameters.hand_over_limit {
        return false;
    }
    let levels_left = parameters.max_depth - node.depth;
    let tight = Aabb(
        vec3<f32>(tight_bound(index, 0u), tight_bound(index, 1u), tight_bound(index, 2u)),
        vec3<f32>(tight_bound(index, 3u), tight_bound(index, 4u), tight_bound(index, 5u)),
    );
    let rest = without_empty_space(Aabb(node.lo, node.hi), tight);
    var cuts = 0u;
    for (var sides = first_sides(rest.sides, levels_left); sides != 0u; sides &= sides - 1u) {
        let side = firstTrailingBit(sides);
        decided.cuts[cuts] = tight_bound(index, side / 2u + select(0u, 3u, side % 2u == 1u));
        decided.cut_sides |= side << (4u * cuts);
        cuts += 1u;
    }
    decided.cut_count = cuts;
    cell_lo = rest.cell.lo;
    cell_hi = rest.cell.hi;
    return cuts < levels_left;
}

// What follows the cuts: a split at this plane, or a transfer where there is none.
fn decide_on(plane: SplitPlane) {
    decided.axis = select(TRANSFER, plane.axis, plane.found);
    decided.position = select(0.0, plane.position, plane.found);
}

// The decision as it is written: what a split gives to the children is counted later.
fn finished_decision() -> Decision {
    if decided.axis != TRANSFER {
        decided.counts = vec2<u32>(0u);
    }
    return decided;
}

// What an active node becomes: its part of the top tree, and its children on the next and the small list.
// Needs the bindings of `allocate_children`.

// Levels before this one.
var<private> level: u32;

fn interior(axis: u32, position: f32, left: u32, right: u32) -> TopNode {
    return TopNode(axis, bitcast<u32>(position), left, right);
}

// Whether a child goes to the next list.
fn is_large(decision: Decision, count: u32) -> bool {
    return decision.axis != TRANSFER && count > parameters.hand_over_limit;
}

// How many top nodes a node emits.
fn emitted_by(decision: Decision) -> u32 {
    return 2u * decision.cut_count + select(2u, 0u, decision.axis == TRANSFER);
}

// Where the references of both children begin, from where those of the node's large and small children do.
fn first_references(decision: Decision, firsts: vec2<u32>) -> vec2<u32> {
    if decision.axis == TRANSFER {
        return vec2<u32>(firsts.y, 0u);
    }
    let left_is_large = is_large(decision, decision.counts.x);
    let after = firsts + select(vec2<u32>(0u, decision.counts.x), vec2<u32>(decision.counts.x, 0u), left_is_large);
    return vec2<u32>(
        select(firsts.y, firsts.x, left_is_large),
        select(after.y, after.x, is_large(decision, decision.counts.y)),
    );
}

// The top node that says where a node's children begin until they are written: one that is written then.
fn place_of_places(decision: Decision, node: u32) -> u32 {
    return select(decision.first_node, node, emitted_by(decision) == 0u);
}

// One child: its place in the next or the small list, if it has references.
fn place_child(
    decision: Decision,
    node: LargeNode,
    cell: Aabb,
    depth: u32,
    top: u32,
    side: u32,
    index: u32,
    first_chunk: u32,
) {
    let count = select(decision.counts.x, decision.counts.y, side == 1u);
    let first = select(decision.first.x, decision.first.y, side == 1u);
    if count == 0u {
        return;
    }
    if is_large(decision, count) {
        if index < parameters.node_room {
            let inseparable = all(decision.counts == vec2<u32>(node.count));
            next_nodes[index] = LargeNode(
                cell.lo, first, cell.hi, count, top, depth, node.first_chunk, chunks_of(node.count),
                side, select(0u, 1u, inseparable), first_chunk, 0u,
            );
        }
    } else {
        top_nodes[top] = TopNode(SMALL_ROOT, 0u, index, 0u);
        if index < parameters.small_root_room {
            // Levels before the one that would split it.
            let before = level + select(1u, 0u, decision.axis == TRANSFER);
            small_roots[index] =
                SmallRoot(cell.lo, first, cell.hi, count, top, depth, before, 0u);
        }
    }
}

// Writes one node's part of the top tree and its children, for which there is room. Said are their places in the next list and the small list, and their
// first chunk.
fn emit_nodes(index: u32, decision: Decision, node: LargeNode, next: u32, small: u32, chunk: u32) {
    var top = decision.first_node;
    var current = node.node;
    var cell = Aabb(node.lo, node.hi);
    var depth = node.depth;
    for (var i = 0u; i < decision.cut_count; i++) {
        let side = (decision.cut_sides >> (4u * i)) & 0xfu;
        let axis = side / 2u;
        // From the list: of a variable the index would need memory.
        let position = decisions[index].cuts[i];
        let low = side % 2u == 0u;
        top_nodes[top] = TopNode(EMPTY, 0u, 0u, 0u);
        top_nodes[top + 1u] = TopNode(EMPTY, 0u, 0u, 0u);
        top_nodes[current] = interior(
            axis, position, select(top + 1u, top, low), select(top, top + 1u, low));
        if low {
            cell.lo = with_axis(cell.lo, axis, position);
        } else {
            cell.hi = with_axis(cell.hi, axis, position);
        }
        current = top + 1u;
        top += 2u;
        depth += 1u;
    }
    if decision.axis == TRANSFER {
        // Never large: the transfer says so.
        place_child(decision, node, cell, depth, current, 0u, small, 0u);
        return;
    }
    let axis = decision.axis;
    let position = decision.position;
    top_nodes[top] = TopNode(EMPTY, 0u, 0u, 0u);
    top_nodes[top + 1u] = TopNode(EMPTY, 0u, 0u, 0u);
    top_nodes[current] = interior(axis, position, top, top + 1u);
    // Next list, small list.
    var here = vec2<u32>(next, small);
    var first_chunk = chunk;
    for (var side = 0u; side < 2u; side++) {
        let count = select(decision.counts.x, decision.counts.y, side == 1u);
        let large = is_large(decision, count);
        var part = cell;
        if side == 0u {
            part.hi = with_axis(cell.hi, axis, position);
        } else {
            part.lo = with_axis(cell.lo, axis, position);
        }
        let child = select(here.y, here.x, large);
        place_child(decision, node, part, depth + 1u, top + side, side, child, first_chunk);
        if large {
            here.x += 1u;
            first_chunk += chunks_of(count);
        } else if count > 0u {
            here.y += 1u;
        }
    }
}

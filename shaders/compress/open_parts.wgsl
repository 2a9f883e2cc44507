// Opens each part of the batch until it has eight children, or only leaves.
// One invocation a part.
// Reads: the tree and its triangles; the parts that wait.
// Writes: the children of each part, those that become nodes first; how many these are, and how many references the others have.
// Ties: of subtrees of equal area the first is opened.

@group(0) @binding(0) var<uniform> compress: Compress;
@group(0) @binding(1) var<storage, read> counters: array<u32, 8>;
@group(0) @binding(2) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(4) var<storage, read> triangles: array<f32>;
@group(0) @binding(5) var<storage, read> parts: array<Part>;
@group(0) @binding(6) var<storage, read_write> children: array<array<Part, 8>>;
@group(0) @binding(7) var<storage, read_write> child_counts: array<vec2<u32>>;

const LANES: u32 = 32u;

// Eight parts for each invocation.
var<workgroup> opened: array<Part, 256>;

// Whether a node is an empty leaf.
fn is_empty_leaf(node: u32) -> bool {
    return nodes[node].y == 3u;
}

// One side of a subtree's plane, whose node has these words.
fn half_of(part: Part, words: vec2<u32>, high: bool) -> Part {
    let axis = words.y & 3u;
    let split = bitcast<f32>(words.x);
    let lo = select(part.lo, with_axis(part.lo, axis, split), high);
    let hi = select(with_axis(part.hi, axis, split), part.hi, high);
    return Part(lo, select(part.first + 1u, words.y >> 2u, high), hi, part.count);
}

// The highest part of a subtree with references on both sides of its plane, or its only leaf that has any.
fn resolved(given: Part) -> Part {
    var part = given;
    while part.count == SUBTREE {
        let words = nodes[part.first];
        if (words.y & 3u) == 3u {
            part.first = words.x;
            part.count = words.y >> 2u;
            break;
        }
        let low_is_empty = is_empty_leaf(part.first + 1u);
        if !low_is_empty && !is_empty_leaf(words.y >> 2u) {
            break;
        }
        part = half_of(part, words, low_is_empty);
    }
    return part;
}

// Half the surface area of a cell, of halved extents.
fn half_area(part: Part) -> f32 {
    let e = half_extents(Aabb(part.lo, part.hi));
    let first = snapped_sum(snapped_product(e.x, e.y), snapped_product(e.y, e.z));
    return snapped_sum(first, snapped_product(e.z, e.x));
}

// A leaf with the part of its cell that its triangles' bounds reach into.
fn bounded(leaf: Part) -> Part {
    var all = empty_aabb();
    for (var at = 0u; at < leaf.count; at++) {
        let corners = corners_of(leaf_references[leaf.first + at]);
        let lo = least3(least3(corners.a, corners.b), corners.c);
        let hi = most3(most3(corners.a, corners.b), corners.c);
        all = Aabb(least3(all.lo, lo), most3(all.hi, hi));
    }
    let within = Aabb(most3(all.lo, leaf.lo), least3(all.hi, leaf.hi));
    let lost = is_empty(within);
    return Part(
        select(within.lo, leaf.lo, lost),
        leaf.first,
        select(within.hi, leaf.hi, lost),
        leaf.count,
    );
}

// Opens a subtree, with its parts from `base` on. Returns how many there are.
fn open_subtree(part: Part, base: u32) -> u32 {
    opened[base] = part;
    var count = 1u;
    while count < CHILDREN {
        var widest = CHILDREN;
        var most_area = 0.0;
        for (var place = 0u; place < count; place++) {
            let own = opened[base + place];
            if own.count == SUBTREE {
                let area = half_area(own);
                if widest == CHILDREN || area > most_area {
                    widest = place;
                    most_area = area;
                }
            }
        }
        if widest == CHILDREN {
            break;
        }
        let whole = opened[base + widest];
        let words = nodes[whole.first];
        for (var side = 0u; side < 2u; side++) {
            let half = resolved(half_of(whole, words, side == 1u));
            opened[base + select(widest, count, side == 1u)] = half;
        }
        count++;
    }
    return count;
}

// Divides references among as many children as they need. Returns how many there are.
fn share(part: Part, base: u32) -> u32 {
    let count = min((part.count + LEAF_MOST - 1u) / LEAF_MOST, CHILDREN);
    var next = part.first;
    for (var place = 0u; place < count; place++) {
        let own = part.count / count + select(0u, 1u, place < part.count % count);
        opened[base + place] = Part(part.lo, next, part.hi, own);
        next += own;
    }
    return count;
}

fn open_part(index: u32, base: u32) {
    let part = resolved(parts[made_count() + index]);
    var count = 0u;
    if part.count == SUBTREE {
        count = open_subtree(part, base);
    } else {
        count = share(part, base);
    }
    var next = 0u;
    var counts = vec2<u32>(0u);
    for (var place = 0u; place < count; place++) {
        let child = opened[base + place];
        if is_node(child) {
            children[index][next] = child;
            counts.x++;
            next++;
        }
    }
    for (var place = 0u; place < count; place++) {
        let child = opened[base + place];
        // A foreign tree may have parts without references: they are no children.
        if !is_node(child) && child.count > 0u {
            children[index][next] = bounded(child);
            counts.y += child.count;
            next++;
        }
    }
    for (; next < CHILDREN; next++) {
        children[index][next] = Part(vec3<f32>(0.0), 0u, vec3<f32>(0.0), 0u);
    }
    child_counts[index] = counts;
}

@compute @workgroup_size(32)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = compress.zero;
    let count = waiting_count();
    for (var index = workgroup.x * LANES + lane; index < count; index += workgroups.x * LANES) {
        open_part(index, lane * CHILDREN);
    }
}

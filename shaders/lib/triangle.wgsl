// Twin of core/src/triangle.rs: what is kept of the input, and clipping to one side of a plane.

// See core/src/triangle.rs for what these bound.
const GREATEST_CLIPPED: f32 = 0x1p126f;
const LEAST_CLIPPED: f32 = 0x1p-100f;
const OUTWARD: f32 = 0x1p-20f;
const OUTWARD_LEAST: f32 = 0x1p-120f;

struct Corners {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

// Whether a triangle of snapped corners, as bits, is kept: finite, and no two corners equal. On bits,
// since a device may assume that infinities and NaN do not occur.
fn is_kept(a: vec3<u32>, b: vec3<u32>, c: vec3<u32>) -> bool {
    let infinite = vec3<u32>(0x7f800000u);
    let magnitude = max(max(a & vec3<u32>(0x7fffffffu), b & vec3<u32>(0x7fffffffu)), c & vec3<u32>(0x7fffffffu));
    return all(magnitude < infinite) && any(a != b) && any(b != c) && any(c != a);
}

// Bounds of the parts of a triangle on the two sides of a plane.
struct Parts {
    left: Aabb,
    right: Aabb,
}

// Widens bounds to a corner. Corners are snapped: there is no -0 that a minimum may or may not prefer.
fn enclose(bounds: Aabb, point: vec3<f32>) -> Aabb {
    return Aabb(min(bounds.lo, point), max(bounds.hi, point));
}

// Where an edge crosses the plane, on one other axis: the least and the greatest it may be.
fn crossing(ratio: f32, low: f32, high: f32) -> vec2<f32> {
    let along = snapped_difference(high, low);
    let point = snapped_sum(low, snapped_product(ratio, along));
    let reach = most(abs(low), abs(high));
    let error = snapped_sum(snapped_product(reach, OUTWARD), OUTWARD_LEAST);
    return vec2<f32>(snapped_difference(point, error), snapped_sum(point, error));
}

// The parts of a triangle on the two axes that follow the plane's: y and z, z and x, or x and y.
struct Edge {
    left_lo: vec2<f32>,
    left_hi: vec2<f32>,
    right_lo: vec2<f32>,
    right_hi: vec2<f32>,
    // An edge extends too little across the plane to be cut.
    unclipped: bool,
}

// The vector with the plane's axis first, and back.
fn turned(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v, v.yzx, axis == 1u), v.zxy, axis == 2u);
}

fn turned_back(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v, v.zxy, axis == 1u), v.yzx, axis == 2u);
}

// Adds the share of an edge between two corners, both with the plane's axis first.
fn clip_edge(parts: Edge, p: vec3<f32>, q: vec3<f32>, plane: f32) -> Edge {
    var out = parts;
    // A corner in the plane belongs to both sides.
    if p.x <= plane {
        out.left_lo = min(out.left_lo, p.yz);
        out.left_hi = max(out.left_hi, p.yz);
    }
    if p.x >= plane {
        out.right_lo = min(out.right_lo, p.yz);
        out.right_hi = max(out.right_hi, p.yz);
    }
    // From the lower end in both triangles of an edge, so that both compute the same point.
    let upward = p.x < q.x;
    let low = select(q, p, upward);
    let high = select(p, q, upward);
    if !(low.x < plane && plane < high.x) {
        return out;
    }
    let across = snapped_difference(high.x, low.x);
    if across < LEAST_CLIPPED {
        out.unclipped = true;
        return out;
    }
    let ratio = quotient(snapped_difference(plane, low.x), across);
    let y = crossing(ratio, low.y, high.y);
    let z = crossing(ratio, low.z, high.z);
    let lo = vec2<f32>(y.x, z.x);
    let hi = vec2<f32>(y.y, z.y);
    out.left_lo = select(out.left_lo, lo, lo < out.left_lo);
    out.left_hi = select(out.left_hi, hi, hi > out.left_hi);
    out.right_lo = select(out.right_lo, lo, lo < out.right_lo);
    out.right_hi = select(out.right_hi, hi, hi > out.right_hi);
    return out;
}

// Bounds of the parts left and right of a plane within the old bounds, rounded outward (Zhou et al.
// 2008, Algorithm 2, "clip"). The plane lies strictly between the old bounds on its axis.
fn clip(corners: Corners, bounds: Aabb, axis: u32, plane: f32) -> Parts {
    return limited(clip_edges(corners, axis, plane), bounds, axis, plane);
}

// No part on either side.
fn no_parts() -> Edge {
    let lo = vec2<f32>(GREATEST);
    return Edge(lo, -lo, lo, -lo, true);
}

// The parts of a triangle on the two sides of a plane, but on the plane's axis.
fn clip_edges(corners: Corners, axis: u32, plane: f32) -> Edge {
    var edge = no_parts();
    let reach = most3(most3(abs(corners.a), abs(corners.b)), abs(corners.c));
    if any(reach > vec3<f32>(GREATEST_CLIPPED)) {
        return edge;
    }
    edge.unclipped = false;
    let a = turned(corners.a, axis);
    let b = turned(corners.b, axis);
    let c = turned(corners.c, axis);
    edge = clip_edge(edge, a, b, plane);
    if edge.unclipped {
        return edge;
    }
    edge = clip_edge(edge, b, c, plane);
    if edge.unclipped {
        return edge;
    }
    return clip_edge(edge, c, a, plane);
}

// The old bounds on both sides of a plane, narrowed to the triangle's parts.
fn limited(edge: Edge, bounds: Aabb, axis: u32, plane: f32) -> Parts {
    var limits = Parts(bounds, bounds);
    limits.left.hi = with_axis(bounds.hi, axis, plane);
    limits.right.lo = with_axis(bounds.lo, axis, plane);
    if edge.unclipped {
        return limits;
    }
    limits.left = narrowed(limits.left, edge.left_lo, edge.left_hi, axis);
    limits.right = narrowed(limits.right, edge.right_lo, edge.right_hi, axis);
    return limits;
}

// Limits narrowed to a part, but on the plane's axis.
fn narrowed(limit: Aabb, lo: vec2<f32>, hi: vec2<f32>, axis: u32) -> Aabb {
    return Aabb(
        most3(limit.lo, turned_back(vec3<f32>(-GREATEST, lo), axis)),
        least3(limit.hi, turned_back(vec3<f32>(GREATEST, hi), axis)),
    );
}

// True when corners within the bounds show, without clipping, that the triangle has points on both
// sides.
fn corners_on_both_sides(corners: Corners, bounds: Aabb, axis: u32, plane: f32) -> bool {
    let a = all(bounds.lo <= corners.a) && all(corners.a <= bounds.hi);
    let b = all(bounds.lo <= corners.b) && all(corners.b <= bounds.hi);
    let c = all(bounds.lo <= corners.c) && all(corners.c <= bounds.hi);
    let a_axis = on_axis(corners.a, axis);
    let b_axis = on_axis(corners.b, axis);
    let c_axis = on_axis(corners.c, axis);
    let left = (a && a_axis <= plane) || (b && b_axis <= plane) || (c && c_axis <= plane);
    let right = (a && a_axis >= plane) || (b && b_axis >= plane) || (c && c_axis >= plane);
    return left && right;
}

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

// One edge's share of the parts. On the plane's own axis what is found is never used.
struct Edge {
    parts: Parts,
    // The edge extends too little across the plane to be cut.
    unclipped: bool,
}

fn clip_edge(parts: Parts, p: vec3<f32>, q: vec3<f32>, axis: u32, plane: f32) -> Edge {
    var out = Edge(parts, false);
    let p_axis = on_axis(p, axis);
    let q_axis = on_axis(q, axis);
    // A corner in the plane belongs to both sides.
    if p_axis <= plane {
        out.parts.left = enclose(out.parts.left, p);
    }
    if p_axis >= plane {
        out.parts.right = enclose(out.parts.right, p);
    }
    let crosses = (p_axis < plane && plane < q_axis) || (q_axis < plane && plane < p_axis);
    if !crosses {
        return out;
    }
    // From the lower end in both triangles of an edge, so that both compute the same point.
    let upward = p_axis < q_axis;
    let low = select(q, p, upward);
    let high = select(p, q, upward);
    let low_axis = on_axis(low, axis);
    let across = snapped_difference(on_axis(high, axis), low_axis);
    if across < LEAST_CLIPPED {
        out.unclipped = true;
        return out;
    }
    let ratio = quotient(snapped_difference(plane, low_axis), across);
    let x = crossing(ratio, low.x, high.x);
    let y = crossing(ratio, low.y, high.y);
    let z = crossing(ratio, low.z, high.z);
    let lo = vec3<f32>(x.x, y.x, z.x);
    let hi = vec3<f32>(x.y, y.y, z.y);
    out.parts.left = Aabb(least3(out.parts.left.lo, lo), most3(out.parts.left.hi, hi));
    out.parts.right = Aabb(least3(out.parts.right.lo, lo), most3(out.parts.right.hi, hi));
    return out;
}

// Bounds of the parts left and right of a plane within the old bounds, rounded outward (Zhou et al.
// 2008, Algorithm 2, "clip"). The plane lies strictly between the old bounds on its axis.
fn clip(corners: Corners, bounds: Aabb, axis: u32, plane: f32) -> Parts {
    return limited(clip_edges(corners, axis, plane), bounds, axis, plane);
}

// The parts of a triangle on the two sides of a plane, but on the plane's axis.
fn clip_edges(corners: Corners, axis: u32, plane: f32) -> Edge {
    var edge = Edge(Parts(empty_aabb(), empty_aabb()), true);
    let reach = most3(most3(abs(corners.a), abs(corners.b)), abs(corners.c));
    if any(reach > vec3<f32>(GREATEST_CLIPPED)) {
        return edge;
    }
    edge = clip_edge(edge.parts, corners.a, corners.b, axis, plane);
    if edge.unclipped {
        return edge;
    }
    edge = clip_edge(edge.parts, corners.b, corners.c, axis, plane);
    if edge.unclipped {
        return edge;
    }
    return clip_edge(edge.parts, corners.c, corners.a, axis, plane);
}

// The old bounds on both sides of a plane, narrowed to the triangle's parts.
fn limited(edge: Edge, bounds: Aabb, axis: u32, plane: f32) -> Parts {
    var limits = Parts(bounds, bounds);
    limits.left.hi = with_axis(bounds.hi, axis, plane);
    limits.right.lo = with_axis(bounds.lo, axis, plane);
    if edge.unclipped {
        return limits;
    }
    let on = vec3<bool>(axis == 0u, axis == 1u, axis == 2u);
    limits.left = narrowed(limits.left, edge.parts.left, on);
    limits.right = narrowed(limits.right, edge.parts.right, on);
    return limits;
}

// Limits narrowed to a part, but on the plane's axis.
fn narrowed(limit: Aabb, part: Aabb, on: vec3<bool>) -> Aabb {
    return Aabb(
        select(most3(limit.lo, part.lo), limit.lo, on),
        select(least3(limit.hi, part.hi), limit.hi, on),
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

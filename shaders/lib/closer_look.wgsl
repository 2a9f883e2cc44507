// Twin of core/src/query/intersect/closer_look.rs: `t` and weights of triangles that interpolation by rounded edge
// functions does not serve.

// Edge functions from here on, per R P, leave no doubt that the ray meets the triangle itself.
const ROBUST: f32 = 0x1p-18f;
// Sheared coordinates from here on need no scaling.
const WIDTH_LEAST: f32 = 0x1p-16f;
// Smaller ones are brought near this power of two.
const WIDTH_POWER: i32 = 30;
// Images deeper than this many times their greatest sheared coordinate are needles along the ray.
const NEEDLE: f32 = 7.0;
// Images with less area than this, where coordinates are near 1, are taken for their longest edge.
const THIN: f32 = 0x1p-21f;
// Distances from a plane, times its normal, count as 0 below this.
const DISTANCE_LEAST: f32 = 0x1p-90f;
// Products below this, of coordinates of which the greatest is near 1, count as 0.
const PRODUCT_LEAST: f32 = 0x1p-78f;

// Whether the ray passes all three edges by more than images err. `area` is R P.
fn is_robust(edges: vec3<f32>, area: f32) -> bool {
    let lowest = least_of(abs(edges));
    return lowest > 0.0 && product(area, ROBUST) <= lowest;
}

// One component of a cross product.
fn loose_minor(p_i: Double, p_j: Double, q_i: Double, q_j: Double) -> Double {
    return double_minus(double_times_loosely(p_i, q_j), double_times_loosely(p_j, q_i));
}

fn loose_cross(p: Double3, q: Double3) -> Double3 {
    return Double3(
        loose_minor(p.y, p.z, q.y, q.z),
        loose_minor(p.z, p.x, q.z, q.x),
        loose_minor(p.x, p.y, q.x, q.y),
    );
}

// The dot product, rounded.
fn loose_dot(p: Double3, q: Double3) -> f32 {
    let x = double_times_loosely(p.x, q.x);
    let y = double_times_loosely(p.y, q.y);
    let z = double_times_loosely(p.z, q.z);
    let first = two_sum(x.high, y.high);
    let second = two_sum(first.high, z.high);
    let low = sum(sum(x.low, y.low), z.low);
    return sum(second.high, sum(low, sum(first.low, second.low)));
}

// Where the ray meets the plane of a triangle, and the weights of that point.
fn refined(origin: vec3<f32>, direction: vec3<f32>, triangle: Triangle, width: f32) -> Candidate {
    let power = select(0, WIDTH_POWER - exponent(width), width < WIDTH_LEAST);
    var a = triangle.a;
    var b = triangle.b;
    var c = triangle.c;
    var start = origin;
    if power != 0 {
        // Upward, and so without error.
        a = scale3(a, power);
        b = scale3(b, power);
        c = scale3(c, power);
        start = scale3(start, power);
    }
    let ab = double3_difference_of(b, a);
    let ac = double3_difference_of(c, a);
    let oa = double3_difference_of(a, start);
    let way = double3_of(direction);
    let normal = loose_cross(ab, ac);
    let across = loose_cross(way, oa);
    let det = loose_dot(normal, way);
    let distance = loose_dot(normal, oa);
    var t = quotient(select(distance, 0.0, abs(distance) < DISTANCE_LEAST), det);
    if power != 0 {
        t = scale(t, -power);
    }
    return Candidate(
        true,
        t,
        quotient(-loose_dot(across, ac), det),
        quotient(loose_dot(across, ab), det),
    );
}

// The product without error, or 0.
fn flat_product(a: f32, b: f32) -> Double {
    let exact = two_product(a, b);
    if abs(exact.high) < PRODUCT_LEAST {
        return Double(0.0, 0.0);
    }
    return exact;
}

// An edge function of an image that is met from one side: none is negative.
fn careful_weight(a: vec2<f32>, b: vec2<f32>, side: i32) -> Double {
    let one = flat_product(a.x, b.y);
    let other = flat_product(a.y, b.x);
    var edge = double_minus(one, other);
    if side < 0 {
        edge = double_minus(other, one);
    }
    if edge.high > 0.0 {
        return edge;
    }
    return Double(0.0, 0.0);
}

// Where the ray meets the image of a triangle, and the weights of that point.
fn careful(seen: Sheared, depths: vec3<f32>, side: i32) -> Candidate {
    let x = -exponent(most_of(abs(vec3<f32>(seen.a.x, seen.b.x, seen.c.x))));
    let y = -exponent(most_of(abs(vec3<f32>(seen.a.y, seen.b.y, seen.c.y))));
    let a = vec2<f32>(scale(seen.a.x, x), scale(seen.a.y, y));
    let b = vec2<f32>(scale(seen.b.x, x), scale(seen.b.y, y));
    let c = vec2<f32>(scale(seen.c.x, x), scale(seen.c.y, y));
    let u = careful_weight(c, b, side);
    let v = careful_weight(a, c, side);
    let w = careful_weight(b, a, side);
    let det = double_plus(double_plus(u, v), w);
    if det.high < THIN {
        return on_longest_edge(a, b, c, depths);
    }
    let ab = double_plus(double_times_float(u, depths.x), double_times_float(v, depths.y));
    let total = double_plus(ab, double_times_float(w, depths.z));
    return Candidate(
        true,
        quotient(total.high, det.high),
        quotient(v.high, det.high),
        quotient(w.high, det.high),
    );
}

// The longest edge so far, how far along it the point nearest to the ray is, and its depth.
struct LongestEdge {
    squared: f32,
    along: f32,
    depth: f32,
    // Which corner it starts at.
    from_corner: u32,
}

fn longer_edge(
    best: LongestEdge,
    p: vec2<f32>,
    q: vec2<f32>,
    p_depth: f32,
    q_depth: f32,
    from_corner: u32,
) -> LongestEdge {
    let edge = vec2<f32>(difference(q.x, p.x), difference(q.y, p.y));
    let squared = snapped_sum(snapped_product(edge.x, edge.x), snapped_product(edge.y, edge.y));
    if squared > best.squared {
        let dot = double_plus(flat_product(edge.x, p.x), flat_product(edge.y, p.y)).high;
        let along = snap(least(most(quotient(-dot, squared), 0.0), 1.0));
        let depth = product(along, difference(q_depth, p_depth));
        return LongestEdge(squared, along, sum(p_depth, depth), from_corner);
    }
    return best;
}

// The point of an image's longest edge that is nearest to the ray.
fn on_longest_edge(a: vec2<f32>, b: vec2<f32>, c: vec2<f32>, depths: vec3<f32>) -> Candidate {
    var best = LongestEdge(0.0, 0.0, depths.x, 0u);
    best = longer_edge(best, a, b, depths.x, depths.y, 0u);
    best = longer_edge(best, b, c, depths.y, depths.z, 1u);
    best = longer_edge(best, c, a, depths.z, depths.x, 2u);
    let rest = difference(1.0, best.along);
    // From the first corner on, to the second; from the second to the third; from the third to the first.
    let u = select(select(0.0, rest, best.from_corner == 1u), best.along, best.from_corner == 0u);
    let v = select(select(0.0, rest, best.from_corner == 2u), best.along, best.from_corner == 1u);
    return Candidate(true, best.depth, u, v);
}

// Twin of core/src/query/certify.rs except for the traversal: what is certain about a ray and a triangle,
// decided in f32 and double-float numbers with bounds on every error. Needs watertight.wgsl for its
// shear and its doubles. The bounds are derived in docs/design/exact.md.

// Products are taken to be at least this great where their errors are bounded.
const MAGNITUDE_LEAST: f32 = 0x1p-72f;
// Error of a distance, per unit of those of its parts over the denominator.
const SPREAD: f32 = 2.25;
// Error of a quotient of doubles, relative.
const QUOTIENT_NOISE: f32 = 0x1p-41f;
// Least error of a distance that is not exactly zero.
const DISTANCE_NOISE: f32 = 0x1p-110f;
// What a distance loses as a single float.
const FLOAT_NOISE: f32 = 0x1p-22f;
// Distances from 2 to the power of this up are left undecided, so that nothing overflows.
const GREATEST_EXPONENT: i32 = 60;

// A number known within an error. An error of zero means that the number is zero, exactly.
struct Known {
    value: Double,
    error: f32,
}

// p_i q_j - p_j q_i: one component of a cross product.
fn double_minor(p_i: Double, p_j: Double, q_i: Double, q_j: Double) -> Double {
    return double_minus(double_times(p_i, q_j), double_times(p_j, q_i));
}

// A cross product, and for each component the sum of the magnitudes of its terms.
struct Normal {
    parts: Double3,
    magnitudes: vec3<f32>,
}

// A bound on the magnitude of a product that is 0 only where a factor is.
fn magnitude(a: f32, b: f32) -> f32 {
    let size = most(product(abs(a), abs(b)), MAGNITUDE_LEAST);
    return select(size, 0.0, a == 0.0 || b == 0.0);
}

fn certain_cross(p: Double3, q: Double3) -> Normal {
    return certain_cross_of_sizes(p, q, p.high, q.high);
}

// The same of vectors that may be less than the terms that they are sums of: `p_sizes` and `q_sizes` are those.
fn certain_cross_of_sizes(
    p: Double3,
    q: Double3,
    p_sizes: vec3<f32>,
    q_sizes: vec3<f32>,
) -> Normal {
    var normal: Normal;
    // In a loop, which keeps the shader small.
    for (var k = 0u; k < 3u; k++) {
        let i = axis_after(k);
        let j = axis_after(i);
        let p_i = double_on_axis(p, i);
        let p_j = double_on_axis(p, j);
        let q_i = double_on_axis(q, i);
        let q_j = double_on_axis(q, j);
        let minor = double_minor(p_i, p_j, q_i, q_j);
        normal.parts.high[k] = minor.high;
        normal.parts.low[k] = minor.low;
        let one = magnitude(on_axis(p_sizes, i), on_axis(q_sizes, j));
        normal.magnitudes[k] = sum(one, magnitude(on_axis(p_sizes, j), on_axis(q_sizes, i)));
    }
    return normal;
}

fn certain_dot(normal: Normal, other: Double3) -> Known {
    var total: Double;
    var size: f32;
    for (var k = 0u; k < 3u; k++) {
        let component = double_on_axis(other, k);
        let term = double_times(double_on_axis(normal.parts, k), component);
        let term_size = magnitude(on_axis(normal.magnitudes, k), component.high);
        if k == 0u {
            total = term;
            size = term_size;
        } else {
            total = double_plus(total, term);
            size = sum(size, term_size);
        }
    }
    return Known(total, product(size, DOUBLE_NOISE));
}

// A triangle that is certainly met, between the ray's limits.
struct Certain {
    // Inner `t`.
    t: Double,
    // The exact one differs from it by no more than this. Zero only where both are zero.
    error: f32,
    u: f32,
    v: f32,
}

// A float that is no more than the exact `t`.
fn least_t(met: Certain) -> f32 {
    let single = product(abs(met.t.high), FLOAT_NOISE);
    return difference(difference(met.t.high, met.error), single);
}

// A float that is no less than the exact `t`.
fn greatest_t(met: Certain) -> f32 {
    let single = product(abs(met.t.high), FLOAT_NOISE);
    return sum(sum(met.t.high, met.error), single);
}

// Not met between the limits, or not of interest.
const VERDICT_NOT: u32 = 0u;
// Met between the limits.
const VERDICT_MET: u32 = 1u;
// Perhaps met, and if so then no nearer than at the inner `t` `least`.
const VERDICT_IN_DOUBT: u32 = 2u;

// What is certain of a ray and a triangle.
struct Verdict {
    kind: u32,
    least: f32,
    met: Certain,
}

fn verdict_not() -> Verdict {
    return Verdict(VERDICT_NOT, 0.0, Certain(Double(0.0, 0.0), 0.0, 0.0, 0.0));
}

fn verdict_in_doubt(least: f32) -> Verdict {
    return Verdict(VERDICT_IN_DOUBT, least, Certain(Double(0.0, 0.0), 0.0, 0.0, 0.0));
}

// What is certain of a ray and a triangle of a scene that is not wide. Of what is farther than
// `farthest`, an inner `t`, nothing need be said.
fn examine(ray: PreparedRay, triangle: Triangle, culling: u32, farthest: f32) -> Verdict {
    let screened = screen(ray, triangle, culling, farthest);
    if !screened.some {
        return verdict_not();
    }
    return decide(ray, triangle, culling, farthest, screened);
}

fn corner_of(triangle: Triangle, corner: u32) -> vec3<f32> {
    return select(select(triangle.a, triangle.b, corner == 1u), triangle.c, corner == 2u);
}

// An edge function and its error: as sheared where that is decided, else by the triple product of the
// direction and the two corners, of which the edge itself takes the place of one. In the units of the
// sheared ones, in which its last digits do not count.
fn decide_edge(
    ray: PreparedRay,
    sheared: f32,
    margin: f32,
    p: vec3<f32>,
    q: vec3<f32>,
    from_second: bool,
) -> vec2<f32> {
    if abs(sheared) > margin {
        return vec2<f32>(sheared, margin);
    }
    var first = double3_difference_of(p, ray.origin);
    var second = double3_difference_of(q, p);
    if from_second {
        first = double3_difference_of(p, q);
        second = double3_difference_of(q, ray.origin);
    }
    let normal = certain_cross(first, second);
    let known = certain_dot(normal, double3_of(ray.direction));
    let unit = abs(ray.shear.z);
    return vec2<f32>(product(known.value.high, unit), product(known.error, unit));
}

// Whether an edge function, with its error, is neither positive nor negative for certain, nor zero.
fn is_open(edge: vec2<f32>) -> bool {
    return edge.y != 0.0 && abs(edge.x) <= edge.y;
}

// Of which signs edge functions are for certain, and what is known of them.
struct EdgeSigns {
    known: vec3<f32>,
    positive: bool,
    negative: bool,
    // One is neither positive nor negative for certain, nor zero.
    open: bool,
}

fn signs_of_edges(ray: PreparedRay, triangle: Triangle, screened: Screened) -> EdgeSigns {
    let seen = screened.seen;
    let a = most(abs(seen.a.x), abs(seen.a.y));
    let b = most(abs(seen.b.x), abs(seen.b.y));
    let c = most(abs(seen.c.x), abs(seen.c.y));
    // Edges u, v, w, opposite corners a, b, c.
    let widths = vec3<f32>(a, b, c);
    var known: vec3<f32>;
    var positive = false;
    var negative = false;
    var open = false;
    for (var k = 0u; k < 3u; k++) {
        let second = axis_after(k);
        let first = axis_after(second);
        let edge = decide_edge(
            ray,
            on_axis(screened.edges, k),
            screened.margin,
            corner_of(triangle, first),
            corner_of(triangle, second),
            on_axis(widths, second) < on_axis(widths, first),
        );
        positive = positive || edge.x > edge.y;
        negative = negative || edge.x < -edge.y;
        open = open || is_open(edge);
        known[k] = edge.x;
    }
    return EdgeSigns(known, positive, negative, open);
}

// Whether the side that the ray comes from does not count.
fn is_culled(signs: EdgeSigns, culling: u32) -> bool {
    return (culling == CULL_BACK && signs.negative) || (culling == CULL_FRONT && signs.positive);
}

// The rest of the test, for the few triangles whose edges may enclose the ray: the edges that are
// still open, and the distance.
fn decide(
    ray: PreparedRay,
    triangle: Triangle,
    culling: u32,
    farthest: f32,
    screened: Screened,
) -> Verdict {
    let signs = signs_of_edges(ray, triangle, screened);
    let some = signs.positive || signs.negative || signs.open;
    if (signs.positive && signs.negative) || is_culled(signs, culling) || !some {
        return verdict_not();
    }
    return distance_of(ray, triangle, farthest, signs.known, screened.nearest, signs.open);
}

// The verdict on a triangle whose edges may enclose the ray, by the distance; `open` where it is in doubt whether they do.
fn distance_of(
    ray: PreparedRay,
    triangle: Triangle,
    farthest: f32,
    known: vec3<f32>,
    nearest: f32,
    open: bool,
) -> Verdict {
    let normal = certain_cross(
        double3_difference_of(triangle.b, triangle.a),
        double3_difference_of(triangle.c, triangle.a),
    );
    let denominator = certain_dot(normal, double3_of(ray.direction));
    if denominator.error == 0.0 {
        // The ray lies in the triangle's plane, or beside it.
        return verdict_not();
    }
    if abs(denominator.value.high) <= product(2.0, denominator.error) {
        return verdict_in_doubt(nearest);
    }
    let numerator = certain_dot(normal, double3_difference_of(triangle.a, ray.origin));
    let distance = certain_quotient(numerator, denominator);
    if !distance.some {
        return verdict_in_doubt(nearest);
    }
    let det = sum(sum(known.x, known.y), known.z);
    let met =
        Certain(distance.t, distance.error, snap(quotient(known.y, det)), snap(quotient(known.z, det)));
    let at_least = most(least_t(met), nearest);
    if at_least > farthest {
        return verdict_not();
    }
    let after = compare_limit(met, ray.least_key, ray.t_min);
    let before = compare_limit(met, ray.greatest_key, ray.t_max);
    if after == COMPARED_LESS || before == COMPARED_GREATER {
        return verdict_not();
    }
    if open || after == COMPARED_OPEN || before == COMPARED_OPEN {
        return verdict_in_doubt(at_least);
    }
    return Verdict(VERDICT_MET, at_least, met);
}

// A distance and its error, unless out of range.
struct CertainQuotient {
    some: bool,
    t: Double,
    error: f32,
}

// The quotient of two numbers that are known, the second to within half of itself.
fn certain_quotient(numerator: Known, denominator: Known) -> CertainQuotient {
    if numerator.error == 0.0 {
        return CertainQuotient(true, Double(0.0, 0.0), 0.0);
    }
    let n = numerator.value;
    let d = denominator.value;
    let first = quotient(n.high, d.high);
    if exponent(first) >= GREATEST_EXPONENT {
        return CertainQuotient(false, Double(0.0, 0.0), 0.0);
    }
    let parts = sum(numerator.error, product(denominator.error, abs(first)));
    let spread = quotient(product(parts, SPREAD), abs(d.high));
    if exponent(spread) >= GREATEST_EXPONENT {
        return CertainQuotient(false, Double(0.0, 0.0), 0.0);
    }
    let rest = double_minus(n, double_times(d, Double(first, 0.0)));
    let second = quotient(rest.high, d.high);
    let t = double_plus(Double(first, 0.0), Double(second, 0.0));
    let rounding = sum(product(abs(first), QUOTIENT_NOISE), DISTANCE_NOISE);
    return CertainQuotient(true, t, sum(spread, rounding));
}

// How two numbers compare, as far as is known.
const COMPARED_LESS: u32 = 0u;
const COMPARED_EQUAL: u32 = 1u;
const COMPARED_GREATER: u32 = 2u;
const COMPARED_OPEN: u32 = 3u;

fn compared(apart: f32, error: f32) -> u32 {
    return select(select(COMPARED_OPEN, COMPARED_LESS, apart < -error), COMPARED_GREATER, apart > error);
}

// How the distance of a hit compares with a limit, given as a key and as an inner `t`.
fn compare_limit(met: Certain, key: u32, limit: f32) -> u32 {
    if met.error == 0.0 {
        // The distance is zero, whose key this is.
        let zero = 0x80000000u;
        return select(select(COMPARED_EQUAL, COMPARED_LESS, zero < key), COMPARED_GREATER, zero > key);
    }
    // The inner limits of a ray that was not moved are the given ones, except for clamping far
    // beyond all distances, and flushing, which the error covers.
    return compared(double_minus(met.t, Double(limit, 0.0)).high, met.error);
}

fn is_corner_of(p: vec3<f32>, triangle: Triangle) -> bool {
    return all(p == triangle.a) || all(p == triangle.b) || all(p == triangle.c);
}

// Whether two triangles certainly lie in one plane: they have the same three corners, or all six
// corners have one coordinate in common.
fn in_one_plane(p: Triangle, q: Triangle) -> bool {
    let same = is_corner_of(p.a, q) && is_corner_of(p.b, q) && is_corner_of(p.c, q);
    let level = (p.b == p.a) & (p.c == p.a) & (q.a == p.a) & (q.b == p.a) & (q.c == p.a);
    return same || any(level);
}

// How the distances of two hits of two triangles compare.
fn compare_t(met: Certain, p: Triangle, other: Certain, q: Triangle) -> u32 {
    let error = sum(met.error, other.error);
    let order = compared(double_minus(met.t, other.t).high, error);
    if order == COMPARED_OPEN && (error == 0.0 || in_one_plane(p, q)) {
        return COMPARED_EQUAL;
    }
    return order;
}

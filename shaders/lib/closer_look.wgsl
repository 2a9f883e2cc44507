// Twin of core/src/intersect/closer_look.rs: `t` and weights of triangles that interpolation by rounded edge
// functions does not serve.

// Edge functions from here on, per R P, leave no doubt that the ray meets the triangle itself.
const ROBUST: f32 = 0x1p-18f;
// Sheared coordinates from here on need no scaling.
const WIDTH_LEAST: f32 = 0x1p-30f;
// Images deeper than this many times their greatest sheared coordinate are needles along the ray.
const NEEDLE: f32 = 7.0;
// Images with less area than this, where coordinates are near 1, are taken for their longest edge.
const THIN: f32 = 0x1p-21f;
// Coordinates below this, where the greatest is near 1, count as 0.
const FLAT_LEAST: f32 = 0x1p-40f;

// Whether the ray passes all three edges by more than images err. `area` is R P.
fn is_robust(edges: vec3<f32>, area: f32) -> bool {
    let lowest = least_of(abs(edges));
    return lowest > 0.0 && product(area, ROBUST) <= lowest;
}

// A vector of doubles.
struct CornerDoubles {
    x: Double,
    y: Double,
    z: Double,
}

// p - q without error.
fn corner_difference(p: vec3<f32>, q: vec3<f32>) -> CornerDoubles {
    return CornerDoubles(
        double_difference_of(p.x, q.x),
        double_difference_of(p.y, q.y),
        double_difference_of(p.z, q.z),
    );
}

// A corner's image, not divided by the direction's largest component.
struct DoubleImage {
    x: Double,
    y: Double,
}

fn double_scaled(a: Double, power: i32) -> Double {
    if power == 0 {
        return a;
    }
    return Double(scale(a.high, power), scale(a.low, power));
}

// Of a corner from the origin, and a direction in the order of the sheared axes.
fn double_image(corner: CornerDoubles, direction: vec3<f32>, power: i32) -> DoubleImage {
    let x = double_times_float(corner.x, direction.z);
    let y = double_times_float(corner.y, direction.z);
    return DoubleImage(
        double_scaled(double_minus(x, double_times_float(corner.z, direction.x)), power),
        double_scaled(double_minus(y, double_times_float(corner.z, direction.y)), power),
    );
}

// An edge function.
fn double_edge(a: DoubleImage, b: DoubleImage) -> Double {
    return double_minus(double_times(a.x, b.y), double_times(a.y, b.x));
}

// One component of a cross product, times another number.
fn normal_part(p_i: Double, p_j: Double, q_i: Double, q_j: Double, other: Double) -> Double {
    return double_times(double_minus(double_times(p_i, q_j), double_times(p_j, q_i)), other);
}

// A vector in the order of the sheared axes.
fn on_axes(v: vec3<f32>, axes: vec3<u32>) -> vec3<f32> {
    return vec3<f32>(on_axis(v, axes.x), on_axis(v, axes.y), on_axis(v, axes.z));
}

// Where the ray meets the plane of a triangle, and the weights of that point.
fn refined(
    origin: vec3<f32>,
    direction: vec3<f32>,
    axes: vec3<u32>,
    triangle: Triangle,
    width: f32,
    spread: f32,
) -> Candidate {
    let power = select(0, -exponent(width), width < WIDTH_LEAST);
    let start = on_axes(origin, axes);
    let way = on_axes(direction, axes);
    let p = on_axes(triangle.a, axes);
    let q = on_axes(triangle.b, axes);
    let r = on_axes(triangle.c, axes);
    let first = corner_difference(p, start);
    let second = corner_difference(q, start);
    let third = corner_difference(r, start);
    let a = double_image(first, way, power);
    let b = double_image(second, way, power);
    let c = double_image(third, way, power);
    let u = double_edge(c, b);
    let v = double_edge(a, c);
    let w = double_edge(b, a);
    let det = double_plus(double_plus(u, v), w);
    var t: f32;
    if power == 0 && spread <= product(NEEDLE, width) {
        let ab = corner_difference(q, p);
        let ac = corner_difference(r, p);
        let x = normal_part(ab.y, ab.z, ac.y, ac.z, first.x);
        let y = normal_part(ab.z, ab.x, ac.z, ac.x, first.y);
        let z = normal_part(ab.x, ab.y, ac.x, ac.y, first.z);
        let distance = double_plus(double_plus(x, y), z);
        t = quotient(-double_times_float(distance, way.z).high, det.high);
    } else {
        // From the corners' depths; three factors of a triangle that is scaled may underflow besides.
        let ab = double_plus(double_times(u, first.z), double_times(v, second.z));
        let total = double_plus(ab, double_times(w, third.z));
        t = quotient(total.high, double_times_float(det, way.z).high);
    }
    return Candidate(true, t, quotient(v.high, det.high), quotient(w.high, det.high));
}

// An edge function of an image that is met from one side: none is negative.
fn careful_weight(a: vec2<f32>, b: vec2<f32>, side: i32) -> Double {
    let one = two_product(a.x, b.y);
    let other = two_product(a.y, b.x);
    var edge = double_minus(one, other);
    if side < 0 {
        edge = double_minus(other, one);
    }
    if edge.high > 0.0 {
        return edge;
    }
    return Double(0.0, 0.0);
}

// A coordinate scaled, or 0.
fn flat_coordinate(x: f32, power: i32) -> f32 {
    let scaled = scale(x, power);
    return select(scaled, 0.0, abs(scaled) < FLAT_LEAST);
}

// Where the ray meets the image of a triangle, and the weights of that point.
fn careful(seen: Sheared, depths: vec3<f32>, side: i32) -> Candidate {
    let x = -exponent(most_of(abs(vec3<f32>(seen.a.x, seen.b.x, seen.c.x))));
    let y = -exponent(most_of(abs(vec3<f32>(seen.a.y, seen.b.y, seen.c.y))));
    let a = vec2<f32>(flat_coordinate(seen.a.x, x), flat_coordinate(seen.a.y, y));
    let b = vec2<f32>(flat_coordinate(seen.b.x, x), flat_coordinate(seen.b.y, y));
    let c = vec2<f32>(flat_coordinate(seen.c.x, x), flat_coordinate(seen.c.y, y));
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
        let dot = double_plus(two_product(edge.x, p.x), two_product(edge.y, p.y)).high;
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

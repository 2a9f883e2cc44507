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
    var cross: Double3;
    for (var k = 0u; k < 3u; k++) {
        let i = axis_after(k);
        let j = axis_after(i);
        let minor = loose_minor(
            double_on_axis(p, i),
            double_on_axis(p, j),
            double_on_axis(q, i),
            double_on_axis(q, j),
        );
        cross.high[k] = minor.high;
        cross.low[k] = minor.low;
    }
    return cross;
}

// The dot product, rounded.
fn loose_dot(p: Double3, q: Double3) -> f32 {
    var terms: Double3;
    for (var k = 0u; k < 3u; k++) {
        let term = double_times_loosely(double_on_axis(p, k), double_on_axis(q, k));
        terms.high[k] = term.high;
        terms.low[k] = term.low;
    }
    let first = two_sum(terms.high.x, terms.high.y);
    let second = two_sum(first.high, terms.high.z);
    let low = sum(sum(terms.low.x, terms.low.y), terms.low.z);
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
    // The determinant, the distance, and twice a weight: in a loop, which keeps the shader small.
    var dots: vec4<f32>;
    for (var k = 0u; k < 4u; k++) {
        var one = normal;
        var other = way;
        if k == 1u {
            other = oa;
        } else if k > 1u {
            one = across;
            other = ac;
            if k == 3u {
                other = ab;
            }
        }
        dots[k] = loose_dot(one, other);
    }
    let det = dots.x;
    var t = quotient(select(dots.y, 0.0, abs(dots.y) < DISTANCE_LEAST), det);
    if power != 0 {
        t = scale(t, -power);
    }
    return Candidate(true, false, t, vec3<f32>(-dots.z, dots.w, det));
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

// The images of three corners. An array indexed by a variable would lie in memory.
struct Image {
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

fn corner_at(image: Image, corner: u32) -> vec2<f32> {
    return select(select(image.a, image.b, corner == 1u), image.c, corner == 2u);
}

fn with_corner(image: Image, corner: u32, place: vec2<f32>) -> Image {
    return Image(
        select(image.a, place, corner == 0u),
        select(image.b, place, corner == 1u),
        select(image.c, place, corner == 2u),
    );
}

// Where the ray meets the image of a triangle, and the weights of that point.
fn careful(seen: Sheared, depths: vec3<f32>, side: i32) -> Candidate {
    let x = -exponent(most_of(abs(vec3<f32>(seen.a.x, seen.b.x, seen.c.x))));
    let y = -exponent(most_of(abs(vec3<f32>(seen.a.y, seen.b.y, seen.c.y))));
    var image: Image;
    for (var k = 0u; k < 3u; k++) {
        let corner = corner_image(seen, k);
        image = with_corner(image, k, vec2<f32>(scale(corner.x, x), scale(corner.y, y)));
    }
    // The weight of each corner.
    var weights: Double3;
    for (var k = 0u; k < 3u; k++) {
        let next = axis_after(k);
        let weight = careful_weight(corner_at(image, axis_after(next)), corner_at(image, next), side);
        weights.high[k] = weight.high;
        weights.low[k] = weight.low;
    }
    // Their sum, and that of the depths.
    var det: Double;
    var total: Double;
    for (var k = 0u; k < 3u; k++) {
        let weight = Double(weights.high[k], weights.low[k]);
        let part = double_times_float(weight, on_axis(depths, k));
        if k == 0u {
            det = weight;
            total = part;
        } else {
            det = double_plus(det, weight);
            total = double_plus(total, part);
        }
    }
    if det.high < THIN {
        return on_longest_edge(image, depths);
    }
    return Candidate(
        true,
        false,
        quotient(total.high, det.high),
        vec3<f32>(weights.high.y, weights.high.z, det.high),
    );
}

// The point of an image's longest edge that is nearest to the ray.
fn on_longest_edge(image: Image, depths: vec3<f32>) -> Candidate {
    var longest = 0.0;
    // How far along it the nearest point is, its depth, and the corner that the edge starts at.
    var along = 0.0;
    var depth = depths.x;
    var start = 0u;
    for (var k = 0u; k < 3u; k++) {
        let p = corner_at(image, k);
        let q = corner_at(image, axis_after(k));
        let edge = vec2<f32>(difference(q.x, p.x), difference(q.y, p.y));
        let squared = snapped_sum(snapped_product(edge.x, edge.x), snapped_product(edge.y, edge.y));
        if squared > longest {
            longest = squared;
            let dot = double_plus(flat_product(edge.x, p.x), flat_product(edge.y, p.y)).high;
            along = snap(least(most(quotient(-dot, squared), 0.0), 1.0));
            let from_depth = on_axis(depths, k);
            let deeper = difference(on_axis(depths, axis_after(k)), from_depth);
            depth = sum(from_depth, product(along, deeper));
            start = k;
        }
    }
    let rest = difference(1.0, along);
    // From the first corner on, to the second; from the second to the third; from the third to the first.
    let u = select(select(0.0, rest, start == 1u), along, start == 0u);
    let v = select(select(0.0, rest, start == 2u), along, start == 1u);
    return Candidate(true, false, depth, vec3<f32>(u, v, 1.0));
}

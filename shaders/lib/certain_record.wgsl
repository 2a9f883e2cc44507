// Twin of core/src/query/certify/record.rs: the record of a hit whose triangle is known, as exact arithmetic rounds it.
// Needs certain.wgsl and rounded.wgsl. The bounds are derived in docs/design/exact.md.

// What a term of a point may lose, unless it has a factor of zero.
const TERM_LEAST: f32 = 0x1p-72f;
// Error of a weight as the CPU computes it, per unit of the direction times the longest side times the farthest corner
// over the denominator.
const WIDE_NOISE: f32 = 0x1p-45f;
// Weights that the CPU may know less well than this are left to it.
const WIDE_MOST: f32 = 0x1p-32f;
// Weights below this are left to the CPU.
const WEIGHT_LEAST: f32 = 0x1p-60f;

// A vector of doubles, and bounds on what its components are made of.
struct Point {
    parts: Double3,
    sizes: vec3<f32>,
}

// The way to the first corner from near where the ray meets the plane.
fn way_to(corner: Double3, t: f32, direction: vec3<f32>) -> Point {
    var out: Point;
    for (var k = 0u; k < 3u; k++) {
        let away = double_on_axis(corner, k);
        let along = on_axis(direction, k);
        let term = two_product(t, along);
        let first = double_difference_of(away.high, term.high);
        let second = double_difference_of(away.low, term.low);
        let part = double_plus(first, second);
        out.parts.high[k] = part.high;
        out.parts.low[k] = part.low;
        let size = most(abs(first.high), abs(second.high));
        out.sizes[k] = select(most(size, TERM_LEAST), size, t == 0.0 || along == 0.0);
    }
    return out;
}

// A weight, from its share of the denominator; `wide` is what the CPU may err.
fn certain_weight(share: Known, whole: Known, wide: f32) -> Rounded {
    if share.error == 0.0 {
        return Rounded(false, 0.0);
    }
    let part = certain_quotient(share, whole);
    let weight = rounded(part.t, sum(part.error, wide));
    let plain = WEIGHT_LEAST <= weight.value && weight.value <= 1.0;
    return Rounded(part.some && weight.some && plain, weight.value);
}

// The hit of a ray at a triangle, whose index is `triangle`, that is known to be its hit; UNDECIDED_HIT where its record is not certain.
fn certain_record(ray: Ray, corners: Triangle, triangle: u32) -> Hit {
    let undecided = Hit(0.0, UNDECIDED_HIT, 0.0, 0.0);
    let given = snap3(ray.direction);
    let power = exponent(most_of(abs(given)));
    let direction = scale3(given, -power);
    let doubled = double3_of(direction);
    let ab = double3_difference_of(corners.b, corners.a);
    let ac = double3_difference_of(corners.c, corners.a);
    let oa = double3_difference_of(corners.a, snap3(ray.origin));
    let normal = certain_cross(ab, ac);
    let whole = certain_dot(normal, doubled);
    let speed = abs(whole.value.high);
    if speed <= product(2.0, whole.error) {
        return undecided;
    }
    let distance = certain_quotient(certain_dot(normal, oa), whole);
    if !distance.some {
        return undecided;
    }
    let way = way_to(oa, distance.t.high, direction);
    let longest = most(most_of(abs(ab.high)), most_of(abs(ac.high)));
    let farthest = most(longest, most_of(abs(oa.high)));
    let reach = product(product(longest, farthest), WIDE_NOISE);
    // The direction's greatest component is below 2.
    let wide = quotient(product(2.0, reach), speed);
    if wide >= WIDE_MOST {
        return undecided;
    }
    let of_second = certain_cross_of_sizes(ac, way.parts, ac.high, way.sizes);
    let u = certain_weight(certain_dot(of_second, doubled), whole, wide);
    let of_third = certain_cross_of_sizes(way.parts, ab, way.sizes, ab.high);
    let v = certain_weight(certain_dot(of_third, doubled), whole, wide);
    let t = rounded_distance(distance.t, distance.error, power);
    if !u.some || !v.some || !t.some {
        return undecided;
    }
    return Hit(t.value, triangle, u.value, select(v.value, difference(1.0, u.value), sum(u.value, v.value) > 1.0));
}

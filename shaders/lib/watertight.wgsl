// Twin of core/src/query/intersect/watertight.rs: a triangle is met where the ray meets its closed image, by exact
// signs, and `t` never leaves the image by more than rounding. Ray and triangle alone decide, bit for bit.

// The error of an interpolated `t` is at most this part of `disorder / |det|`.
const INTERPOLATION_ERROR: f32 = 0x1p-17f;
// The power of two near which the largest distance is brought in wide scenes.
const WIDE_POWER: i32 = 38;
// Determinants from here on are known.
const DET_LEAST: f32 = 0x1p-74f;
// Sums of products of edge functions and depths from here on, times 8, are known.
const SUM_LEAST: f32 = 0x1p-90f;
// A `t` from a closer look counts as 0 below this.
const T_LEAST: f32 = 0x1p-64f;
// Images with less area than this, per square of the greatest sheared coordinate, are looked at more closely.
const SLIVER: f32 = 0x1p-8f;

// An edge function: twice the signed area of the origin and two sheared corners.
fn edge_function(a: vec2<f32>, b: vec2<f32>) -> f32 {
    let value = difference(product(a.x, b.y), product(a.y, b.x));
    return select(value, 0.0, abs(value) < EDGE_LEAST);
}

// The greatest distance to a corner on any axis, times a factor.
fn scaled_reach(corner: vec3<f32>, origin: vec3<f32>, factor: f32) -> f32 {
    return most_of(abs(vec3<f32>(
        difference(product(corner.x, factor), product(origin.x, factor)),
        difference(product(corner.y, factor), product(origin.y, factor)),
        difference(product(corner.z, factor), product(origin.z, factor)),
    )));
}

// A product of mantissas, 48 bits, and its exponent. Zero has no bits.
struct ExactProduct {
    negative: bool,
    exponent: i32,
    high: u32,
    low: u32,
}

// a * b without error.
fn exact_product(a: f32, b: f32) -> ExactProduct {
    let a_bits = bitcast<u32>(a);
    let b_bits = bitcast<u32>(b);
    if exponent(a) == -127 || exponent(b) == -127 {
        return ExactProduct(false, 0, 0u, 0u);
    }
    let negative = ((a_bits ^ b_bits) >> 31u) == 1u;
    let a_mantissa = (a_bits & 0x7fffffu) | 0x800000u;
    let b_mantissa = (b_bits & 0x7fffffu) | 0x800000u;
    // In halves of 12 bits.
    let a_high = a_mantissa >> 12u;
    let a_low = a_mantissa & 0xfffu;
    let b_high = b_mantissa >> 12u;
    let b_low = b_mantissa & 0xfffu;
    let cross = a_high * b_low + a_low * b_high;
    let low = a_low * b_low + ((cross & 0xfffu) << 12u);
    var high = a_high * b_high + (cross >> 12u) + (low >> 24u);
    var rest = low & 0xffffffu;
    var power = exponent(a) + exponent(b);
    if high < 0x800000u {
        high = (high << 1u) | (rest >> 23u);
        rest = (rest << 1u) & 0xffffffu;
        power -= 1;
    }
    return ExactProduct(negative, power, high, rest);
}

// The sign of a difference of products, a.x b.y - a.y b.x, in real arithmetic: -1, 0 or 1.
fn exact_sign(a: vec2<f32>, b: vec2<f32>) -> i32 {
    let one = exact_product(a.x, b.y);
    let other = exact_product(a.y, b.x);
    if one.high == 0u && other.high == 0u {
        return 0;
    }
    if one.high == 0u || other.high == 0u || one.negative != other.negative {
        let negative = select(one.negative, !other.negative, one.high == 0u);
        return select(1, -1, negative);
    }
    var order = 0;
    if one.exponent != other.exponent {
        order = select(-1, 1, one.exponent > other.exponent);
    } else if one.high != other.high {
        order = select(-1, 1, one.high > other.high);
    } else if one.low != other.low {
        order = select(-1, 1, one.low > other.low);
    }
    return select(order, -order, one.negative);
}

// Edge functions opposite the first, second and third corner, rounded.
fn edge_functions(seen: Sheared) -> vec3<f32> {
    return vec3<f32>(
        edge_function(seen.c, seen.b),
        edge_function(seen.a, seen.c),
        edge_function(seen.b, seen.a),
    );
}

// 1 where the image's front is met, -1 where its back is, 0 where neither.
fn side_met(seen: Sheared, edges: vec3<f32>) -> i32 {
    let below = edges.x < 0.0 || edges.y < 0.0 || edges.z < 0.0;
    let above = edges.x > 0.0 || edges.y > 0.0 || edges.z > 0.0;
    if below && above {
        return 0;
    }
    if edges.x != 0.0 && edges.y != 0.0 && edges.z != 0.0 {
        return select(-1, 1, above);
    }
    // An edge function is zero, or rounded to it.
    let signs = vec3<i32>(
        exact_sign(seen.c, seen.b),
        exact_sign(seen.a, seen.c),
        exact_sign(seen.b, seen.a),
    );
    let lowest = min(min(signs.x, signs.y), signs.z);
    let highest = max(max(signs.x, signs.y), signs.z);
    if lowest < 0 && highest > 0 {
        return 0;
    }
    return clamp(lowest + highest, -1, 1);
}

fn is_culled(side: i32, culling: u32) -> bool {
    return (culling == CULL_BACK && side < 0) || (culling == CULL_FRONT && side > 0);
}

// A corner of a wide scene: scaled by a power of two so that its distance is near 1.
struct WideCorner {
    power: i32,
    away: vec3<f32>,
    flat: vec2<f32>,
}

fn wide_corner(ray: PreparedRay, corner: vec3<f32>) -> WideCorner {
    // Small numbers are not halved but raised by 2^29, since devices may flush what halving makes
    // subnormal; `lift` is what that adds to the exponent.
    let small = most(most_of(abs(corner)), most_of(abs(ray.origin))) < 0x1p+90f;
    let factor = select(0.5, 0x1p+29f, small);
    let lift = select(0, 30, small);
    let largest = scaled_reach(corner, ray.origin, factor);
    // A corner that the ray starts at stays at 0 at any scale.
    var power = 126;
    if exponent(largest) - lift >= -126 {
        power = lift - exponent(largest);
    }
    let away = corner_away(ray.axes, scale3(corner, power), scale3(ray.origin, power));
    return WideCorner(power, away, shear_corner(away, ray.shear));
}

// The watertight test: where the ray meets the triangle within its limits.
fn watertight(ray: PreparedRay, triangle: Triangle, culling: u32) -> Candidate {
    var seen: Sheared;
    if !ray.wide {
        seen.away_a = corner_away(ray.axes, triangle.a, ray.origin);
        seen.away_b = corner_away(ray.axes, triangle.b, ray.origin);
        seen.away_c = corner_away(ray.axes, triangle.c, ray.origin);
        seen.a = shear_corner(seen.away_a, ray.shear);
        seen.b = shear_corner(seen.away_b, ray.shear);
        seen.c = shear_corner(seen.away_c, ray.shear);
        let edges = edge_functions(seen);
        let side = side_met(seen, edges);
        if side == 0 || is_culled(side, culling) {
            return no_candidate();
        }
        return finish_test(ray, ray.origin, triangle, seen, edges, side, ray.t_min, ray.t_max);
    }
    // Each corner's image depends on ray and corner alone; in an edge function the scales of two corners
    // are one factor. What follows takes the triangle scaled as a whole.
    let a = wide_corner(ray, triangle.a);
    let b = wide_corner(ray, triangle.b);
    let c = wide_corner(ray, triangle.c);
    seen = Sheared(a.away, b.away, c.away, a.flat, b.flat, c.flat);
    let side = side_met(seen, edge_functions(seen));
    if side == 0 || is_culled(side, culling) {
        return no_candidate();
    }
    let power = min(min(a.power, b.power), c.power) + WIDE_POWER;
    seen = Sheared(
        scale3(a.away, power - a.power),
        scale3(b.away, power - b.power),
        scale3(c.away, power - c.power),
        scale2(a.flat, power - a.power),
        scale2(b.flat, power - b.power),
        scale2(c.flat, power - c.power),
    );
    let origin = scale3(ray.origin, power);
    let scaled = Triangle(
        scale3(triangle.a, power),
        scale3(triangle.b, power),
        scale3(triangle.c, power),
    );
    // Scaling back may underflow or clamp: what is reported is held to the limits later.
    let edges = edge_functions(seen);
    var hit = finish_test(ray, origin, scaled, seen, edges, side, -GREATEST, GREATEST);
    hit.t = scale(hit.t, -power);
    // Held to the inner limits as well, like that of the plain test: scaled to the caller's units, a
    // `t` before the ray's start may become 0, and whether its leaf is visited is a matter of luck.
    if hit.t < ray.t_min || hit.t > ray.t_max {
        return no_candidate();
    }
    return hit;
}

fn scale2(v: vec2<f32>, power: i32) -> vec2<f32> {
    return vec2<f32>(scale(v.x, power), scale(v.y, power));
}

// Where a triangle is met, once it is known to be.
fn finish_test(
    ray: PreparedRay,
    origin: vec3<f32>,
    triangle: Triangle,
    seen: Sheared,
    edges: vec3<f32>,
    side: i32,
    t_min: f32,
    t_max: f32,
) -> Candidate {
    let sz = ray.shear.z;
    let depths = vec3<f32>(
        product(sz, seen.away_a.z),
        product(sz, seen.away_b.z),
        product(sz, seen.away_c.z),
    );
    let nearest = least_of(depths);
    let farthest = most_of(depths);
    if farthest < t_min || nearest > t_max {
        return no_candidate();
    }
    let det = sum(sum(edges.x, edges.y), edges.z);
    let total = sum(
        sum(product(edges.x, depths.x), product(edges.y, depths.y)),
        product(edges.z, depths.z),
    );
    let width = width_of(seen);
    let area = product(reach_of(seen), width);
    let spread = difference(farthest, nearest);
    let disorder = product(area, spread);
    let fat = most(product(product(width, width), SLIVER), DET_LEAST);
    let eightfold = product(8.0, abs(total));
    var hit = Candidate(true, 0.0, 0.0, 0.0);
    if abs(det) >= fat && most(disorder, SUM_LEAST) <= eightfold {
        hit.t = quotient(total, det);
        hit.u = quotient(edges.y, det);
        hit.v = quotient(edges.z, det);
    } else {
        if abs(det) >= DET_LEAST && disorder > most(eightfold, SUM_LEAST) {
            // Most such triangles are the one that the ray starts on; they need no closer look.
            let interpolated = quotient(total, det);
            let part = quotient(disorder, abs(det));
            // An error beyond any float lets nothing go.
            if exponent(part) < 128 {
                let error = product(part, INTERPOLATION_ERROR);
                if sum(interpolated, error) < t_min || difference(interpolated, error) > t_max {
                    return no_candidate();
                }
            }
        }
        if is_robust(edges, area) && spread <= product(NEEDLE, width) {
            hit = refined(origin, ray.direction, triangle, width);
        } else {
            hit = careful(seen, depths, side);
        }
        hit.t = select(hit.t, 0.0, abs(hit.t) < T_LEAST);
    }
    hit.t = least(most(hit.t, nearest), farthest);
    if hit.t < t_min || hit.t > t_max {
        return no_candidate();
    }
    // Snapped, since devices may ignore the sign of zero.
    hit.u = snap(hit.u);
    hit.v = snap(hit.v);
    return hit;
}

// The greatest distance of a corner on any axis.
fn reach_of(seen: Sheared) -> f32 {
    return most(
        most(most_of(abs(seen.away_a)), most_of(abs(seen.away_b))),
        most_of(abs(seen.away_c)),
    );
}

// The greatest sheared coordinate.
fn width_of(seen: Sheared) -> f32 {
    let a = abs(seen.a);
    let b = abs(seen.b);
    let c = abs(seen.c);
    return most(most(most(a.x, a.y), most(b.x, b.y)), most(c.x, c.y));
}

// The triangle test of this shader.
fn test_triangle(ray: PreparedRay, triangle: Triangle, culling: u32) -> Candidate {
    return watertight(ray, triangle, culling);
}

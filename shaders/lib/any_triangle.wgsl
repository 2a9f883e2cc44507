// Triangles of every kind: those that a ray meets at an edge, slivers and needles, and those of wide scenes.
// plain_triangle.wgsl stands in its place in a shader that leaves these to another.

// The power of two near which the largest distance is brought in wide scenes.
const WIDE_POWER: i32 = 38;

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

// `side_met` in real arithmetic.
fn side_by_exact_signs(seen: Sheared) -> i32 {
    var lowest = 1;
    var highest = -1;
    for (var k = 0u; k < 3u; k++) {
        let next = axis_after(k);
        let sign = exact_sign(corner_image(seen, axis_after(next)), corner_image(seen, next));
        lowest = min(lowest, sign);
        highest = max(highest, sign);
    }
    if lowest < 0 && highest > 0 {
        return 0;
    }
    return clamp(lowest + highest, -1, 1);
}

// A corner of a wide scene: scaled by a power of two so that its distance is near 1.
struct WideCorner {
    power: i32,
    away: vec3<f32>,
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
    return WideCorner(power, corner_away(axes_of(ray), scale3(corner, power), scale3(ray.origin, power)));
}

// A triangle of a wide scene as seen from the origin: each corner's image depends on ray and corner alone, and has
// a scale of its own, which is `powers`.
struct WideSheared {
    seen: Sheared,
    powers: vec3<i32>,
}

fn wide_sheared(ray: PreparedRay, triangle: Triangle) -> WideSheared {
    var wide: WideSheared;
    for (var k = 0u; k < 3u; k++) {
        let corner = select(select(triangle.a, triangle.b, k == 1u), triangle.c, k == 2u);
        let found = wide_corner(ray, corner);
        let image = shear_corner(found.away, ray.shear);
        wide.powers[k] = found.power;
        if k == 0u {
            wide.seen.away_a = found.away;
            wide.seen.a = image;
        } else if k == 1u {
            wide.seen.away_b = found.away;
            wide.seen.b = image;
        } else {
            wide.seen.away_c = found.away;
            wide.seen.c = image;
        }
    }
    return wide;
}

// The same at one scale.
fn at_one_scale(wide: WideSheared, power: i32) -> Sheared {
    var seen: Sheared;
    for (var k = 0u; k < 3u; k++) {
        let by = power - wide.powers[k];
        let away = select(
            select(wide.seen.away_a, wide.seen.away_b, k == 1u),
            wide.seen.away_c,
            k == 2u,
        );
        let image = corner_image(wide.seen, k);
        let scaled = scale3(away, by);
        let flat = vec2<f32>(scale(image.x, by), scale(image.y, by));
        if k == 0u {
            seen.away_a = scaled;
            seen.a = flat;
        } else if k == 1u {
            seen.away_b = scaled;
            seen.b = flat;
        } else {
            seen.away_c = scaled;
            seen.c = flat;
        }
    }
    return seen;
}

// The watertight test in full, for any triangle and ray.
fn test_closely(ray: PreparedRay, index: u32, culling: u32) -> Candidate {
    let triangle = corners_of(index);
    var wide: WideSheared;
    if ray.wide {
        // In an edge function the scales of two corners are one factor.
        wide = wide_sheared(ray, triangle);
    } else {
        wide.seen = sheared(ray, index);
    }
    var seen = wide.seen;
    var edges = rounded_edges(edge_functions(seen));
    var side = side_met(edges);
    if side == SIDE_OPEN {
        side = side_by_exact_signs(seen);
    }
    if side == 0 || is_culled(side, culling) {
        return no_candidate();
    }
    var origin = ray.origin;
    var held = triangle;
    var t_min = ray.t_min;
    var t_max = ray.t_max;
    var power = 0;
    if ray.wide {
        // What follows takes the triangle scaled as a whole. Scaling back may underflow or clamp: what is reported
        // is held to the limits later.
        power = min(min(wide.powers.x, wide.powers.y), wide.powers.z) + WIDE_POWER;
        seen = at_one_scale(wide, power);
        edges = rounded_edges(edge_functions(seen));
        origin = scale3(origin, power);
        held = Triangle(
            scale3(triangle.a, power),
            scale3(triangle.b, power),
            scale3(triangle.c, power),
        );
        t_min = -GREATEST;
        t_max = GREATEST;
    }
    var hit = finish_test(ray, origin, index, seen, edges, t_min, t_max, GREATEST);
    if hit.open {
        hit = look_closer(ray, origin, held, seen, edges, side, t_min, t_max);
    }
    if ray.wide {
        hit.t = scale(hit.t, -power);
        // Held to the inner limits as well, like that of the plain test: scaled to the caller's units, a
        // `t` before the ray's start may become 0, and whether its leaf is visited is a matter of luck.
        if hit.t < ray.t_min || hit.t > ray.t_max {
            return no_candidate();
        }
    }
    return hit;
}

// Where a triangle is met that interpolation by rounded edge functions does not serve.
fn look_closer(
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
    let width = width_of(seen);
    let area = product(reach_of(seen), width);
    var hit: Candidate;
    if is_robust(edges, area) && difference(farthest, nearest) <= product(NEEDLE, width) {
        hit = refined(origin, ray.direction, triangle, width);
    } else {
        hit = careful(seen, depths, side);
    }
    hit.t = select(hit.t, 0.0, abs(hit.t) < T_LEAST);
    hit.t = least(most(hit.t, nearest), farthest);
    if hit.t < t_min || hit.t > t_max {
        return no_candidate();
    }
    return hit;
}

fn looks_closer() -> bool {
    return true;
}

fn inner_limits(ray: PreparedRay) -> vec2<f32> {
    return vec2<f32>(ray.t_min, ray.t_max);
}

// u and v of a hit, from the weights of its candidate.
fn barycentric(ray: PreparedRay, triangle: u32, weights: vec3<f32>) -> vec2<f32> {
    return weights_over(weights);
}

fn reach_again(origin: vec3<f32>, index: u32, seen: Sheared) -> f32 {
    return reach_of(seen);
}

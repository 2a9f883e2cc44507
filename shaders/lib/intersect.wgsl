// Twin of core/src/query/intersect except for the triangle tests: prepared rays, and the distance to
// planes. The tests are in watertight.wgsl and moeller_trumbore.wgsl; a shader has one of the two.
//
// Infinities and NaN do not exist here. Limits and components that may hold them are read as bits,
// and what may overflow is decided by exponents before it is computed.

// Relative widening of the distance to a plane.
const PLANE_SLACK: f32 = 0x1p-20f;
// A traversal may stop when the next entry lies beyond the best `t` by more than this part of it.
const STOP_SLACK: f32 = 0x1p-13f;
// What adding a moved ray's offset may round away, per unit of the offset.
const OFFSET_SLACK: f32 = 0x1p-22f;
// Slopes below this are zero.
const SLOPE_LEAST: f32 = 0x1p-40f;
// Direction components are taken to be at least this large when dividing by them.
const DIRECTION_LEAST: f32 = 0x1p-80f;
// In range: no coordinate above this, origins included.
const COORDINATE_MOST: f32 = 0x1p+38f;
// Origin coordinates below this are taken for one value, in scenes that are in range.
const ORIGIN_LEAST: f32 = 0x1p-60f;
// Origins further than this many scene extents away are first moved along the ray.
const FAR: f32 = 100.0;
// f32::MAX / FAR: what can be multiplied by FAR.
const GREATEST_BY_FAR: f32 = 0x1.47ae14p+121f;
// Half of f32::MAX: what can be doubled.
const HALF_GREATEST: f32 = 0x1.fffffep+126f;
// From here on sums of two are not formed: they might overflow.
const HUGE: f32 = 0x1p+126f;

// What a query knows of the scene; twin of `SceneScale`. 64 bytes.
struct Scene {
    // Bounds of the tree.
    lo: vec3<f32>,
    // Absolute slack of plane positions.
    slack: f32,
    hi: vec3<f32>,
    // 1 when exponents leave the range of the plain triangle test.
    wide: u32,
    // Origins within are not far.
    near_lo: vec3<f32>,
    // Always 0: what `opaque_zero` is set to.
    zero: u32,
    near_hi: vec3<f32>,
    // What origin coordinates below ORIGIN_LEAST are taken for.
    origin_least: f32,
}

// A prepared ray: scaled, moved near the scene, sheared. See `PreparedRay` in Rust.
struct PreparedRay {
    // False when the ray can hit nothing; then nothing else counts.
    some: bool,
    wide: bool,
    exponent: i32,
    offset: f32,
    origin: vec3<f32>,
    // Inner limits.
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
    reciprocal: vec3<f32>,
    // The caller's limits, as keys: those that decide.
    least_key: u32,
    slack: vec3<f32>,
    greatest_key: u32,
    axes: vec3<u32>,
    shear: vec3<f32>,
}

// A hit in inner units; none unless `some`.
struct Candidate {
    some: bool,
    t: f32,
    u: f32,
    v: f32,
}

fn no_candidate() -> Candidate {
    return Candidate(false, 0.0, 0.0, 0.0);
}

// One coordinate of a vector, by selection: an index that is not constant would send the vector to memory.
fn on_axis(v: vec3<f32>, axis: u32) -> f32 {
    return select(select(v.x, v.y, axis == 1u), v.z, axis == 2u);
}

fn is_finite_bits(bits: u32) -> bool {
    return (bits & 0x7f800000u) != 0x7f800000u;
}

fn is_nan_bits(bits: u32) -> bool {
    return (bits & 0x7fffffffu) > 0x7f800000u;
}

fn all_finite(v: vec3<f32>) -> bool {
    let bits = bitcast<vec3<u32>>(v);
    return is_finite_bits(bits.x) && is_finite_bits(bits.y) && is_finite_bits(bits.z);
}

// Orders limits and `t` exactly as numbers, infinities and subnormals included; -0 equals +0.
fn limit_key(bits: u32) -> u32 {
    if bits == 0x80000000u {
        return 0x80000000u;
    }
    return select(~bits, bits | 0x80000000u, (bits >> 31u) == 0u);
}

fn snap3(v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(snap(v.x), snap(v.y), snap(v.z));
}

fn scale3(v: vec3<f32>, power: i32) -> vec3<f32> {
    return vec3<f32>(scale(v.x, power), scale(v.y, power), scale(v.z, power));
}

fn most_of(v: vec3<f32>) -> f32 {
    return most(most(v.x, v.y), v.z);
}

fn least_of(v: vec3<f32>) -> f32 {
    return least(least(v.x, v.y), v.z);
}

// Half the extent of a box on one axis; twin of `Aabb::half_extent`.
fn half_extent_of(lo: f32, hi: f32) -> f32 {
    return snapped_difference(snapped_product(hi, 0.5), snapped_product(lo, 0.5));
}

// The longest extent of a box, at most GREATEST; 0 for an empty one.
fn longest_extent(lo: vec3<f32>, hi: vec3<f32>) -> f32 {
    var half = most(0.0, half_extent_of(lo.x, hi.x));
    half = most(half, half_extent_of(lo.y, hi.y));
    half = most(half, half_extent_of(lo.z, hi.z));
    return product(least(half, HALF_GREATEST), 2.0);
}

// a * b for b > 0 where that is below 2^125; above, HUGE with the sign of `a`.
fn free_limited_mul(a: f32, b: f32) -> f32 {
    if exponent(a) + exponent(b) >= 123 {
        return select(HUGE, -HUGE, a < 0.0);
    }
    return free_mul(a, b);
}

// What `plane_before_far_origin` found.
struct FarPlane {
    // The ray is far off on an axis along which it does not move: it meets nothing.
    miss: bool,
    // The origin is to be moved to `side` on `axis`.
    moves: bool,
    axis: u32,
    side: f32,
}

// The axis on which an origin is furthest off and the nearer side of the bounds there, when that is
// more than FAR extents away.
fn plane_before_far_origin(origin: vec3<f32>, direction: vec3<f32>) -> FarPlane {
    let reach = product(least(longest_extent(scene.lo, scene.hi), GREATEST_BY_FAR), FAR);
    var widest = 0.0;
    var axis = 0u;
    var side = 0.0;
    for (var k = 0u; k < 3u; k++) {
        let at = product(on_axis(origin, k), 0.5);
        let lo = on_axis(scene.lo, k);
        let hi = on_axis(scene.hi, k);
        // Halved, so that nothing overflows.
        let below = difference(product(lo, 0.5), at);
        let above = difference(at, product(hi, 0.5));
        let gap = most(below, above);
        if gap > widest {
            widest = gap;
            axis = k;
            side = select(hi, lo, below > above);
        }
    }
    if widest <= product(reach, 0.5) || widest == 0.0 {
        return FarPlane(false, false, 0u, 0.0);
    }
    let moves = on_axis(direction, axis) != 0.0;
    return FarPlane(!moves, moves, axis, side);
}

struct MovedOrigin {
    offset: f32,
    origin: vec3<f32>,
}

// One coordinate of a moved origin.
fn moved_coordinate(start: f32, shift: f32, direction: f32, power: i32) -> f32 {
    let way = two_product(shift, direction);
    let place = two_sum(start, way.high);
    return scale(sum(place.high, sum(place.low, way.low)), -power);
}

// Moves an origin along the direction to a plane: how far, and where it comes to lie. Scaled by a
// power of two so that the origin is near 1, and without error except for the last rounding, since
// the distance is long.
fn move_origin(origin: vec3<f32>, direction: vec3<f32>, plane: FarPlane) -> MovedOrigin {
    let largest = most(most_of(abs(origin)), abs(plane.side));
    // One below, so that the difference of two cannot overflow.
    let power = -exponent(largest) - 1;
    let start = scale3(origin, power);
    let way = difference(scale(plane.side, power), on_axis(start, plane.axis));
    // The way divided by a slope may be long beyond any float: then nothing is near.
    let shift = clamp(quotient(way, on_axis(direction, plane.axis)), -1e30, 1e30);
    let moved = vec3<f32>(
        moved_coordinate(start.x, shift, direction.x, power),
        moved_coordinate(start.y, shift, direction.y, power),
        moved_coordinate(start.z, shift, direction.z, power),
    );
    return MovedOrigin(scale(shift, -power), moved);
}

// An inner limit of a moved ray; `side` is -1 for the lower, 1 for the upper, which widens it by
// what moving may have rounded.
fn moved_limit(t: f32, offset: f32, side: f32) -> f32 {
    if abs(t) == GREATEST {
        return t;
    }
    if abs(t) >= HUGE || abs(offset) >= HUGE {
        return select(-GREATEST, GREATEST, side > 0.0);
    }
    let error = product(sum(abs(t), abs(offset)), OFFSET_SLACK);
    return sum(difference(t, offset), select(-error, error, side > 0.0));
}

// The quotient of two components of a direction, zero when small.
fn slope(over: f32, under: f32) -> f32 {
    let ratio = quotient(over, under);
    return select(ratio, 0.0, abs(ratio) < SLOPE_LEAST);
}

fn reciprocal_of(d: f32) -> f32 {
    let limited = select(DIRECTION_LEAST, -DIRECTION_LEAST, d < 0.0);
    return free_reciprocal(select(d, limited, abs(d) < DIRECTION_LEAST));
}

// Prepares a ray. `some` is false when it can hit nothing whatever the scene holds: a component
// that is not finite, a zero direction, a NaN limit, or no `t` between the limits.
fn prepare_ray(ray: Ray) -> PreparedRay {
    var out: PreparedRay;
    out.some = false;
    let t_min_bits = bitcast<u32>(ray.t_min);
    let t_max_bits = bitcast<u32>(ray.t_max);
    out.least_key = limit_key(t_min_bits);
    out.greatest_key = limit_key(t_max_bits);
    let nan_limit = is_nan_bits(t_min_bits) || is_nan_bits(t_max_bits);
    if !all_finite(ray.origin) || !all_finite(ray.direction) || nan_limit
        || out.least_key > out.greatest_key {
        return out;
    }
    let given = snap3(ray.direction);
    let largest = most_of(abs(given));
    let no_bounds = scene.lo.x > scene.hi.x || scene.lo.y > scene.hi.y || scene.lo.z > scene.hi.z;
    if largest == 0.0 || no_bounds {
        return out;
    }
    let power = exponent(largest);
    let direction = scale3(given, -power);
    var t_min = scale_bits(t_min_bits, power);
    var t_max = scale_bits(t_max_bits, power);
    var origin = snap3(ray.origin);

    var offset = 0.0;
    let near = all(scene.near_lo <= origin) && all(origin <= scene.near_hi);
    if !near {
        let plane = plane_before_far_origin(origin, direction);
        if plane.miss {
            return out;
        }
        if plane.moves {
            let moved = move_origin(origin, direction, plane);
            offset = moved.offset;
            origin = moved.origin;
            t_min = moved_limit(t_min, offset, -1.0);
            t_max = moved_limit(t_max, offset, 1.0);
        }
    }
    var wide = scene.wide != 0u;
    if !wide {
        let small = abs(origin) < vec3<f32>(ORIGIN_LEAST);
        origin = select(origin, vec3<f32>(scene.origin_least), small);
        wide = any(abs(origin) > vec3<f32>(COORDINATE_MOST));
    }

    // The direction's largest axis, the lowest on a tie, is z; x and y are exchanged when it is
    // negative, so that windings keep their sense.
    var z = 0u;
    if abs(direction.y) > abs(direction.x) {
        z = 1u;
    }
    if abs(direction.z) > abs(on_axis(direction, z)) {
        z = 2u;
    }
    var x = select(z + 1u, 0u, z == 2u);
    var y = select(x + 1u, 0u, x == 2u);
    let along = on_axis(direction, z);
    if along < 0.0 {
        let swapped = x;
        x = y;
        y = swapped;
    }
    out.some = true;
    out.wide = wide;
    out.exponent = power;
    out.offset = offset;
    out.origin = origin;
    out.t_min = t_min;
    out.direction = direction;
    out.t_max = t_max;
    out.axes = vec3<u32>(x, y, z);
    out.shear = vec3<f32>(
        slope(on_axis(direction, x), along),
        slope(on_axis(direction, y), along),
        quotient(1.0, along),
    );
    let reciprocal =
        vec3<f32>(reciprocal_of(direction.x), reciprocal_of(direction.y), reciprocal_of(direction.z));
    out.reciprocal = reciprocal;
    out.slack = vec3<f32>(
        free_limited_mul(scene.slack, abs(reciprocal.x)),
        free_limited_mul(scene.slack, abs(reciprocal.y)),
        free_limited_mul(scene.slack, abs(reciprocal.z)),
    );
    return out;
}

// The caller's `t` for an inner one, finite.
fn outer_t(ray: PreparedRay, inner: f32) -> f32 {
    if abs(inner) >= HUGE || abs(ray.offset) >= HUGE {
        // Halved, so that the sum cannot overflow.
        return scale(sum(product(inner, 0.5), product(ray.offset, 0.5)), 1 - ray.exponent);
    }
    return scale(sum(inner, ray.offset), -ray.exponent);
}

// Whether the caller's limits, both included, hold this `t` of the caller's.
fn within_limits(ray: PreparedRay, t: f32) -> bool {
    let key = limit_key(bitcast<u32>(t));
    return ray.least_key <= key && key <= ray.greatest_key;
}

// `t`, and as much as interpolation may err.
fn stop_after_t(t: f32) -> f32 {
    if t >= HUGE {
        return GREATEST;
    }
    return sum(t, product(abs(t), STOP_SLACK));
}

// The inner `t` beyond which no cell can hold a hit that precedes one at inner `t`, which is `outer`
// to the caller.
fn stop_after(ray: PreparedRay, t: f32, outer: f32) -> f32 {
    // Different inner `t` may be equal outside, and then the lower index precedes: where the offset's
    // rounding makes them so, where scaling back flushes them to 0, or clamps them.
    let stop = stop_after_t(t);
    if stop >= HUGE || abs(outer) == GREATEST {
        return GREATEST;
    }
    let rounding = product(abs(ray.offset), OFFSET_SLACK);
    if outer != 0.0 {
        return sum(stop, rounding);
    }
    let smallest = stop_after_t(scale(LEAST_NORMAL, ray.exponent));
    return most(sum(stop, rounding), sum(difference(smallest, ray.offset), rounding));
}

// The least and greatest inner `t` at which the ray may be at a plane.
fn plane_interval(ray: PreparedRay, axis: u32, position: f32) -> vec2<f32> {
    let origin = on_axis(ray.origin, axis);
    let reciprocal = on_axis(ray.reciprocal, axis);
    let slack = on_axis(ray.slack, axis);
    var t: f32;
    if ray.wide {
        if slack >= HUGE {
            return vec2<f32>(-GREATEST, GREATEST);
        }
        let half = free_sub(free_mul(position, 0.5), free_mul(origin, 0.5));
        // Of a plane that is too far for a float it is known that it lies beyond 2^124.
        if exponent(half) + exponent(reciprocal) >= 123 {
            let at_least = free_sub(0x1p+124f, free_mul_add(0x1p+124f, PLANE_SLACK, slack));
            if (half < 0.0) != (reciprocal < 0.0) {
                return vec2<f32>(-GREATEST, -at_least);
            }
            return vec2<f32>(at_least, GREATEST);
        }
        t = free_mul(free_mul(half, reciprocal), 2.0);
    } else {
        t = free_mul(free_sub(position, origin), reciprocal);
    }
    let error = free_mul_add(abs(t), PLANE_SLACK, slack);
    return vec2<f32>(free_sub(t, error), free_mul_add(1.0, t, error));
}

// Where the ray may be inside the scene's bounds: none unless `x <= y`.
fn enter_bounds(ray: PreparedRay) -> vec2<f32> {
    // Widened, since the `t` of a hit may err on either side of what its cell says.
    var enter = -GREATEST;
    if ray.t_min > -HUGE {
        enter = difference(ray.t_min, product(abs(ray.t_min), STOP_SLACK));
    }
    var leave = stop_after_t(ray.t_max);
    for (var axis = 0u; axis < 3u; axis++) {
        let low = plane_interval(ray, axis, on_axis(scene.lo, axis));
        let high = plane_interval(ray, axis, on_axis(scene.hi, axis));
        let backwards = on_axis(ray.direction, axis) < 0.0;
        enter = most(enter, select(low.x, high.x, backwards));
        leave = least(leave, select(high.y, low.y, backwards));
    }
    return vec2<f32>(enter, leave);
}

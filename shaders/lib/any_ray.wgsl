// Rays of every kind: those that start far off, and those in scenes whose exponents leave the range of the plain
// case. plain_ray.wgsl stands in its place in a shader that leaves these to another.

// Origins further than this many scene extents away are first moved along the ray.
const FAR: f32 = 100.0;
// f32::MAX / FAR: what can be multiplied by FAR.
const GREATEST_BY_FAR: f32 = 0x1.47ae14p+121f;
// Half of f32::MAX: what can be doubled.
const HALF_GREATEST: f32 = 0x1.fffffep+126f;

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

// A ray's origin and limits, moved near the scene where it starts far off.
fn place(given: vec3<f32>, direction: vec3<f32>, least_t: f32, greatest_t: f32) -> Placed {
    var placed = Placed(true, scene.wide != 0u, 0.0, given, least_t, greatest_t);
    if !is_near(given) {
        let plane = plane_before_far_origin(given, direction);
        if plane.miss {
            return not_placed();
        }
        if plane.moves {
            let moved = move_origin(given, direction, plane);
            placed.offset = moved.offset;
            placed.origin = moved.origin;
            placed.t_min = moved_limit(least_t, moved.offset, -1.0);
            placed.t_max = moved_limit(greatest_t, moved.offset, 1.0);
        }
    }
    if !placed.wide {
        placed.origin = origin_in_range(placed.origin);
        placed.wide = is_out_of_range(placed.origin);
    }
    return placed;
}

// a * b for b > 0 where that is below 2^125; above, HUGE with the sign of `a`.
fn free_limited_mul(a: f32, b: f32) -> f32 {
    if exponent(a) + exponent(b) >= 123 {
        return select(HUGE, -HUGE, a < 0.0);
    }
    return free_mul(a, b);
}

// The scene's slack along the ray, on each axis.
fn slack_of(reciprocal: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        free_limited_mul(scene.slack, abs(reciprocal.x)),
        free_limited_mul(scene.slack, abs(reciprocal.y)),
        free_limited_mul(scene.slack, abs(reciprocal.z)),
    );
}

fn slack_on(ray: PreparedRay, axis: u32, reciprocal: f32) -> f32 {
    return on_axis(ray.slack, axis);
}

// `plane_interval` on one axis of a wide scene.
fn wide_plane_interval(origin: f32, reciprocal: f32, slack: f32, position: f32) -> vec2<f32> {
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
    return around(free_mul(free_mul(half, reciprocal), 2.0), slack);
}

// No ray is left to another shader.
fn is_deferred() -> bool {
    return false;
}

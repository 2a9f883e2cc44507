// Twin of core/src/query/intersect except for the triangle tests: prepared rays, and the distance to
// planes. Where rays start, and distances in wide scenes, stand in any_ray.wgsl, or, for a shader that leaves all
// but the plain case to another, in plain_ray.wgsl.
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
    // See `axes_of` and `exponent_of`: packed, since registers are dear in a traversal.
    packed: u32,
    shear: vec3<f32>,
}

// A hit in inner units; none unless `some`.
struct Candidate {
    some: bool,
    // Whether the test leaves to a closer look if there is one. With `some` it is met: no farther than `t`, and no nearer than
    // `weights.x`.
    open: bool,
    t: f32,
    // What the triangle test makes u and v from, once it is known which hit is the answer: see `barycentric`.
    weights: vec3<f32>,
}

fn no_candidate() -> Candidate {
    return Candidate(false, false, 0.0, vec3<f32>());
}

fn open_candidate() -> Candidate {
    return Candidate(false, true, 0.0, vec3<f32>());
}

fn open_between(nearest: f32, farthest: f32) -> Candidate {
    return Candidate(true, true, farthest, vec3<f32>(nearest, 0.0, 0.0));
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

// The quotient of two components of a direction, zero when small.
fn slope(over: f32, under: f32) -> f32 {
    let ratio = quotient(over, under);
    return select(ratio, 0.0, abs(ratio) < SLOPE_LEAST);
}

fn reciprocal_of(d: f32) -> f32 {
    let limited = select(DIRECTION_LEAST, -DIRECTION_LEAST, d < 0.0);
    return free_reciprocal(select(d, limited, abs(d) < DIRECTION_LEAST));
}

// Where a ray starts and ends, in inner units.
struct Placed {
    // False when the ray meets nothing.
    some: bool,
    wide: bool,
    // How far along the direction the origin was moved.
    offset: f32,
    origin: vec3<f32>,
    t_min: f32,
    t_max: f32,
}

fn not_placed() -> Placed {
    return Placed(false, false, 0.0, vec3<f32>(), 0.0, 0.0);
}

// Whether an origin is so near the scene that it need not be moved.
fn is_near(origin: vec3<f32>) -> bool {
    return all(scene.near_lo <= origin) && all(origin <= scene.near_hi);
}

// An origin in a scene that is in range: what is tiny is taken for one value.
fn origin_in_range(origin: vec3<f32>) -> vec3<f32> {
    return select(origin, vec3<f32>(scene.origin_least), abs(origin) < vec3<f32>(ORIGIN_LEAST));
}

fn is_out_of_range(origin: vec3<f32>) -> bool {
    return any(abs(origin) > vec3<f32>(COORDINATE_MOST));
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
    let t_min = scale_bits(t_min_bits, power);
    let t_max = scale_bits(t_max_bits, power);
    let placed = place(snap3(ray.origin), direction, t_min, t_max);
    if !placed.some {
        return out;
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
    out.wide = placed.wide;
    out.offset = placed.offset;
    out.origin = placed.origin;
    out.t_min = placed.t_min;
    out.direction = direction;
    out.t_max = placed.t_max;
    out.packed = x | (y << 2u) | (z << 4u) | (u32(power + 512) << 6u);
    out.shear = vec3<f32>(
        slope(on_axis(direction, x), along),
        slope(on_axis(direction, y), along),
        quotient(1.0, along),
    );
    let reciprocal =
        vec3<f32>(reciprocal_of(direction.x), reciprocal_of(direction.y), reciprocal_of(direction.z));
    out.reciprocal = reciprocal;
    out.slack = slack_of(reciprocal);
    return out;
}

// The caller's `t` for an inner one, finite.
fn outer_t(ray: PreparedRay, inner: f32) -> f32 {
    if abs(inner) >= HUGE || abs(ray.offset) >= HUGE {
        // Halved, so that the sum cannot overflow.
        return scale(sum(product(inner, 0.5), product(ray.offset, 0.5)), 1 - exponent_of(ray));
    }
    return scale(sum(inner, ray.offset), -exponent_of(ray));
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
    let smallest = stop_after_t(scale(LEAST_NORMAL, exponent_of(ray)));
    return most(sum(stop, rounding), sum(difference(smallest, ray.offset), rounding));
}

// The sheared axes x, y, z.
fn axes_of(ray: PreparedRay) -> vec3<u32> {
    return vec3<u32>(ray.packed & 3u, (ray.packed >> 2u) & 3u, (ray.packed >> 4u) & 3u);
}

// The power of two by which the direction was divided.
fn exponent_of(ray: PreparedRay) -> i32 {
    return i32(ray.packed >> 6u) - 512;
}

// Whether the ray runs towards lower coordinates on an axis.
fn is_backwards(ray: PreparedRay, axis: u32) -> bool {
    // The reciprocal has the sign of the direction, and a traversal needs it anyway.
    return on_axis(ray.reciprocal, axis) < 0.0;
}

// The least and greatest inner `t` at which the ray may be at a plane.
fn plane_interval(ray: PreparedRay, axis: u32, position: f32) -> vec2<f32> {
    let origin = on_axis(ray.origin, axis);
    let reciprocal = on_axis(ray.reciprocal, axis);
    let slack = slack_on(ray, axis, reciprocal);
    if ray.wide {
        return wide_plane_interval(origin, reciprocal, slack, position);
    }
    let t = free_mul(free_sub(position, origin), reciprocal);
    return around(t, slack);
}

// `t` widened by what the distance to a plane may err.
fn around(t: f32, slack: f32) -> vec2<f32> {
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
        let backwards = is_backwards(ray, axis);
        enter = most(enter, select(low.x, high.x, backwards));
        leave = least(leave, select(high.y, low.y, backwards));
    }
    return vec2<f32>(enter, leave);
}

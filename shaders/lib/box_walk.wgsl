// Twin of `BoxRay` and `BoxStack` in core/src/backend/scene/packed/trace.rs: the way of a ray through the tree over instances,
// which can be interrupted after each. Nodes, the stack and what answers are the kernel's: `box_words`, `way_store`, `way_entry`, `is_asked`.

// A child of a node that is an instance.
const TOP_INSTANCE: u32 = 0x80000000u;
// A child that every ray enters.
const TOP_ALWAYS: u32 = 0x40000000u;
// No child of a node.
const TOP_NONE: u32 = 0xffffffffu;
// The key of a child that the ray does not enter.
const NO_CHILD: u32 = 0xffffffffu;
// Components of a direction are taken to be at least this part of the greatest. Also: the shortest direction that is tame.
const BOX_DIRECTION_LEAST: f32 = 0x1p-40f;
// Rays whose direction is longer, or shorter than the reciprocal, enter every instance.
const BOX_DIRECTION_MOST: f32 = 0x1p+40f;
// So do rays from farther away.
const BOX_COORDINATE_MOST: f32 = 0x1p+40f;

// A ray among boxes. No number is so great that an operation overflows.
struct BoxRay {
    origin: vec3<f32>,
    reciprocal: vec3<f32>,
    distance: f32,
    enter: f32,
    stop: f32,
    tame: bool,
}

// False for a ray that hits nothing: a component that is not finite, a zero direction, a NaN limit, or no `t` between the
// limits.
fn can_hit(ray: Ray) -> bool {
    let t_min_bits = bitcast<u32>(ray.t_min);
    let t_max_bits = bitcast<u32>(ray.t_max);
    let nan_limit = is_nan_bits(t_min_bits) || is_nan_bits(t_max_bits);
    let some_t = limit_key(t_min_bits) <= limit_key(t_max_bits);
    let finite = all_finite(ray.origin) && all_finite(ray.direction);
    return finite && !nan_limit && some_t && most_of(abs(snap3(ray.direction))) != 0.0;
}

fn box_reciprocal(d: f32, shortest: f32) -> f32 {
    return free_reciprocal(select(d, shortest, abs(d) < shortest));
}

// A ray that can hit something, up to `t_max`, given by its bits.
fn box_ray(ray: Ray, t_max_bits: u32) -> BoxRay {
    var out: BoxRay;
    let length = most_of(abs(ray.direction));
    out.origin = ray.origin;
    out.distance = most_of(abs(ray.origin));
    out.tame = length >= BOX_DIRECTION_LEAST && length <= BOX_DIRECTION_MOST
        && out.distance <= BOX_COORDINATE_MOST;
    let shortest = product(length, BOX_DIRECTION_LEAST);
    out.reciprocal = vec3<f32>(
        box_reciprocal(ray.direction.x, shortest),
        box_reciprocal(ray.direction.y, shortest),
        box_reciprocal(ray.direction.z, shortest),
    );
    let t_min = scale_bits(bitcast<u32>(ray.t_min), 0);
    out.enter = -GREATEST;
    if t_min > -HUGE {
        out.enter = difference(difference(t_min, product(abs(t_min), STOP_SLACK)), LEAST_NORMAL);
    }
    var t_max = scale_bits(t_max_bits, 0);
    if (t_max_bits >> 31u) == 0u || t_max_bits == 0x80000000u {
        t_max = most(t_max, LEAST_NORMAL);
    }
    out.stop = select(GREATEST, -GREATEST, t_max < 0.0);
    if abs(t_max) < HUGE {
        out.stop = sum(t_max, product(abs(t_max), STOP_SLACK));
    }
    return out;
}

// Where a ray enters and leaves a box on one axis, lower and upper end given, is in `x` and `y`.
fn box_span(low: f32, high: f32, wider: f32, origin: f32, reciprocal: f32) -> vec2<f32> {
    let to_low = free_mul(free_sub(free_sub(low, wider), origin), reciprocal);
    let to_high = free_mul(free_sub(free_mul_add(1.0, high, wider), origin), reciprocal);
    let backwards = reciprocal < 0.0;
    return vec2<f32>(select(to_low, to_high, backwards), select(to_high, to_low, backwards));
}

// The key of a child: where the ray enters its box, in the order of the floats. No value is NaN: here
// `max` and `min` are free.
fn child_key(
    ray: BoxRay,
    lo: vec3<f32>,
    hi: vec3<f32>,
    reach: f32,
    child: u32,
    place: u32,
    wanted: u32,
) -> u32 {
    let wider = free_mul(reach, ray.distance);
    let x = box_span(lo.x, hi.x, wider, ray.origin.x, ray.reciprocal.x);
    let y = box_span(lo.y, hi.y, wider, ray.origin.y, ray.reciprocal.y);
    let z = box_span(lo.z, hi.z, wider, ray.origin.z, ray.reciprocal.z);
    let counts = ray.tame && (child & TOP_ALWAYS) == 0u;
    let near = select(ray.enter, max(max(x.x, y.x), max(z.x, ray.enter)), counts);
    let far = select(ray.stop, min(min(x.y, y.y), min(z.y, ray.stop)), counts);
    let key = ordered_bits(near);
    let met = near <= far && child != TOP_NONE && (wanted & (1u << place)) != 0u;
    return select(NO_CHILD, key, met);
}

// The keys of four children: the first ones of a node, or the others.
fn four_keys(ray: BoxRay, node: u32, half: u32, wanted: u32) -> vec4<u32> {
    let at = 16u * node + half;
    let x = bitcast<vec4<f32>>(box_words(at));
    let y = bitcast<vec4<f32>>(box_words(at + 2u));
    let z = bitcast<vec4<f32>>(box_words(at + 4u));
    let to_x = bitcast<vec4<f32>>(box_words(at + 6u));
    let to_y = bitcast<vec4<f32>>(box_words(at + 8u));
    let to_z = bitcast<vec4<f32>>(box_words(at + 10u));
    let reach = bitcast<vec4<f32>>(box_words(at + 12u));
    let children = box_words(at + 14u);
    let first = 4u * half;
    return vec4<u32>(
        child_key(ray, vec3<f32>(x.x, y.x, z.x), vec3<f32>(to_x.x, to_y.x, to_z.x), reach.x, children.x, first, wanted),
        child_key(ray, vec3<f32>(x.y, y.y, z.y), vec3<f32>(to_x.y, to_y.y, to_z.y), reach.y, children.y, first + 1u, wanted),
        child_key(ray, vec3<f32>(x.z, y.z, z.z), vec3<f32>(to_x.z, to_y.z, to_z.z), reach.z, children.z, first + 2u, wanted),
        child_key(ray, vec3<f32>(x.w, y.w, z.w), vec3<f32>(to_x.w, to_y.w, to_z.w), reach.w, children.w, first + 3u, wanted),
    );
}

// A bit for each of four.
fn bits_of(four: vec4<bool>) -> u32 {
    let bits = select(vec4<u32>(), vec4<u32>(1u, 2u, 4u, 8u), four);
    return bits.x | bits.y | bits.z | bits.w;
}

// What comes of the search for an instance.
struct Next {
    // NO_INSTANCE when there is none left.
    instance: u32,
    // Entries that the ray's stack has then.
    top: u32,
}

// False once a driver ends the loops of the invocation: llvmpipe then lets each loop run once.
fn loops_run() -> bool {
    var rounds = 0u;
    loop {
        if rounds >= (2u ^ opaque_zero) {
            break;
        }
        rounds += 1u;
    }
    return (rounds ^ opaque_zero) == 2u;
}

// The next instance that a ray enters and that answers it, nearest boxes first.
fn next_instance(index: u32, ray: BoxRay, entries: u32) -> Next {
    var top = entries;
    loop {
        if top == 0u {
            break;
        }
        top -= 1u;
        let entry = way_entry(index, top);
        let node = entry >> 8u;
        var nearest = NO_CHILD;
        // A bit for each child: the nearest, and all that the ray enters.
        var first = 0u;
        var met = 0u;
        for (var half = 0u; half < 2u; half++) {
            let keys = four_keys(ray, node, half, entry);
            let least_key = min(min(keys.x, keys.y), min(keys.z, keys.w));
            if least_key < nearest {
                nearest = least_key;
                first = bits_of(keys == vec4<u32>(least_key)) << (4u * half);
            }
            met |= bits_of(keys != vec4<u32>(NO_CHILD)) << (4u * half);
        }
        if met == 0u {
            continue;
        }
        let place = firstTrailingBit(first);
        let rest = met & ~(1u << place);
        if rest != 0u {
            way_store(index, top, (node << 8u) | rest);
            top += 1u;
        }
        let children = box_words(16u * node + 14u + (place >> 2u));
        let child = select(
            select(children.x, children.y, (place & 3u) == 1u),
            select(children.z, children.w, (place & 3u) == 3u),
            (place & 2u) != 0u,
        ) & ~TOP_ALWAYS;
        if (child & TOP_INSTANCE) == 0u {
            way_store(index, top, (child << 8u) | 0xffu);
            top += 1u;
        } else if is_asked(child & ~TOP_INSTANCE) {
            return Next(child & ~TOP_INSTANCE, top);
        }
    }
    return Next(NO_INSTANCE, 0u);
}

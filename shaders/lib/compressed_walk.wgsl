// Twin of core/src/query/compressed/walk.rs: the walk of a ray down compressed nodes, in place of traverse.wgsl. Rays
// that are not plain, more triangles that take a closer look than set_aside.wgsl has room for, and stacks that are too deep are deferred
// to a shader that walks the tree itself: the hits are the same.
//
// The stack stands in box_stack.wgsl or box_stack_workgroup.wgsl; what is done with triangles in search.wgsl; whether a ray passes what it meets in
// one_hit.wgsl or through_glass.wgsl.

// Where the walk is at no node.
const NO_NODE: u32 = 0xffffffffu;
// The key of a child that the ray passes by.
const NO_CHILD: u32 = 0xffffffffu;
// The bits of a key that hold the child's place. The others are those of a float that is not negative.
const CHILD_PLACE: u32 = 7u;
// Where a node's first reference has its number of children that are nodes.
const REFERENCE_BITS: u32 = 26u;
// By this factor a ray leaves a box later than is computed.
const BOX_FACTOR: f32 = 0x1.00004p+0f;

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

// A node, as a ray sees it.
struct SeenNode {
    // The bits of 1, opaque: so a compiler needs one operation to make a number of a side.
    one: u32,
    // The distances to sides, of numbers from 1 to 2.
    step: vec3<f32>,
    start: vec3<f32>,
    // Where the ray enters what there is, and how far it is of interest.
    enter: f32,
    limit: f32,
}

// Distances to sides, which stand in the second byte of each word.
fn distances(seen: SeenNode, sides: vec3<u32>) -> vec3<f32> {
    let numbers = bitcast<vec3<f32>>((sides & vec3<u32>(0xff00u)) | vec3<u32>(seen.one));
    return vec3<f32>(
        free_mul_add(numbers.x, seen.step.x, seen.start.x),
        free_mul_add(numbers.y, seen.step.y, seen.start.y),
        free_mul_add(numbers.z, seen.step.z, seen.start.z),
    );
}

// The key of a child whose sides stand in the second byte of each word. No value is NaN: here `max` and `min` are free.
fn child_key(seen: SeenNode, near_sides: vec3<u32>, far_sides: vec3<u32>, place: u32) -> u32 {
    let near = distances(seen, near_sides);
    let far = distances(seen, far_sides);
    let enter = max(max(near.x, near.y), max(near.z, seen.enter));
    let leave = min(min(far.x, far.y), min(far.z, seen.limit));
    let key = (bitcast<u32>(enter) & ~CHILD_PLACE) | place;
    return select(NO_CHILD, key, enter <= free_mul(leave, BOX_FACTOR));
}

// The keys of four children.
fn four_keys(seen: SeenNode, near: vec3<u32>, far: vec3<u32>, place: u32) -> vec4<u32> {
    let eight = vec3<u32>(8u);
    let sixteen = vec3<u32>(16u);
    return vec4<u32>(
        child_key(seen, near << eight, far << eight, place),
        child_key(seen, near, far, place | 1u),
        child_key(seen, near >> eight, far >> eight, place | 2u),
        child_key(seen, near >> sixteen, far >> sixteen, place | 3u),
    );
}

// Four keys in ascending order.
fn four_sorted(keys: vec4<u32>) -> vec4<u32> {
    let low = min(keys.xz, keys.yw);
    let high = max(keys.xz, keys.yw);
    let first = min(low.x, low.y);
    let last = max(high.x, high.y);
    let inner = vec2<u32>(max(low.x, low.y), min(high.x, high.y));
    return vec4<u32>(first, min(inner.x, inner.y), max(inner.x, inner.y), last);
}

// Puts the children of a node that the ray may meet on the stack, the nearest on top. Returns where the stack ends.
fn children_of(ray: PreparedRay, node: u32, enter: f32, limit: f32, bottom: u32) -> u32 {
    let at = 5u * node;
    let head = compressed_nodes[at];
    let first_sides = compressed_nodes[at + 2u];
    let more_sides = compressed_nodes[at + 3u];
    let last_sides = compressed_nodes[at + 4u];
    let origin = bitcast<vec3<f32>>(head.xyz);
    let units = bitcast<vec3<f32>>(
        (vec3<u32>(head.w) << vec3<u32>(23u, 15u, 7u)) & vec3<u32>(0x7f800000u),
    );
    var seen: SeenNode;
    seen.one = 0x3f800000u ^ opaque_zero;
    seen.step = vec3<f32>(
        free_mul(units.x, ray.reciprocal.x),
        free_mul(units.y, ray.reciprocal.y),
        free_mul(units.z, ray.reciprocal.z),
    );
    seen.start = vec3<f32>(
        free_sub(free_mul(free_sub(origin.x, ray.origin.x), ray.reciprocal.x), seen.step.x),
        free_sub(free_mul(free_sub(origin.y, ray.origin.y), ray.reciprocal.y), seen.step.y),
        free_sub(free_mul(free_sub(origin.z, ray.origin.z), ray.reciprocal.z), seen.step.z),
    );
    seen.enter = enter;
    seen.limit = limit;
    let backwards = ray.reciprocal < vec3<f32>();
    let lower = first_sides.xyz;
    let upper = vec3<u32>(first_sides.w, more_sides.xy);
    let lower_rest = vec3<u32>(more_sides.zw, last_sides.x);
    let upper_rest = last_sides.yzw;
    let near = select(lower, upper, backwards);
    let far = select(upper, lower, backwards);
    let near_rest = select(lower_rest, upper_rest, backwards);
    let far_rest = select(upper_rest, lower_rest, backwards);
    let one = four_sorted(four_keys(seen, near, far, 0u));
    let other = four_sorted(four_keys(seen, near_rest, far_rest, 4u));
    // Batcher's odd-even merge.
    let low = min(one, other);
    let high = max(one, other);
    let third = min(low.zw, high.xy);
    let fifth = max(low.zw, high.xy);
    var top = bottom;
    let fourth = max(third.y, fifth.x);
    // Few rays meet more than four children.
    if fourth != NO_CHILD {
        top = stack_pushed(top, high.w, node);
        top = stack_pushed(top, max(fifth.y, high.z), node);
        top = stack_pushed(top, min(fifth.y, high.z), node);
        top = stack_pushed(top, fourth, node);
    }
    top = stack_pushed(top, min(third.y, fifth.x), node);
    top = stack_pushed(top, max(low.y, third.x), node);
    top = stack_pushed(top, min(low.y, third.x), node);
    return stack_pushed(top, low.x, node);
}

// What the walk visits next: a node, or as many references of a leaf from a place on.
struct NextPlace {
    at: u32,
    rest: u32,
}

// A child of a node.
fn child_of(node: u32, place: u32) -> NextPlace {
    let names = compressed_nodes[5u * node + 1u];
    if place < (names.y >> REFERENCE_BITS) {
        return NextPlace(names.x + place, 0u);
    }
    // Where the leaf ends, and where the child before it does.
    let later = place >= 4u;
    let shift = 8u * (place & 3u);
    let word = select(names.z, names.w, later);
    let before = select((word << 8u) >> shift, select(0u, names.z >> 24u, later), shift == 0u);
    let start = before & 0xffu;
    let rest = ((word >> shift) & 0xffu) - start;
    let at = (names.y & ((1u << REFERENCE_BITS) - 1u)) + start;
    // Places without a child have no reference.
    return NextPlace(select(at, NO_NODE, rest == 0u), rest);
}

// The hit of a ray; `any` ends the walk at the first. A driver that ends loops early is noticed, as in traverse.wgsl.
fn trace_ray(ray: Ray, options: QueryOptions, any: bool) -> Hit {
    opaque_zero = scene.zero;
    var prepared = prepare_ray(ray);
    // Keys are in order for rays that do not reach behind their origin.
    if is_deferred() || (prepared.some && prepared.least_key < 0x80000000u) {
        return Hit(GREATEST, DEFERRED, 0.0, 0.0);
    }
    if !prepared.some {
        return no_hit();
    }
    let entered = enter_bounds(prepared);
    if entered.x > entered.y {
        return no_hit();
    }
    var search = new_search();
    // At the end there is nothing on the stack, and only then.
    var top = stack_start();
    // A node or none; with something left of a leaf, the next of its references.
    var at = 0u;
    var rest = 0u;
    loop {
        if rest == 0u && at != NO_NODE {
            observe_node();
            let limit = min(entered.y, search.stop);
            top = children_of(prepared, at, entered.x, limit, top);
            if !stack_has(top - STACK_STEP) {
                return Hit(GREATEST, DEFERRED, 0.0, 0.0);
            }
        } else if rest > 0u {
            let triangle = compressed_references[at];
            at += 1u;
            rest -= 1u;
            if triangle != options.ignore && !may_skip(search, triangle) {
                observe_triangle();
                search = searched(search, prepared, triangle, options.culling, any);
                if search.open {
                    search.open = false;
                    if !set_aside(triangle) {
                        return Hit(GREATEST, DEFERRED, 0.0, 0.0);
                    }
                }
                if any && search.found {
                    break;
                }
            }
        }
        if rest > 0u {
            continue;
        }
        at = NO_NODE;
        top -= STACK_STEP;
        if top < STACK_STEP {
            if !passes(search) {
                break;
            }
            // Once more from the root, for what lies behind. The near limit only grows: keys stay in order.
            prepared = passed(prepared, search);
            search = new_search();
            top = stack_start();
            at = 0u;
            continue;
        }
        let entry = stack_entry(top);
        let key = entry.x;
        let reached = free_mul(min(entered.y, search.stop), BOX_FACTOR);
        if bitcast<f32>(key & ~CHILD_PLACE) <= reached {
            let next = child_of(entry.y, key & CHILD_PLACE);
            at = next.at;
            rest = next.rest;
        }
    }
    if !loops_run() || (!(any && search.found) && (top ^ opaque_zero) >= STACK_STEP) {
        return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
    }
    if !(any && search.found) && leaves_aside(best_triangle(search)) {
        return Hit(GREATEST, UNSETTLED, 0.0, 0.0);
    }
    return search_hit(search, prepared);
}

// The hit of least (t, triangle).
fn closest_hit(ray: Ray, options: QueryOptions) -> Hit {
    return trace_ray(ray, options, false);
}

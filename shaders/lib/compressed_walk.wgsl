// Twin of core/src/query/compressed/walk.rs: the walk of a ray down compressed nodes, in place of traverse.wgsl. Rays
// that are not plain, triangles that take a closer look, and stacks that are too deep are deferred to a shader that
// walks the tree itself: the hits are the same.
//
// The stack stands in box_stack.wgsl; what is done with triangles in search.wgsl.

// Where the walk is at no node.
const NO_NODE: u32 = 0xffffffffu;
// What the bytes of a node say of a child that is a node.
const INNER_CHILD: u32 = 0x80u;
// Set in an entry of the stack that is a leaf; then come five bits of its length and 26 of its first reference.
const LEAF_ENTRY: u32 = 0x80000000u;
const LEAF_SHIFT: u32 = 26u;
// Relative widening of the distance to a box.
const BOX_SLACK: f32 = 0x1p-19f;

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

// The sides of four boxes, a byte each.
struct Sides {
    near: vec3<u32>,
    far: vec3<u32>,
}

// The sides that a ray comes to first, and last.
fn sides(lower: vec3<u32>, upper: vec3<u32>, backwards: vec3<bool>) -> Sides {
    return Sides(select(lower, upper, backwards), select(upper, lower, backwards));
}

// The distances to sides on all axes, from the lowest bytes.
fn distances(quanta: vec3<u32>, step: vec3<f32>, start: vec3<f32>) -> vec3<f32> {
    let low = quanta & vec3<u32>(0xffu);
    return vec3<f32>(
        free_mul_add(f32(low.x), step.x, start.x),
        free_mul_add(f32(low.y), step.y, start.y),
        free_mul_add(f32(low.z), step.z, start.z),
    );
}

// Puts the children of a node that the ray may pass on the stack, the nearest on top. Returns where it ends, or 0 where
// there is no room.
fn children_of(ray: PreparedRay, node: u32, entered: vec2<f32>, stop: f32, bottom: u32) -> u32 {
    let at = 5u * node;
    let head = compressed_nodes[at];
    let names = compressed_nodes[at + 1u];
    let first_sides = compressed_nodes[at + 2u];
    let more_sides = compressed_nodes[at + 3u];
    let last_sides = compressed_nodes[at + 4u];
    let origin = bitcast<vec3<f32>>(head.xyz);
    let exponents = (vec3<u32>(head.w) >> vec3<u32>(0u, 8u, 16u)) & vec3<u32>(0xffu);
    let quantum = bitcast<vec3<f32>>(exponents << vec3<u32>(23u));
    let step = vec3<f32>(
        free_mul(quantum.x, ray.reciprocal.x),
        free_mul(quantum.y, ray.reciprocal.y),
        free_mul(quantum.z, ray.reciprocal.z),
    );
    let start = vec3<f32>(
        free_mul(free_sub(origin.x, ray.origin.x), ray.reciprocal.x),
        free_mul(free_sub(origin.y, ray.origin.y), ray.reciprocal.y),
        free_mul(free_sub(origin.z, ray.origin.z), ray.reciprocal.z),
    );
    let backwards = ray.reciprocal < vec3<f32>();
    let lower = vec3<u32>(first_sides.x, first_sides.z, more_sides.x);
    let upper = vec3<u32>(more_sides.z, last_sides.x, last_sides.z);
    var four = sides(lower, upper, backwards);
    var counts = names.z;
    var child = names.x;
    var first = names.y;
    var top = bottom;
    for (var place = 0u; place < 8u; place++) {
        if place == 4u {
            let lower_rest = vec3<u32>(first_sides.y, first_sides.w, more_sides.y);
            let upper_rest = vec3<u32>(more_sides.w, last_sides.y, last_sides.w);
            four = sides(lower_rest, upper_rest, backwards);
            counts = names.w;
        }
        let count = counts & 0xffu;
        if count == 0u {
            break;
        }
        let near = distances(four.near, step, start);
        let far = distances(four.far, step, start);
        four = Sides(four.near >> vec3<u32>(8u), four.far >> vec3<u32>(8u));
        counts = counts >> 8u;
        let is_node = count == INNER_CHILD;
        let word = select(LEAF_ENTRY | (count << LEAF_SHIFT) | first, child, is_node);
        child += select(0u, 1u, is_node);
        first += select(count, 0u, is_node);
        let latest = most_of(near);
        let earliest = least_of(far);
        let enter = free_mul_add(abs(latest), -BOX_SLACK, latest);
        let leave = free_mul_add(abs(earliest), BOX_SLACK, earliest);
        if enter <= leave && enter <= entered.y && entered.x <= leave && enter <= stop {
            if !stack_has(top) {
                return 0u;
            }
            // Among those of this node, behind all that are nearer.
            var to = top;
            while to > bottom {
                let other = stack_enter(to - STACK_STEP);
                if other >= enter {
                    break;
                }
                stack_store(to, stack_word(to - STACK_STEP), other);
                to -= STACK_STEP;
            }
            stack_store(to, word, enter);
            top += STACK_STEP;
        }
    }
    return top;
}

// The hit of a ray; `any` ends the walk at the first. A driver that ends loops early is noticed, as in traverse.wgsl.
fn trace_ray(ray: Ray, options: QueryOptions, any: bool) -> Hit {
    opaque_zero = scene.zero;
    let prepared = prepare_ray(ray);
    if is_deferred() {
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
    // None in a leaf and after it.
    var node = 0u;
    // What is left of the leaf that the walk is in.
    var at = 0u;
    var end = 0u;
    loop {
        if node != NO_NODE {
            observe_node();
            top = children_of(prepared, node, entered, search.stop, top);
            if top == 0u {
                return Hit(GREATEST, DEFERRED, 0.0, 0.0);
            }
            node = NO_NODE;
        } else if at < end {
            let triangle = compressed_references[at];
            at += 1u;
            if triangle != options.ignore {
                observe_triangle();
                search = searched(search, prepared, triangle, options.culling, any);
                if search.open {
                    return Hit(GREATEST, DEFERRED, 0.0, 0.0);
                }
                if any && search.found {
                    break;
                }
            }
        }
        if at < end {
            continue;
        }
        top -= STACK_STEP;
        if top < STACK_STEP {
            break;
        }
        if stack_enter(top) <= search.stop {
            let word = stack_word(top);
            if word < LEAF_ENTRY {
                node = word;
            } else {
                at = word & ((1u << LEAF_SHIFT) - 1u);
                end = at + ((word & ~LEAF_ENTRY) >> LEAF_SHIFT);
            }
        }
    }
    if !loops_run() || (!(any && search.found) && (top ^ opaque_zero) >= STACK_STEP) {
        return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
    }
    return search_hit(search, prepared);
}

// The hit of least (t, triangle).
fn closest_hit(ray: Ray, options: QueryOptions) -> Hit {
    return trace_ray(ray, options, false);
}

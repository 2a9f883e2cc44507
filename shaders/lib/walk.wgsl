// Twin of core/src/query/walk.rs: the walk of a ray down the tree, for closest and any hits. Tree, triangles and
// scene are read from the bindings `nodes`, `leaf_references`, `triangles` and `scene`.
//
// The stack stands in private_stack.wgsl or short_stack.wgsl. Where it is short, or rays and triangles are those of the
// plain case, a ray may be deferred: the triangle of its hit is DEFERRED, and another shader must trace it.
//
// Whether a ray passes what it meets stands in one_hit.wgsl or through_glass.wgsl.
//
// What is done with the triangles of leaves stands in search.wgsl or certain_search.wgsl: a struct `Search` with
// at least `found` and `stop`, and the functions `new_search`, `is_traceable`, `may_skip`, `searched` and
// `search_hit`.

// Where the walk is at no node.
const NO_NODE: u32 = 0xffffffffu;

// A subtree that is yet to be visited, and the ray's interval in it.
struct StackEntry {
    node: u32,
    enter: f32,
    leave: f32,
}

// Where a walk is.
struct Place {
    // NO_NODE in a leaf and after it.
    node: u32,
    // The ray's interval in the node.
    enter: f32,
    leave: f32,
    // At the end there is nothing on the stack, and only then.
    top: u32,
    // What is left of the leaf that the walk is in.
    at: u32,
    end: u32,
    // Whether the stack had no room.
    full: bool,
}

// One node on: from an interior one to the child that is nearer, of those that the ray meets; from a leaf to its triangles.
fn visited(before: Place, ray: PreparedRay) -> Place {
    observe_node();
    var place = before;
    let words = nodes[place.node];
    let tag = words.y & 3u;
    let payload = words.y >> 2u;
    if tag == 3u {
        place.at = words.x;
        place.end = words.x + payload;
        place.node = NO_NODE;
        return place;
    }
    let interval = plane_interval(ray, tag, bitcast<f32>(words.x));
    let backwards = is_backwards(ray, tag);
    let near = select(place.node + 1u, payload, backwards);
    let far = select(payload, place.node + 1u, backwards);
    if interval.y < place.enter {
        place.node = far;
    } else if interval.x > place.leave {
        place.node = near;
    } else if stack_has(place.top) {
        stack_store(place.top, StackEntry(far, most(place.enter, interval.x), place.leave));
        place.top += STACK_STEP;
        place.node = near;
        place.leave = least(place.leave, interval.y);
    } else {
        place.node = NO_NODE;
        place.full = true;
    }
    return place;
}

// False once a driver ends the loops of the invocation, those of triangle tests included: llvmpipe then lets each loop
// run once.
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

// Front to back; both children are visited when the plane lies within its error of the interval;
// triangles are tested against the whole ray; it stops when the next entry lies beyond `stop` of the search.
// `any` ends it at the first hit.
//
// Some drivers end loops that run long: Mesa's llvmpipe after 65,535 rounds of all loops of an
// invocation together. That is noticed after each loop, by conditions that hold after every complete
// run, written so that no compiler can draw this conclusion. The hit is then `UNFINISHED`.
fn walk_ray(ray: Ray, options: QueryOptions, any: bool, root: u32) -> Hit {
    var prepared = prepare_ray(ray);
    if is_deferred() {
        return Hit(GREATEST, DEFERRED, 0.0, 0.0);
    }
    if !prepared.some {
        return no_hit();
    }
    if !is_traceable(ray, prepared) {
        return Hit(-GREATEST, UNDECIDED_HIT, 0.0, 0.0);
    }
    let entered = enter_bounds(prepared);
    if entered.x > entered.y {
        return no_hit();
    }
    var search = new_search();
    let start = Place(root, entered.x, entered.y, stack_start(), 0u, 0u, false);
    var place = start;
    // A closer look is taken outside of the walk: there it costs nothing to rays that take none.
    loop {
        var pending = NO_TRIANGLE;
        // One loop for nodes, triangles and stack: drivers that run rays in step count the rounds of inner loops even
        // for rays that are in none. Three nodes a round, since rounds cost too: on an H100 up to a fifth of the rate.
        loop {
            if place.node != NO_NODE {
                place = visited(place, prepared);
            }
            if place.node != NO_NODE {
                place = visited(place, prepared);
            }
            if place.node != NO_NODE {
                place = visited(place, prepared);
            }
            if place.full {
                return Hit(GREATEST, DEFERRED, 0.0, 0.0);
            }
            if place.node != NO_NODE {
                continue;
            }
            if place.at < place.end {
                let triangle = leaf_references[place.at];
                place.at += 1u;
                if triangle != options.ignore && !may_skip(search, triangle) {
                    observe_triangle();
                    search = searched(search, prepared, triangle, options.culling, any);
                    if search.open {
                        if !looks_closer() {
                            return Hit(GREATEST, DEFERRED, 0.0, 0.0);
                        }
                        pending = triangle;
                        break;
                    }
                    if any && search.found {
                        if !loops_run() {
                            return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
                        }
                        return search_hit(search, prepared);
                    }
                }
            }
            if place.at < place.end {
                continue;
            }
            place.top -= STACK_STEP;
            if place.top >= STACK_STEP {
                let entry = stack_entry(place.top);
                if entry.enter <= search.stop {
                    place.node = entry.node;
                    place.enter = entry.enter;
                    place.leave = entry.leave;
                }
                continue;
            }
            if !passes(search) {
                break;
            }
            // Once more from the start, for what lies behind.
            prepared = passed(prepared, search);
            search = new_search();
            place = start;
        }
        if pending == NO_TRIANGLE {
            break;
        }
        search = searched_closely(search, prepared, pending, options.culling, any);
        if any && search.found {
            if !loops_run() {
                return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
            }
            return search_hit(search, prepared);
        }
    }
    if (place.top ^ opaque_zero) >= STACK_STEP || !loops_run() {
        return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
    }
    return search_hit(search, prepared);
}

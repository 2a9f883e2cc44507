// Twin of core/src/query/walk.rs: the walk of a ray down the tree, for closest and any hits. Tree, triangles and
// scene are read from the bindings `nodes`, `leaf_references`, `triangles` and `scene`.
//
// The stack stands in private_stack.wgsl, short_stack.wgsl or short_stack_workgroup.wgsl. Where it is short, or rays and triangles are those of the
// plain case, a ray may be deferred: the triangle of its hit is DEFERRED, and another shader must trace it. Or the walk is
// complete but for a few triangles that are set aside: then it is UNSETTLED. What is set aside, and what another shader has, stands in
// set_aside.wgsl, nothing_aside.wgsl or taken_up.wgsl.
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
    var enter = entered.x;
    var leave = entered.y;
    if enter > leave {
        return no_hit();
    }
    var search = new_search();
    // At the end there is nothing on the stack, and only then.
    var top = stack_start();
    // None in a leaf and after it.
    var node = first_node(root);
    // What is left of the leaf that the walk is in.
    var at = 0u;
    var end = 0u;
    // A closer look is taken outside of the walk: there it costs nothing to rays that take none.
    // All ways out lead to one end: there rays that run in step meet again before the last of the work.
    var pending = NO_TRIANGLE;
    loop {
        pending = taken_up();
        if pending == NO_TRIANGLE {
            // One loop for nodes, triangles and stack: drivers that run rays in step count the rounds of inner loops even
            // for rays that are in none. Three nodes a round, since rounds cost too: on an H100 4 to 10 % of the rate. They are
            // written out, since a function of one step, on a struct, took up to a third of it.
            loop {
                if node != NO_NODE {
                    observe_node();
                    let words = nodes[node];
                    let tag = words.y & 3u;
                    let payload = words.y >> 2u;
                    if tag != 3u {
                        let interval = plane_interval(prepared, tag, bitcast<f32>(words.x));
                        let backwards = is_backwards(prepared, tag);
                        let near = select(node + 1u, payload, backwards);
                        let far = select(payload, node + 1u, backwards);
                        if interval.y < enter {
                            node = far;
                        } else if interval.x > leave {
                            node = near;
                        } else {
                            if !stack_has(top) {
                                pending = DEFERRED;
                                break;
                            }
                            stack_store(top, StackEntry(far, most(enter, interval.x), leave));
                            top += STACK_STEP;
                            node = near;
                            leave = least(leave, interval.y);
                        }
                    } else {
                        at = words.x;
                        end = at + payload;
                        node = NO_NODE;
                    }
                }
                if node != NO_NODE {
                    observe_node();
                    let words = nodes[node];
                    let tag = words.y & 3u;
                    let payload = words.y >> 2u;
                    if tag != 3u {
                        let interval = plane_interval(prepared, tag, bitcast<f32>(words.x));
                        let backwards = is_backwards(prepared, tag);
                        let near = select(node + 1u, payload, backwards);
                        let far = select(payload, node + 1u, backwards);
                        if interval.y < enter {
                            node = far;
                        } else if interval.x > leave {
                            node = near;
                        } else {
                            if !stack_has(top) {
                                pending = DEFERRED;
                                break;
                            }
                            stack_store(top, StackEntry(far, most(enter, interval.x), leave));
                            top += STACK_STEP;
                            node = near;
                            leave = least(leave, interval.y);
                        }
                    } else {
                        at = words.x;
                        end = at + payload;
                        node = NO_NODE;
                    }
                }
                if node != NO_NODE {
                    observe_node();
                    let words = nodes[node];
                    let tag = words.y & 3u;
                    let payload = words.y >> 2u;
                    if tag != 3u {
                        let interval = plane_interval(prepared, tag, bitcast<f32>(words.x));
                        let backwards = is_backwards(prepared, tag);
                        let near = select(node + 1u, payload, backwards);
                        let far = select(payload, node + 1u, backwards);
                        if interval.y < enter {
                            node = far;
                        } else if interval.x > leave {
                            node = near;
                        } else {
                            if !stack_has(top) {
                                pending = DEFERRED;
                                break;
                            }
                            stack_store(top, StackEntry(far, most(enter, interval.x), leave));
                            top += STACK_STEP;
                            node = near;
                            leave = least(leave, interval.y);
                        }
                        continue;
                    }
                    at = words.x;
                    end = at + payload;
                    node = NO_NODE;
                }
                if at < end {
                    let triangle = leaf_references[at];
                    at += 1u;
                    if triangle != options.ignore && !may_skip(search, triangle) {
                        observe_triangle();
                        search = searched(search, prepared, triangle, options.culling, any);
                        if search.open {
                            search.open = false;
                            if !set_aside(triangle) {
                                pending = select(DEFERRED, triangle, looks_closer());
                                break;
                            }
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
                if top >= STACK_STEP {
                    let entry = stack_entry(top);
                    if entry.enter <= search.stop {
                        node = entry.node;
                        enter = entry.enter;
                        leave = entry.leave;
                    }
                    continue;
                }
                if !passes(search) {
                    break;
                }
                // Once more from the start, for what lies behind.
                prepared = passed(prepared, search);
                search = new_search();
                top = stack_start();
                node = root;
                enter = entered.x;
                leave = entered.y;
            }
        }
        if pending == NO_TRIANGLE || pending == DEFERRED || (any && search.found) {
            break;
        }
        search = searched_closely(search, prepared, pending, options.culling, any);
        if any && search.found {
            break;
        }
    }
    if pending == DEFERRED {
        return Hit(GREATEST, DEFERRED, 0.0, 0.0);
    }
    let ended = any && search.found;
    if !loops_run() || (!ended && (top ^ opaque_zero) >= STACK_STEP) {
        return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
    }
    if !ended && leaves_aside(best_triangle(search)) {
        return Hit(GREATEST, UNSETTLED, 0.0, 0.0);
    }
    return search_hit(search, prepared);
}

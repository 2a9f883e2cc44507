// Twin of the traversal of core/src/certify.rs: exact hits where they are certain. Tree, triangles and
// scene are read from the bindings `nodes`, `leaf_references`, `triangles` and `scene`. Stands in place
// of traverse.wgsl, with the same functions for others to call.

// MAX_DEPTH + 1: one entry a level, and the first, which is not used.
const STACK_ENTRIES: u32 = 97u;

// A subtree that is yet to be visited, and the ray's interval in it.
struct StackEntry {
    node: u32,
    enter: f32,
    leave: f32,
}

// What a traversal has found.
struct Search {
    found: bool,
    // Of `best`, if it was found.
    triangle: u32,
    best: Certain,
    // Inner `t`: nothing that is in doubt is nearer. GREATEST where nothing is in doubt.
    doubt: f32,
    // No leaf farther than this is of interest.
    stop: f32,
}

// The search after it took note of what is certain of a triangle.
fn noted(before: Search, verdict: Verdict, triangle: u32, corners: Triangle) -> Search {
    var search = before;
    if verdict.kind == VERDICT_NOT {
        return search;
    }
    if verdict.kind == VERDICT_IN_DOUBT {
        search.doubt = least(search.doubt, verdict.least);
        return search;
    }
    if search.found {
        let order = compare_t(verdict.met, corners, search.best, corners_of(search.triangle));
        if order == COMPARED_GREATER || (order == COMPARED_EQUAL && triangle > search.triangle) {
            return search;
        }
        if order == COMPARED_OPEN {
            search.doubt = least(search.doubt, least(least_t(verdict.met), least_t(search.best)));
            return search;
        }
    }
    search.found = true;
    search.triangle = triangle;
    search.best = verdict.met;
    return search;
}

// What was found, as a hit.
fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    if search.found && greatest_t(search.best) < search.doubt {
        let t = scale(search.best.t.high, -ray.exponent);
        return Hit(t, search.triangle, search.best.u, search.best.v);
    }
    if !search.found && search.doubt == GREATEST {
        return no_hit();
    }
    var t = search.doubt;
    if search.found {
        t = least(t, least_t(search.best));
    }
    return Hit(scale(t, -ray.exponent), UNDECIDED_HIT, 0.0, 0.0);
}

// As in traverse.wgsl: front to back, with the same care for drivers that end loops. The hit is
// `UNDECIDED_HIT` where what is in doubt may precede it.
fn trace_ray(ray: Ray, options: QueryOptions, any: bool) -> Hit {
    opaque_zero = scene.zero;
    let prepared = prepare_ray(ray);
    if !prepared.some {
        return no_hit();
    }
    if !is_as_given(ray, prepared) {
        return Hit(-GREATEST, UNDECIDED_HIT, 0.0, 0.0);
    }
    let entered = enter_bounds(prepared);
    var enter = entered.x;
    var leave = entered.y;
    if enter > leave {
        return no_hit();
    }
    var search =
        Search(false, NO_TRIANGLE, Certain(Double(0.0, 0.0), 0.0, 0.0, 0.0), GREATEST, GREATEST);
    var stack: array<StackEntry, STACK_ENTRIES>;
    // Entry 0 is not used: at the end `top` is 0, and only then.
    var top = 1u;
    var node = 0u;
    var cut_short = false;
    loop {
        observe_node();
        let words = nodes[node];
        let tag = words.y & 3u;
        let payload = words.y >> 2u;
        if tag != 3u {
            let interval = plane_interval(prepared, tag, bitcast<f32>(words.x));
            let backwards = on_axis(prepared.direction, tag) < 0.0;
            let near = select(node + 1u, payload, backwards);
            let far = select(payload, node + 1u, backwards);
            if interval.y < enter {
                node = far;
            } else if interval.x > leave {
                node = near;
            } else {
                stack[top] = StackEntry(far, most(enter, interval.x), leave);
                top += 1u;
                node = near;
                leave = least(leave, interval.y);
            }
            continue;
        }
        var i = 0u;
        loop {
            if i >= payload {
                break;
            }
            let triangle = leaf_references[words.x + i];
            i += 1u;
            if triangle == options.ignore || (search.found && triangle == search.triangle) {
                continue;
            }
            observe_triangle();
            let corners = corners_of(triangle);
            let verdict = examine(prepared, corners, options.culling, search.stop);
            search = noted(search, verdict, triangle, corners);
            if any && search.found {
                // Whatever is in doubt, this is hit.
                search.doubt = GREATEST;
                return search_hit(search, prepared);
            }
            if !any {
                search.stop = search.doubt;
                if search.found {
                    let greatest = greatest_t(search.best);
                    search.stop = least(search.doubt, stop_after(prepared, greatest, greatest));
                }
            }
        }
        cut_short = cut_short || (i ^ opaque_zero) < payload;
        loop {
            top -= 1u;
            if top == 0u {
                break;
            }
            let entry = stack[top];
            if entry.enter <= search.stop {
                node = entry.node;
                enter = entry.enter;
                leave = entry.leave;
                break;
            }
        }
        if top == 0u {
            break;
        }
    }
    if cut_short || (top ^ opaque_zero) != 0u {
        return Hit(GREATEST, UNFINISHED, 0.0, 0.0);
    }
    return search_hit(search, prepared);
}

// The exact hit of least (t, triangle) where it is certain; else its triangle is `UNDECIDED_HIT`.
fn closest_hit(ray: Ray, options: QueryOptions) -> Hit {
    return trace_ray(ray, options, false);
}

// Whether the ray hits anything for certain. False for a ray that is undecided or unfinished.
fn any_hit(ray: Ray, options: QueryOptions) -> bool {
    return is_hit(trace_ray(ray, options, true));
}

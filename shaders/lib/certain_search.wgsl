// Twin of `Search` in core/src/query/certify.rs: a traversal looks for exact hits and tells those that
// are certain. In place of search.wgsl, with the same functions for traverse.wgsl to call. The hit
// is `UNDECIDED_HIT` where something undecided may precede it.

// What a traversal has found.
struct Search {
    found: bool,
    // No triangle takes a closer look.
    open: bool,
    // Of `best`, if it was found.
    triangle: u32,
    best: Certain,
    // Inner `t`: nothing undecided is nearer. GREATEST where nothing is undecided.
    doubt: f32,
    // No leaf farther than this is of interest.
    stop: f32,
}

fn new_search() -> Search {
    let nothing = Certain(Double(0.0, 0.0), 0.0, 0.0, 0.0);
    return Search(false, false, NO_TRIANGLE, nothing, GREATEST, GREATEST);
}

// Whether hits can be told of the ray at all.
fn is_traceable(ray: Ray, prepared: PreparedRay) -> bool {
    return is_as_given(ray, prepared);
}

// Whether a triangle need not be tested: it is the best one.
fn may_skip(search: Search, triangle: u32) -> bool {
    return search.found && triangle == search.triangle;
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

// The search after a triangle was tested. With `any` the first certain hit is the answer.
fn searched(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    let corners = corners_of(triangle);
    var search =
        noted(before, examine(ray, corners, culling, before.stop), triangle, corners);
    if any {
        if search.found {
            // Whatever is undecided, this is hit.
            search.doubt = GREATEST;
        }
        return search;
    }
    search.stop = search.doubt;
    if search.found {
        let greatest = greatest_t(search.best);
        search.stop = least(search.doubt, stop_after(ray, greatest, greatest));
    }
    return search;
}

// What was found, as a hit.
fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    if search.found && greatest_t(search.best) < search.doubt {
        let t = scale(search.best.t.high, -exponent_of(ray));
        return Hit(t, search.triangle, search.best.u, search.best.v);
    }
    if !search.found && search.doubt == GREATEST {
        return no_hit();
    }
    var t = search.doubt;
    if search.found {
        t = least(t, least_t(search.best));
    }
    return Hit(scale(t, -exponent_of(ray)), UNDECIDED_HIT, 0.0, 0.0);
}

fn looks_closer() -> bool {
    return false;
}

fn searched_closely(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    return before;
}

// The best triangle so far, for what is left of a walk.
fn best_triangle(search: Search) -> u32 {
    return select(NO_TRIANGLE, search.triangle, search.found);
}

// What a traversal looks for with a triangle test: the hit of least (t, triangle), or any. Twin of `Best` in
// core/src/query/traverse.rs; certain_search.wgsl stands in its place where hits are to be certain.

// What a traversal has found.
struct Search {
    found: bool,
    // Whether the last triangle takes a closer look.
    open: bool,
    // The caller's.
    t: f32,
    triangle: u32,
    weights: vec3<f32>,
    // No leaf farther than this is of interest.
    stop: f32,
}

fn new_search() -> Search {
    return Search(false, false, GREATEST, NO_TRIANGLE, vec3<f32>(), GREATEST);
}

// Whether hits can be told of the ray at all: of every one.
fn is_traceable(ray: Ray, prepared: PreparedRay) -> bool {
    return true;
}

// Whether a triangle need not be tested: where tests are not counted, the best so far, which may lie in the next leaf too.
fn may_skip(search: Search, triangle: u32) -> bool {
    return skips_best() && triangle == search.triangle;
}

// True when a hit comes before what was found: lesser `t`, at equal `t` the lower triangle index.
fn precedes(t: f32, triangle: u32, search: Search) -> bool {
    return t < search.t || (t == search.t && triangle < search.triangle);
}

// The search after a triangle was tested. With `any` the first hit is the answer.
fn searched(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    let candidate = test_triangle(ray, triangle, culling, before.stop);
    if candidate.open {
        var search = before;
        search.open = true;
        if !looks_closer() && candidate.some {
            search = narrowed(search, ray, candidate);
        }
        return search;
    }
    return accepted(before, ray, triangle, candidate, any);
}

// The search after a triangle that is met, though where is known within bounds only. What is certainly behind the best hit needs no closer
// look; what is certainly met ends the search where it lies at the farthest.
fn narrowed(before: Search, ray: PreparedRay, candidate: Candidate) -> Search {
    var search = before;
    if candidate.weights.x > before.stop {
        search.open = false;
        return search;
    }
    let farthest = outer_t(ray, candidate.t);
    if within_limits(ray, outer_t(ray, candidate.weights.x)) && within_limits(ray, farthest) {
        search.stop = least(before.stop, stop_after(ray, candidate.t, farthest));
    }
    return search;
}

// The search after a closer look at a triangle that was left open.
fn searched_closely(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    var search = before;
    search.open = false;
    return accepted(search, ray, triangle, test_closely(ray, triangle, culling), any);
}

fn accepted(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    candidate: Candidate,
    any: bool,
) -> Search {
    var search = before;
    if !candidate.some {
        return search;
    }
    let t = outer_t(ray, candidate.t);
    if !within_limits(ray, t) {
        return search;
    }
    if any || precedes(t, triangle, search) {
        search.found = true;
        search.t = t;
        search.triangle = triangle;
        search.weights = candidate.weights;
        search.stop = stop_after(ray, candidate.t, t);
    }
    return search;
}

// What was found, as a hit.
fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    if !search.found {
        return no_hit();
    }
    let at = barycentric(ray, search.triangle, search.weights);
    return Hit(search.t, search.triangle, at.x, at.y);
}

// The best triangle so far, for what is left of a walk.
fn best_triangle(search: Search) -> u32 {
    return select(NO_TRIANGLE, search.triangle, search.found);
}

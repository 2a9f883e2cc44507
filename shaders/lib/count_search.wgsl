// A traversal that counts the triangles which the ray crosses for certain: twin of core/src/query/certify/counting.rs. In
// place of search.wgsl, with the same functions for traverse.wgsl to call. The hit is `UNDECIDED_HIT` where the CPU must count.

// What a traversal has found.
struct Search {
    found: bool,
    // No triangle takes a closer look.
    open: bool,
    // No leaf farther than this is of interest.
    stop: f32,
    // Whether the CPU must count.
    undecided: bool,
    // The last triangles that were counted, which mostly come again soon.
    recent: vec4<u32>,
}

fn new_search() -> Search {
    return Search(false, false, GREATEST, false, vec4<u32>(NO_TRIANGLE));
}

// Whether it can be told of the ray what it crosses.
fn is_traceable(ray: Ray, prepared: PreparedRay) -> bool {
    return is_as_given(ray, prepared);
}

fn may_skip(search: Search, triangle: u32) -> bool {
    return search.undecided || any(search.recent == vec4<u32>(triangle));
}

// Not crossed between the limits, or from a side that does not count.
const CROSSES_NOT: u32 = 0u;
// Crossed away from edges, strictly between the limits.
const CROSSES_FROM_FRONT: u32 = 1u;
const CROSSES_FROM_BACK: u32 = 2u;
// Perhaps crossed, or at an edge or a limit.
const CROSSES_IN_DOUBT: u32 = 3u;

fn crosses(ray: PreparedRay, triangle: Triangle, culling: u32) -> u32 {
    let screened = screen(ray, triangle, culling, GREATEST);
    if !screened.some {
        return CROSSES_NOT;
    }
    let signs = signs_of_edges(ray, triangle, screened);
    if signs.positive && signs.negative {
        return CROSSES_NOT;
    }
    if signs.open || any(signs.known == vec3<f32>(0.0)) {
        return CROSSES_IN_DOUBT;
    }
    if is_culled(signs, culling) {
        return CROSSES_NOT;
    }
    let verdict = distance_of(ray, triangle, GREATEST, signs.known, screened.nearest, false);
    if verdict.kind == VERDICT_NOT {
        return CROSSES_NOT;
    }
    // A distance without error is zero: at the origin.
    if verdict.kind == VERDICT_IN_DOUBT || verdict.met.error == 0.0 {
        return CROSSES_IN_DOUBT;
    }
    return select(CROSSES_FROM_BACK, CROSSES_FROM_FRONT, signs.positive);
}

fn searched(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    var search = before;
    let crossing = crosses(ray, corners_of(triangle), culling);
    if crossing == CROSSES_NOT {
        return search;
    }
    search.recent = vec4<u32>(triangle, before.recent.xyz);
    if crossing == CROSSES_IN_DOUBT || !count_crossing(triangle, crossing == CROSSES_FROM_FRONT) {
        search.undecided = true;
        search.stop = -GREATEST;
    }
    return search;
}

// A traversal that was followed to its end. What it has counted is in the ray's list.
fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    return Hit(GREATEST, select(NO_TRIANGLE, UNDECIDED_HIT, search.undecided), 0.0, 0.0);
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
    return NO_TRIANGLE;
}

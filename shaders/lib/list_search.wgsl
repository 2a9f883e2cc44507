// A traversal that lists the triangles which the ray may meet between its limits: twin of
// core/src/query/certify/listing.rs. In place of search.wgsl, with the same functions for traverse.wgsl to call. Nothing
// ends it before the last leaf.

// What a traversal has found.
struct Search {
    found: bool,
    // No triangle takes a closer look.
    open: bool,
    stop: f32,
    // The last triangles that were listed. One that lies in several leaves comes several times, soon after one another
    // mostly; who reads the list drops the others.
    recent: vec4<u32>,
}

fn new_search() -> Search {
    return Search(false, false, GREATEST, vec4<u32>(NO_TRIANGLE));
}

// Whether it can be told of the ray what it misses.
fn is_traceable(ray: Ray, prepared: PreparedRay) -> bool {
    return is_as_given(ray, prepared);
}

fn may_skip(search: Search, triangle: u32) -> bool {
    return any(search.recent == vec4<u32>(triangle));
}

fn searched(
    before: Search,
    ray: PreparedRay,
    triangle: u32,
    culling: u32,
    any: bool,
) -> Search {
    var search = before;
    if screen(ray, corners_of(triangle), culling, GREATEST).some {
        add_to_list(triangle);
        search.recent = vec4<u32>(triangle, before.recent.xyz);
    }
    return search;
}

// A traversal that was followed to its end. What it found is in the list.
fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    return no_hit();
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

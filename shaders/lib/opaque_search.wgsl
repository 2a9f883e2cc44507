// What a traversal looks for where geometries may have opacity masks: of the hits in cells that are opaque, that of least
// (t, triangle), or any. In place of search.wgsl, which says what the parts are for.

struct Search {
    found: bool,
    open: bool,
    t: f32,
    triangle: u32,
    weights: vec3<f32>,
    stop: f32,
}

fn new_search() -> Search {
    return Search(false, false, GREATEST, NO_TRIANGLE, vec3<f32>(), GREATEST);
}

fn is_traceable(ray: Ray, prepared: PreparedRay) -> bool {
    return true;
}

fn may_skip(search: Search, triangle: u32) -> bool {
    return skips_best() && triangle == search.triangle;
}

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
        // What is certainly behind the best hit needs no closer look.
        search.open = looks_closer() || !candidate.some || candidate.weights.x <= before.stop;
        return search;
    }
    return accepted(before, ray, triangle, candidate, any);
}

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
    let first = any || t < search.t || (t == search.t && triangle < search.triangle);
    if !first || !within_limits(ray, t) || !is_opaque(triangle, candidate.weights) {
        return search;
    }
    search.found = true;
    search.t = t;
    search.triangle = triangle;
    search.weights = candidate.weights;
    search.stop = stop_after(ray, candidate.t, t);
    return search;
}

// Whether a hit counts, by its weights. Twin of `PackedScene::is_opaque` in core/src/backend/scene/packed/trace.rs.
fn is_opaque(triangle: u32, weights: vec3<f32>) -> bool {
    let mask = instances[8u * entered + 6u].w;
    if mask == 0u {
        return true;
    }
    let level = leaf_references[mask];
    let own = triangle - leaf_references[mask + 1u];
    let cell = opacity_cell(level, weights_over(weights));
    // Cells before those of the triangle are whole words from level 3 on, and fewer than 2^32 below it.
    let bits = 2u * level;
    let bit = (own << bits) + cell;
    let word = select(bit >> 5u, (own << ((bits - 5u) & 31u)) + (cell >> 5u), bits > 5u);
    return ((leaf_references[mask + 2u + word] >> (bit & 31u)) & 1u) != 0u;
}

// The micro-cell of a place in a triangle. Twin of core/src/scene/opacity.rs: all but the sum is exact.
fn opacity_cell(level: u32, place: vec2<f32>) -> u32 {
    let edge = 1u << level;
    let u = snap(product(clamp(place.x, 0.0, 1.0), f32(edge)));
    let v = snap(product(clamp(place.y, 0.0, 1.0), f32(edge)));
    let column = min(u32(u), edge - 1u);
    let row = min(u32(v), edge - 1u);
    let upper = sum(difference(u, f32(column)), difference(v, f32(row))) >= 1.0;
    return row * (2u * edge - row) + min(2u * column + select(0u, 1u, upper), 2u * (edge - row) - 2u);
}

fn search_hit(search: Search, ray: PreparedRay) -> Hit {
    if !search.found {
        return no_hit();
    }
    let at = barycentric(ray, search.triangle, search.weights);
    return Hit(search.t, search.triangle, at.x, at.y);
}

fn best_triangle(search: Search) -> u32 {
    return select(NO_TRIANGLE, search.triangle, search.found);
}

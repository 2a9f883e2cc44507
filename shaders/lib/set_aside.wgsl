// Triangles that take a closer look are set aside, and the walk goes on. What it leaves is little work for another shader, which has
// taken_up.wgsl: to test these and the best that is certain. In place of nothing_aside.wgsl.
//
// Of sponza's camera rays one in eleven meets such a triangle. To walk these again, by a shader for any ray, took an H100 about a third of
// the time that the lean walk of all of them takes.

// Names of triangles: 0 for none, else one more than the index.
var<private> aside: vec2<u32>;
// The best of the others, when the walk is over.
var<private> best_aside: u32;

// Whether there is room for a triangle, or it is there already: leaves share triangles.
fn set_aside(triangle: u32) -> bool {
    let name = triangle + 1u;
    if aside.x == 0u || aside.x == name {
        aside.x = name;
        return true;
    }
    if aside.y == 0u || aside.y == name {
        aside.y = name;
        return true;
    }
    return false;
}

// Whether anything is left for another shader, at the end of a walk that has found this, or NO_TRIANGLE.
fn leaves_aside(best: u32) -> bool {
    best_aside = best + 1u;
    return aside.x != 0u;
}

// What is left, for the list of deferred rays, none behind the last: nothing where the whole walk is.
fn left_aside(hit: Hit) -> vec3<u32> {
    let all_three = vec3<u32>(aside, best_aside);
    let names = select(all_three, all_three.xzy, aside.y == 0u);
    return select(vec3<u32>(), names, hit.triangle == UNSETTLED);
}

// The best so far is not tested again: camera rays of sponza take 4 to 7 % less time on an H100. To skip the one
// that was tested last as well gave half a percent, and 72 registers of NVIDIA's compiler in place of 64.
fn skips_best() -> bool {
    return true;
}

fn taken_up() -> u32 {
    return NO_TRIANGLE;
}

fn first_node(root: u32) -> u32 {
    return root;
}

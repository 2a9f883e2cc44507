// The crossings of a batch: `batch.room` triangles a ray that were counted, and the counts. A count is a word, from the front
// in its lower half, from the back in its upper half; or a mark in place of it: UNFINISHED, UNDECIDED_HIT or DEFERRED.

@group(0) @binding(5) var<storage, read_write> listed: array<u32>;
@group(0) @binding(8) var<storage, read_write> counted: array<u32>;

// Where the ray's words begin.
var<private> count_start: u32;
// How many triangles were counted: from the front, and from the back.
var<private> count_sides: vec2<u32>;

fn begin_count(index: u32) {
    count_start = index * batch.room;
    count_sides = vec2<u32>(0u);
}

// Counts a triangle, unless it was counted. False where there is no room for it.
fn count_crossing(triangle: u32, front: bool) -> bool {
    let length = count_sides.x + count_sides.y;
    for (var at = 0u; at < length; at++) {
        if listed[count_start + at] == triangle {
            return true;
        }
    }
    if length >= batch.room {
        return false;
    }
    listed[count_start + length] = triangle;
    count_sides += select(vec2<u32>(0u, 1u), vec2<u32>(1u, 0u), front);
    return true;
}

// Writes the count, when the ray's traversal has ended like this.
fn end_count(index: u32, hit: Hit) {
    let sides = count_sides.x | (count_sides.y << 16u);
    counted[index] = select(hit.triangle, sides, hit.triangle == NO_TRIANGLE);
}

// The lists of a batch: `batch.room` words a ray. The first is the number of triangles found, or a mark in place of the
// answer: UNFINISHED, UNDECIDED_HIT or DEFERRED. Then come as many of the triangles as there is room for.

@group(0) @binding(5) var<storage, read_write> listed: array<u32>;

// Where the ray's words begin.
var<private> list_start: u32;
// How many triangles were found.
var<private> list_length: u32;

fn begin_list(index: u32) {
    list_start = index * batch.room;
    list_length = 0u;
}

fn add_to_list(triangle: u32) {
    list_length += 1u;
    if list_length < batch.room {
        listed[list_start + list_length] = triangle;
    }
}

// Writes the first word, when the ray's traversal has ended like this.
fn end_list(hit: Hit) {
    listed[list_start] = select(hit.triangle, list_length, hit.triangle == NO_TRIANGLE);
}

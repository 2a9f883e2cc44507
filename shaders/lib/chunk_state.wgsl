// The state of each chunk: counts, sides and bounds, one array after the other in the binding
// `chunk_state`. Twins of Sides, ChunkSides and ChunkBounds in core/src/layout.rs.

fn load_counts(chunk: u32) -> vec2<u32> {
    return vec2<u32>(chunk_state[2u * chunk], chunk_state[2u * chunk + 1u]);
}

// First word of a chunk's sides: eight for left, eight for right.
fn sides_of(chunk: u32) -> u32 {
    return 2u * parameters.chunk_room + 16u * chunk;
}

// First word of the bounds of what went to one side.
fn bounds_of(chunk: u32, side: u32) -> u32 {
    return 18u * parameters.chunk_room + 12u * chunk + 6u * side;
}

fn load_bounds(chunk: u32, side: u32) -> Aabb {
    let at = bounds_of(chunk, side);
    return Aabb(
        vec3<f32>(
            bitcast<f32>(chunk_state[at]),
            bitcast<f32>(chunk_state[at + 1u]),
            bitcast<f32>(chunk_state[at + 2u]),
        ),
        vec3<f32>(
            bitcast<f32>(chunk_state[at + 3u]),
            bitcast<f32>(chunk_state[at + 4u]),
            bitcast<f32>(chunk_state[at + 5u]),
        ),
    );
}

// Writing the bounds that `chunk_state.wgsl` reads.

// Writes the bounds that the last reduction left (see reduce.wgsl), of the left side or of both: one word by each lane.
fn store_reduced_bounds(chunk: u32, lane: u32) {
    if lane < 6u {
        chunk_state[bounds_of(chunk, 0u) + lane] = bitcast<u32>(reduced[lane]);
    }
}

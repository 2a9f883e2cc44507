// Writing the bounds that `chunk_state.wgsl` reads.

// Writes the bounds that the last reduction left (see reduce.wgsl): one word by each of six lanes.
fn store_reduced_bounds(chunk: u32, side: u32, lane: u32) {
    if lane < 6u {
        chunk_state[bounds_of(chunk, side) + lane] = bitcast<u32>(reduced[lane]);
    }
}

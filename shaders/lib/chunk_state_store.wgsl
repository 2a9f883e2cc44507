// Writing the counts that `chunk_state.wgsl` reads.

fn store_counts(chunk: u32, counts: vec2<u32>) {
    chunk_state[2u * chunk] = counts.x;
    chunk_state[2u * chunk + 1u] = counts.y;
}

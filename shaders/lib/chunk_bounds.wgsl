// The bounds of each chunk, for kernels that read nothing else of `chunk_state` and so bind it as pairs of words: half as
// many loads as chunk_state.wgsl takes. Each of the arrays there has an even number of words an element.

fn load_bounds(chunk: u32, side: u32) -> Aabb {
    let at = 9u * parameters.chunk_room + 6u * chunk + 3u * side;
    let a = bitcast<vec2<f32>>(chunk_state[at]);
    let b = bitcast<vec2<f32>>(chunk_state[at + 1u]);
    let c = bitcast<vec2<f32>>(chunk_state[at + 2u]);
    return Aabb(vec3<f32>(a, b.x), vec3<f32>(b.y, c));
}

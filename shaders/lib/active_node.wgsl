// What a workgroup does first with an active node: it names the node's chunks and bounds the node. Twin of `name_chunks` and
// `node_bounds` in core/src/build/reference/kernels.
// Needs the bindings `chunk_state` and `chunks`.

// Names node and range of the chunks of active node `index`.
fn name_chunks(index: u32, node: LargeNode, lane: u32) {
    for (var offset = CHUNK * lane; offset < node.count; offset += CHUNK * LANES) {
        chunks[node.first_chunk + offset / CHUNK] =
            Chunk(index, node.first + offset, min(CHUNK, node.count - offset), 0u);
    }
}

// Leaves the node's tight bounds in `reduced`: segmented reduction over the chunks of its parent (Zhou et al. 2008,
// Algorithm 2).
fn bound_node(node: LargeNode, lane: u32) {
    var bounds = empty_aabb();
    for (var chunk = lane; chunk < node.source_chunks; chunk += LANES) {
        let here = load_bounds(node.source + chunk, node.side);
        bounds = Aabb(least3(bounds.lo, here.lo), most3(bounds.hi, here.hi));
    }
    reduce_bounds(lane, bounds);
}

// Goes on to the next level.
// One workgroup, of which one invocation does it.
// Reads: the counters.
// Writes: the counters.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    if lane != 0u || large_count() == 0u {
        return;
    }
    let height = height_of_level() - 1u;
    let is_large = height > SMALL_HEIGHT;
    let nodes = (block_count() + (1u << height) - 1u) >> height;
    counters[3] = select(0u, chunk_count(), is_large);
    counters[4] = select(0u, nodes, is_large);
    counters[5] = height;
}

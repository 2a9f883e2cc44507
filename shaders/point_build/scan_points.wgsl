// Gives the points of each chunk their places, and finds the tree's unit and height.
// One workgroup, each invocation a run of chunks.
// Reads: how many points of each chunk are kept, and the greatest coordinates.
// Writes: the place of the first point of each chunk; the counters.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read_write> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> chunk_measures: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> chunk_places: array<u32>;

var<workgroup> greatest: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
    opaque_zero = point_build.zero;
    if lane == 0u {
        atomicStore(&greatest, 0u);
    }
    workgroupBarrier();
    let chunks = counters[0];
    let run = (chunks + LANES - 1u) / LANES;
    let start = min(chunks, lane * run);
    let end = min(chunks, start + run);
    var own = 0u;
    var own_greatest = 0u;
    for (var chunk = start; chunk < end; chunk++) {
        let measured = chunk_measures[chunk];
        own += measured.x;
        own_greatest = max(own_greatest, measured.y);
    }
    atomicMax(&greatest, own_greatest);
    var next = inclusive_scan(lane, vec2<u32>(own, 0u)).x - own;
    for (var chunk = start; chunk < end; chunk++) {
        chunk_places[chunk] = next;
        next += chunk_measures[chunk].x;
    }
    workgroupBarrier();
    if lane != 0u {
        return;
    }
    let kept = scan_sum().x;
    let blocks = (kept + POINT_BLOCK - 1u) / POINT_BLOCK;
    // The least height of a node that has all blocks.
    let height = select(0u, firstLeadingBit(max(blocks, 2u) - 1u) + 1u, blocks > 1u);
    let all_chunks = (kept + POINT_CHUNK - 1u) / POINT_CHUNK;
    let is_large = height > SMALL_HEIGHT;
    counters[1] = kept;
    counters[2] = all_chunks;
    counters[3] = select(0u, all_chunks, is_large);
    counters[4] = select(0u, 1u, is_large);
    counters[5] = height;
    counters[6] = height;
    counters[7] = u32(clamp(exponent(bitcast<f32>(atomicLoad(&greatest))), -126, 126) + 127);
    counters[8] = max(blocks, 1u) - 1u;
}

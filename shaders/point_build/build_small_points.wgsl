// Finishes the subtree of each chunk: sorts the points of its nodes level by level, and those of blocks by index.
// One workgroup a chunk.
// Reads: records.
// Writes: nodes of the tree; points and indices.
// Ties: points with the same coordinate by index; of axes along which points reach equally far, the first.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> records: array<PointRecord>;
@group(0) @binding(3) var<storage, read_write> nodes: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> points: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> indices: array<u32>;

// Most nodes of a level that are divided: those of two blocks.
const MOST_SMALL: u32 = POINT_CHUNK / (2u * POINT_BLOCK);
const SIDES: u32 = 4u * MOST_SMALL;

// What points are sorted by, and then by their places in the chunk at first, which are in the order of indices.
var<workgroup> keys: array<u32, POINT_CHUNK>;
var<workgroup> order: array<u32, POINT_CHUNK>;
// Four coordinates a node.
var<workgroup> lower: array<atomic<u32>, SIDES>;
var<workgroup> upper: array<atomic<u32>, SIDES>;
var<workgroup> axes: array<u32, MOST_SMALL>;

// Whether one place of the order comes after another.
fn is_after(a: u32, b: u32) -> bool {
    return keys[a] > keys[b] || (keys[a] == keys[b] && order[a] > order[b]);
}

// Sorts each run of so many points, a power of two (Batcher 1968). Every lane must call it.
fn sort_runs(lane: u32, run: u32) {
    for (var size = 2u; size <= run; size *= 2u) {
        for (var stride = size / 2u; stride > 0u; stride /= 2u) {
            for (var pair = lane; pair < POINT_CHUNK / 2u; pair += LANES) {
                let low = ((pair & ~(stride - 1u)) << 1u) | (pair & (stride - 1u));
                let high = low + stride;
                let is_rising = size == run || (low & size) == 0u;
                if is_after(low, high) == is_rising {
                    let key = keys[low];
                    keys[low] = keys[high];
                    keys[high] = key;
                    let place = order[low];
                    order[low] = order[high];
                    order[high] = place;
                }
            }
            workgroupBarrier();
        }
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = point_build.zero;
    let top = min(root_height(), SMALL_HEIGHT);
    for (var chunk = workgroup.x; chunk < chunk_count(); chunk += workgroups.x) {
        let start = chunk * POINT_CHUNK;
        let here = min(POINT_CHUNK, kept_count() - start);
        for (var at = lane; at < POINT_CHUNK; at += LANES) {
            order[at] = at;
        }
        workgroupBarrier();
        for (var height = top; height > 0u; height--) {
            let run = POINT_BLOCK << height;
            let small = POINT_CHUNK / run;
            let first = chunk << (SMALL_HEIGHT - height);
            for (var side = lane; side < SIDES; side += LANES) {
                atomicStore(&lower[side], 0xffffffffu);
                atomicStore(&upper[side], 0u);
            }
            workgroupBarrier();
            if point_build.widest == 1u {
                for (var at = lane; at < POINT_CHUNK; at += LANES) {
                    if order[at] < here {
                        let record = records[start + order[at]];
                        let side = 4u * (at / run);
                        for (var axis = 0u; axis < point_build.dimensions; axis++) {
                            let bits = bits_along(record, axis);
                            atomicMin(&lower[side + axis], bits);
                            atomicMax(&upper[side + axis], bits);
                        }
                    }
                }
            }
            workgroupBarrier();
            if lane < small {
                let node = first + lane;
                var axis = cycled_axis(node, height);
                if point_build.widest == 1u {
                    let side = 4u * lane;
                    let least_bits = vec4<u32>(
                        atomicLoad(&lower[side]),
                        atomicLoad(&lower[side + 1u]),
                        atomicLoad(&lower[side + 2u]),
                        atomicLoad(&lower[side + 3u]),
                    );
                    let most_bits = vec4<u32>(
                        atomicLoad(&upper[side]),
                        atomicLoad(&upper[side + 1u]),
                        atomicLoad(&upper[side + 2u]),
                        atomicLoad(&upper[side + 3u]),
                    );
                    axis = widest_axis(least_bits, most_bits);
                }
                axes[lane] = select(UNDIVIDED, axis, middle_of(node, height) < block_count());
            }
            workgroupBarrier();
            for (var at = lane; at < POINT_CHUNK; at += LANES) {
                let axis = axes[at / run];
                // Those of an undivided node stay in order; places without a point come last.
                var key = select(0u, 0xffffffffu, order[at] >= here);
                if order[at] < here && axis != UNDIVIDED {
                    key = bits_along(records[start + order[at]], axis);
                }
                keys[at] = key;
            }
            workgroupBarrier();
            sort_runs(lane, run);
            if lane < small && axes[lane] != UNDIVIDED {
                let plane = bitcast<u32>(from_ordered(keys[lane * run + run / 2u]));
                nodes[middle_of(first + lane, height) - 1u] = vec2<u32>(plane, axes[lane]);
            }
            workgroupBarrier();
        }
        for (var at = lane; at < POINT_CHUNK; at += LANES) {
            keys[at] = 0u;
        }
        workgroupBarrier();
        sort_runs(lane, POINT_BLOCK);
        for (var at = lane; at < here; at += LANES) {
            let record = records[start + order[at]];
            points[start + at] = vec4<f32>(
                from_ordered(record.x),
                from_ordered(record.y),
                from_ordered(record.z),
                from_ordered(record.w),
            );
            indices[start + at] = record.point;
        }
        workgroupBarrier();
    }
}

// Chooses the axis of each large node, and begins the search for its plane.
// One workgroup a large node.
// Reads: between which coordinates the points of its chunks lie, where axes are the widest.
// Writes: the axis, and how many points come before the plane.
// Ties: of axes along which points reach equally far, the first.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> chunk_extents: array<PointExtent>;
@group(0) @binding(3) var<storage, read_write> splits: array<PointSplit>;

var<workgroup> lower: array<atomic<u32>, 4>;
var<workgroup> upper: array<atomic<u32>, 4>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = point_build.zero;
    let height = height_of_level();
    for (var node = workgroup.x; node < large_count(); node += workgroups.x) {
        if lane < 4u {
            atomicStore(&lower[lane], 0xffffffffu);
            atomicStore(&upper[lane], 0u);
        }
        workgroupBarrier();
        if point_build.widest == 1u {
            let first = node << (height - SMALL_HEIGHT);
            let end = min(chunk_count(), first + (1u << (height - SMALL_HEIGHT)));
            var least_bits = vec4<u32>(0xffffffffu);
            var most_bits = vec4<u32>(0u);
            for (var chunk = first + lane; chunk < end; chunk += LANES) {
                least_bits = min(least_bits, chunk_extents[chunk].lower);
                most_bits = max(most_bits, chunk_extents[chunk].upper);
            }
            for (var axis = 0u; axis < 4u; axis++) {
                atomicMin(&lower[axis], least_bits[axis]);
                atomicMax(&upper[axis], most_bits[axis]);
            }
        }
        workgroupBarrier();
        if lane == 0u {
            var axis = cycled_axis(node, height);
            if point_build.widest == 1u {
                let least_bits = vec4<u32>(
                    atomicLoad(&lower[0]),
                    atomicLoad(&lower[1]),
                    atomicLoad(&lower[2]),
                    atomicLoad(&lower[3]),
                );
                let most_bits = vec4<u32>(
                    atomicLoad(&upper[0]),
                    atomicLoad(&upper[1]),
                    atomicLoad(&upper[2]),
                    atomicLoad(&upper[3]),
                );
                axis = widest_axis(least_bits, most_bits);
            }
            let is_divided = middle_of(node, height) < block_count();
            let rank = select(0u, POINT_BLOCK << (height - 1u), is_divided);
            splits[node] = PointSplit(select(UNDIVIDED, axis, is_divided), 0u, rank, 0u);
        }
        workgroupBarrier();
    }
}

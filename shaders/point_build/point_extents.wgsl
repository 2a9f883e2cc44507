// Finds between which coordinates the points of each chunk lie, where axes are the widest.
// One workgroup a chunk.
// Reads: records.
// Writes: the least and the greatest coordinates of each chunk.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> records: array<PointRecord>;
@group(0) @binding(3) var<storage, read_write> chunk_extents: array<PointExtent>;

const SHARE: u32 = POINT_CHUNK / LANES;

var<workgroup> lower: array<atomic<u32>, 4>;
var<workgroup> upper: array<atomic<u32>, 4>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var chunk = workgroup.x; chunk < active_chunk_count(); chunk += workgroups.x) {
        if lane < 4u {
            atomicStore(&lower[lane], 0xffffffffu);
            atomicStore(&upper[lane], 0u);
        }
        workgroupBarrier();
        var least_bits = vec4<u32>(0xffffffffu);
        var most_bits = vec4<u32>(0u);
        for (var i = 0u; i < SHARE; i++) {
            let place = chunk * POINT_CHUNK + i * LANES + lane;
            if place < kept_count() {
                let record = records[place];
                let bits = vec4<u32>(record.x, record.y, record.z, record.w);
                least_bits = min(least_bits, bits);
                most_bits = max(most_bits, bits);
            }
        }
        for (var axis = 0u; axis < 4u; axis++) {
            atomicMin(&lower[axis], least_bits[axis]);
            atomicMax(&upper[axis], most_bits[axis]);
        }
        workgroupBarrier();
        if lane == 0u {
            chunk_extents[chunk] = PointExtent(
                vec4<u32>(
                    atomicLoad(&lower[0]),
                    atomicLoad(&lower[1]),
                    atomicLoad(&lower[2]),
                    atomicLoad(&lower[3]),
                ),
                vec4<u32>(
                    atomicLoad(&upper[0]),
                    atomicLoad(&upper[1]),
                    atomicLoad(&upper[2]),
                    atomicLoad(&upper[3]),
                ),
            );
        }
        workgroupBarrier();
    }
}

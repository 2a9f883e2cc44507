// Counts the points that are kept, and finds their greatest coordinate.
// One workgroup a chunk of the points given.
// Reads: their coordinates.
// Writes: for each chunk, how many are kept, and the bits of the greatest coordinate's size.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> input: array<u32>;
@group(0) @binding(3) var<storage, read_write> chunk_measures: array<vec2<u32>>;

const SHARE: u32 = POINT_CHUNK / LANES;

var<workgroup> kept: atomic<u32>;
var<workgroup> greatest: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var chunk = workgroup.x; chunk < counters[0]; chunk += workgroups.x) {
        if lane == 0u {
            atomicStore(&kept, 0u);
            atomicStore(&greatest, 0u);
        }
        workgroupBarrier();
        var own_kept = 0u;
        var own_greatest = 0u;
        for (var i = 0u; i < SHARE; i++) {
            let point = chunk * POINT_CHUNK + i * LANES + lane;
            if point < point_build.given {
                var all = true;
                var size = 0u;
                for (var axis = 0u; axis < point_build.dimensions; axis++) {
                    let bits = input[point * point_build.dimensions + axis];
                    all = all && is_finite(bits);
                    size = max(size, bits & 0x7fffffffu);
                }
                own_kept += select(0u, 1u, all);
                own_greatest = select(own_greatest, max(own_greatest, size), all);
            }
        }
        atomicAdd(&kept, own_kept);
        atomicMax(&greatest, own_greatest);
        workgroupBarrier();
        if lane == 0u {
            chunk_measures[chunk] = vec2<u32>(atomicLoad(&kept), atomicLoad(&greatest));
        }
        workgroupBarrier();
    }
}

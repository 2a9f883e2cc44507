// Counts the points of each chunk that are below their node's plane, and those on it.
// One workgroup a chunk.
// Reads: records; the planes.
// Writes: both numbers of each chunk.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> records: array<PointRecord>;
@group(0) @binding(3) var<storage, read> splits: array<PointSplit>;
@group(0) @binding(4) var<storage, read_write> chunk_sides: array<vec2<u32>>;

const SHARE: u32 = POINT_CHUNK / LANES;

var<workgroup> below: atomic<u32>;
var<workgroup> on_plane: atomic<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var chunk = workgroup.x; chunk < active_chunk_count(); chunk += workgroups.x) {
        if lane == 0u {
            atomicStore(&below, 0u);
            atomicStore(&on_plane, 0u);
        }
        workgroupBarrier();
        let split = splits[chunk >> (height_of_level() - SMALL_HEIGHT)];
        var own = vec2<u32>(0u);
        for (var i = 0u; i < SHARE; i++) {
            let place = chunk * POINT_CHUNK + i * LANES + lane;
            if place < kept_count() && split.axis != UNDIVIDED {
                let bits = bits_along(records[place], split.axis);
                own += vec2<u32>(select(0u, 1u, bits < split.bits), select(0u, 1u, bits == split.bits));
            }
        }
        atomicAdd(&below, own.x);
        atomicAdd(&on_plane, own.y);
        workgroupBarrier();
        if lane == 0u {
            chunk_sides[chunk] = vec2<u32>(atomicLoad(&below), atomicLoad(&on_plane));
        }
        workgroupBarrier();
    }
}

// Counts the points of each chunk whose coordinates begin with what is known of their node's plane, by the next eight bits.
// One workgroup a chunk.
// Reads: records; what is known of the planes.
// Writes: 256 numbers a chunk.
// Ties: none.

@group(0) @binding(0) var<uniform> point_build: PointBuild;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> records: array<PointRecord>;
@group(0) @binding(3) var<storage, read> splits: array<PointSplit>;
@group(0) @binding(4) var<storage, read_write> chunk_digits: array<u32>;

const SHARE: u32 = POINT_CHUNK / LANES;

var<workgroup> digits: array<atomic<u32>, 256>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var chunk = workgroup.x; chunk < active_chunk_count(); chunk += workgroups.x) {
        atomicStore(&digits[lane], 0u);
        workgroupBarrier();
        let split = splits[chunk >> (height_of_level() - SMALL_HEIGHT)];
        if split.axis != UNDIVIDED {
            for (var i = 0u; i < SHARE; i++) {
                let place = chunk * POINT_CHUNK + i * LANES + lane;
                if place < kept_count() {
                    let bits = bits_along(records[place], split.axis);
                    // All of what is known, nothing at first.
                    let differs = (bits ^ split.bits) & ~(0xffffffffu >> split.known);
                    if differs == 0u {
                        atomicAdd(&digits[(bits >> (24u - split.known)) & 0xffu], 1u);
                    }
                }
            }
        }
        workgroupBarrier();
        chunk_digits[chunk * LANES + lane] = atomicLoad(&digits[lane]);
        workgroupBarrier();
    }
}

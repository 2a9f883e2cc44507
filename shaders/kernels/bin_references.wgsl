// Counts by bins where the references of every chunk start and end.
// One workgroup a chunk, one invocation a reference.
// Reads: tight bounds of the chunk's node, references.
// Writes: how many of the chunk's references start and end in each bin of each axis.

@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(3) var<storage, read> node_bounds: array<f32>;
@group(0) @binding(4) var<storage, read> references: array<Reference>;
@group(0) @binding(5) var<storage, read_write> chunk_bins: array<u32>;

var<workgroup> axes: array<BinAxis, 3>;
// For each axis and bin: starts in the low half of a word, ends in the high half. Sums of whole numbers
// do not depend on order.
var<workgroup> bins: array<atomic<u32>, 3u * MAX_BINS>;

// Counts a reference on one axis. A flat axis has no borders: its bins stay empty.
fn count(axis: u32, lo: f32, hi: f32) {
    if !axes[axis].divisible {
        return;
    }
    let range = bin_range(axes[axis], lo, hi) + vec2<u32>(MAX_BINS * axis);
    if range.x == range.y {
        atomicAdd(&bins[range.x], 0x10001u);
    } else {
        atomicAdd(&bins[range.x], 1u);
        atomicAdd(&bins[range.y], 0x10000u);
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = parameters.zero;
    let end = slice_end(active_chunk_count());
    for (var index = parameters.first + group.x; index < end; index += groups.x) {
        let chunk = chunks[index];
        workgroupBarrier();
        if lane < 3u * MAX_BINS {
            atomicStore(&bins[lane], 0u);
        }
        if lane < 3u {
            let at = 6u * chunk.node + lane;
            axes[lane] = bins_between(node_bounds[at], node_bounds[at + 3u]);
        }
        workgroupBarrier();
        if lane < chunk.count {
            let reference = references[chunk.first + lane];
            count(0u, reference.lo.x, reference.hi.x);
            count(1u, reference.lo.y, reference.hi.y);
            count(2u, reference.lo.z, reference.hi.z);
        }
        workgroupBarrier();
        if lane < 3u * MAX_BINS {
            chunk_bins[3u * MAX_BINS * index + lane] = atomicLoad(&bins[lane]);
        }
    }
}

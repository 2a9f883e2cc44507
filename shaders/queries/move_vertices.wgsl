// Every vertex moved by the transform of its group; twin of core/src/scene/moved.rs.
// One invocation a vertex.
// Reads: positions at rest, the group of each, three rows of a transform a group; how many vertices there are.
// Writes: positions.
// The host has checked that all numbers are finite, that no sum is beyond 2^126, and that each group has a transform.

struct VertexCount {
    count: u32,
    zero: u32,
}

// Three numbers a vertex.
@group(0) @binding(0) var<storage, read> rest_positions: array<f32>;
@group(0) @binding(1) var<storage, read> vertex_groups: array<u32>;
@group(0) @binding(2) var<storage, read> transforms: array<vec4<f32>>;
@group(0) @binding(3) var<uniform> vertex_count: VertexCount;
@group(0) @binding(4) var<storage, read_write> positions: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = vertex_count.zero;
    // In rows, since one dimension may be too short.
    let vertex = (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
    if vertex >= vertex_count.count {
        return;
    }
    let x = snap(rest_positions[3u * vertex]);
    let y = snap(rest_positions[3u * vertex + 1u]);
    let z = snap(rest_positions[3u * vertex + 2u]);
    let first = 3u * vertex_groups[vertex];
    for (var row = 0u; row < 3u; row++) {
        let m = transforms[first + row];
        let two = snapped_sum(snapped_product(m.x, x), snapped_product(m.y, y));
        positions[3u * vertex + row] = snapped_sum(snapped_sum(two, snapped_product(m.z, z)), m.w);
    }
}

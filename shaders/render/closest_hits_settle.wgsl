// What follows `closest_hits` and its retry where hits are exact: the records of all hits, as exact arithmetic rounds them.
// One invocation a path, in workgroups of TRACED.
// Reads: rays and hits; corners.
// Writes: the records that are certain; those of all other rays, and of rays that are undecided, in any order, for the CPU.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> counters: array<u32, 16>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<u32>>;
// 16 bytes a hit. As bits, since the `t` of a miss is infinite.
@group(0) @binding(3) var<storage, read_write> hits: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read> nodes: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> leaf_references: array<u32>;
@group(0) @binding(6) var<storage, read> triangles: array<f32>;
@group(0) @binding(7) var<uniform> scene: Scene;
@group(0) @binding(8) var<storage, read_write> deferred_rays: array<atomic<u32>>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    opaque_zero = frame.zero;
    let count = counters[COUNTER_PATHS];
    let index = group.x * TRACED + lane;
    if index >= count {
        return;
    }
    let found = hits[index].y;
    if found >= UNSETTLED && found != UNDECIDED_HIT {
        return;
    }
    let first = rays[2u * index];
    let second = rays[2u * index + 1u];
    if found == UNDECIDED_HIT {
        leave_undecided(UNDECIDED_PATHS, index, NO_TRIANGLE, first, second, vec3<f32>());
        return;
    }
    let record = certain_record(ray_of_words(first, second), corners_of(found), found);
    if record.triangle == UNDECIDED_HIT {
        leave_undecided(UNDECIDED_PATHS, index, found, first, second, vec3<f32>());
        return;
    }
    hits[index] = hit_words(record);
}

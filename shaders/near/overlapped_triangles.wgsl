// The triangles that each volume of a batch may meet, and which of them it certainly does.
// One invocation a volume.
// Reads: the tree and its triangles; the volumes and their half-spaces.
// Writes: how many triangles, or a mark; those for which there is room, some of them more than once.
// Ties: the host decides where touching does.

@group(0) @binding(6) var<storage, read_write> found: array<u32>;

// In place of the number of triangles: one is certainly met, and is enough.
const NEAR_BATCH_MET: u32 = 0xfffffffdu;
// The bit of a triangle that is certainly met.
const NEAR_BATCH_CERTAIN: u32 = 0x80000000u;

var<private> own_first: u32;
var<private> own_count: u32;

// Coordinates are compared as they are, so this is exact.
fn is_in_box(corner: vec3<f32>) -> bool {
    return all(corner >= own.lo) && all(corner <= own.hi);
}

fn visit_cell_triangle(triangle: u32) {
    if triangle == near_batch.ignore {
        return;
    }
    let corners = corners_of(triangle);
    let least_corner = least3(least3(corners.a, corners.b), corners.c);
    let most_corner = most3(most3(corners.a, corners.b), corners.c);
    if any(least_corner > own.hi) || any(most_corner < own.lo) {
        return;
    }
    var is_certain = false;
    if own.kind == NEAR_BATCH_KIND_BOX {
        is_certain = is_in_box(corners.a) || is_in_box(corners.b) || is_in_box(corners.c);
    } else {
        let seen = Triangle(
            seen_from_volume(corners.a),
            seen_from_volume(corners.b),
            seen_from_volume(corners.c),
        );
        if own.kind == NEAR_BATCH_KIND_BALL {
            let range = distance_range(seen);
            if range.x > own.radius {
                return;
            }
            is_certain = range.y <= own.radius;
        }
        var is_inside = vec3<bool>(true);
        for (var at = own.first_plane; at < own.last_plane; at++) {
            let plane = half_spaces[at];
            let sides = vec3<f32>(beyond(plane, seen.a), beyond(plane, seen.b), beyond(plane, seen.c));
            if all(sides > vec3<f32>(NEAR_BATCH_SLACK)) {
                return;
            }
            is_inside = is_inside & (sides < vec3<f32>(-NEAR_BATCH_SLACK));
        }
        if own.kind == NEAR_BATCH_KIND_PLANES {
            is_certain = any(is_inside);
        }
    }
    is_over = is_certain && near_batch.any == 1u;
    if own_count + 1u < near_batch.room {
        found[own_first + 1u + own_count] = triangle | select(0u, NEAR_BATCH_CERTAIN, is_certain);
    }
    own_count += 1u;
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    opaque_zero = near_batch.zero;
    let index = query_index(workgroup, workgroups, local);
    if index >= near_batch.count {
        return;
    }
    own = volume_of(index);
    own_first = index * near_batch.room;
    own_count = 0u;
    var walked = NEAR_BATCH_OVERFULL;
    if own.kind != NEAR_BATCH_KIND_NONE {
        walked = walk_volume();
    }
    if walked == WALKED {
        walked = select(own_count, NEAR_BATCH_MET, is_over);
    }
    found[own_first] = walked;
}

// The triangles of which one is the closest to each point of a batch, by bounds of their distances.
// One invocation a point.
// Reads: the tree and its triangles; the points, each with its unit and how far away triangles count.
// Writes: how many triangles, or a mark; the distance within which no others are; the triangles, in no order.
// Ties: the host decides; all that may be closest are listed.

// A point with its unit, then how far away triangles count, in that unit; nothing is asked of one that is below 0.
@group(0) @binding(4) var<storage, read> near_points: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> found: array<u32>;

// Triangles that are kept.
const NEAR_BATCH_CLOSEST: u32 = 14u;

// Index and least distance of each.
var<private> kept: array<vec2<u32>, NEAR_BATCH_CLOSEST>;
var<private> kept_count: u32;
// Triangles beyond this are not closest.
var<private> cut: f32;
// The least distance of any triangle that was left out.
var<private> least_lost: f32;
var<private> own_point: vec4<f32>;

// Leaves out what is beyond the cut.
fn purge() {
    var count = 0u;
    for (var at = 0u; at < kept_count; at++) {
        let entry = kept[at];
        if bitcast<f32>(entry.y) <= cut {
            kept[count] = entry;
            count += 1u;
        }
    }
    kept_count = count;
}

fn visit_near(triangle: u32) {
    if triangle == near_batch.ignore {
        return;
    }
    let range = distance_range(corners_from(own_point.xyz, own_point.w, triangle));
    if range.x > cut {
        return;
    }
    if range.y < cut {
        cut = range.y;
        stop = product(product(cut, cut), SQUARE_SLACK);
    }
    // A triangle of several leaves comes several times.
    for (var at = 0u; at < kept_count; at++) {
        if kept[at].x == triangle {
            return;
        }
    }
    if kept_count == NEAR_BATCH_CLOSEST {
        purge();
    }
    if kept_count == NEAR_BATCH_CLOSEST {
        least_lost = least(least_lost, range.x);
        return;
    }
    kept[kept_count] = vec2<u32>(triangle, bitcast<u32>(range.x));
    kept_count += 1u;
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
    own_point = near_points[2u * index];
    cut = near_points[2u * index + 1u].x;
    stop = product(product(cut, cut), SQUARE_SLACK);
    kept_count = 0u;
    least_lost = GREATEST;
    var walked = WALKED;
    if cut >= 0.0 {
        walked = walk_near(own_point.xyz, own_point.w);
    }
    purge();
    let first = index * near_batch.room;
    found[first] = select(NEAR_BATCH_OVERFULL, kept_count, least_lost > cut);
    if walked != WALKED {
        found[first] = walked;
    }
    found[first + 1u] = bitcast<u32>(cut);
    for (var at = 0u; at < kept_count; at++) {
        found[first + 2u + at] = kept[at].x;
    }
}

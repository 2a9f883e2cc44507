// The walk of a volume through the cells of a tree. The volume lies within a box and some half-spaces, or is a ball in a box.
//
// What is done with triangles stands in another part: the function `visit_cell_triangle`, which may set `is_over`.

const NEAR_BATCH_VOLUME_ROWS: u32 = 4u;
const NEAR_BATCH_KIND_BOX: u32 = 0u;
const NEAR_BATCH_KIND_BALL: u32 = 1u;
const NEAR_BATCH_KIND_PLANES: u32 = 2u;
const NEAR_BATCH_KIND_NONE: u32 = 4u;

@group(0) @binding(4) var<storage, read> volumes: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> half_spaces: array<vec4<f32>>;

struct Volume {
    origin: vec3<f32>,
    unit: f32,
    lo: vec3<f32>,
    // Of a ball, in the unit.
    radius: f32,
    hi: vec3<f32>,
    kind: u32,
    first_plane: u32,
    last_plane: u32,
}

// Subtrees that wait; a volume that leaves more of them is left to the host.
const NEAR_ENTRIES: u32 = 64u;

// A subtree's cell, and its node.
var<private> lower_stack: array<vec4<u32>, NEAR_ENTRIES>;
var<private> upper_stack: array<vec3<f32>, NEAR_ENTRIES>;
var<private> own: Volume;
// Whether nothing more is to be found out.
var<private> is_over: bool;

fn volume_of(index: u32) -> Volume {
    let first = index * NEAR_BATCH_VOLUME_ROWS;
    let origin = bitcast<vec4<f32>>(volumes[first]);
    let lower = bitcast<vec4<f32>>(volumes[first + 1u]);
    let upper = volumes[first + 2u];
    let planes = volumes[first + 3u];
    return Volume(
        origin.xyz,
        origin.w,
        lower.xyz,
        lower.w,
        bitcast<vec3<f32>>(upper.xyz),
        upper.w,
        planes.x,
        planes.x + planes.y,
    );
}

// A place as seen from the volume's origin, in its unit.
fn seen_from_volume(place: vec3<f32>) -> vec3<f32> {
    return scaled3(difference3(place, own.origin), own.unit);
}

// How far a place is outside a half-space, by its normal; below 0 inside.
fn beyond(plane: vec4<f32>, seen: vec3<f32>) -> f32 {
    return difference(dot3(plane.xyz, seen), plane.w);
}

// False where the volume certainly has no point in a cell.
fn may_meet_cell(lo: vec3<f32>, hi: vec3<f32>) -> bool {
    if any(lo > own.hi) || any(hi < own.lo) {
        return false;
    }
    if own.kind == NEAR_BATCH_KIND_BOX {
        return true;
    }
    let below = seen_from_volume(lo);
    let above = seen_from_volume(hi);
    if own.kind == NEAR_BATCH_KIND_BALL {
        let gaps = most3(most3(below, -above), vec3<f32>(0.0));
        let reach = sum(own.radius, NEAR_BATCH_SLACK);
        return dot3(gaps, gaps) <= product(product(reach, reach), SQUARE_SLACK);
    }
    for (var at = own.first_plane; at < own.last_plane; at++) {
        let plane = half_spaces[at];
        let deepest = select(above, below, plane.xyz > vec3<f32>(0.0));
        if beyond(plane, deepest) > NEAR_BATCH_SLACK {
            return false;
        }
    }
    return true;
}

// Visits the triangles of all cells that the volume may meet. Returns WALKED or a mark.
fn walk_volume() -> u32 {
    var lo = near_batch.lower;
    var hi = near_batch.upper;
    var node = 0u;
    var top = 0u;
    // What is left of the leaf that the walk is in.
    var at = 0u;
    var end = 0u;
    is_over = false;
    // One loop for nodes, triangles and stack: drivers that run invocations in step count the rounds of inner loops even for those that are in
    // none.
    loop {
        if node != NO_NODE {
            let here = node;
            node = NO_NODE;
            if may_meet_cell(lo, hi) {
                let words = nodes[here];
                let tag = words.y & 3u;
                let payload = words.y >> 2u;
                if tag != 3u {
                    if top == NEAR_ENTRIES {
                        return NEAR_BATCH_OVERFULL;
                    }
                    let plane = bitcast<f32>(words.x);
                    lower_stack[top] = vec4<u32>(bitcast<vec3<u32>>(with_axis(lo, tag, plane)), payload);
                    upper_stack[top] = hi;
                    top += 1u;
                    hi = with_axis(hi, tag, plane);
                    node = here + 1u;
                    continue;
                }
                at = words.x;
                end = at + payload;
            }
        }
        if at < end {
            visit_cell_triangle(leaf_references[at]);
            at += 1u;
            if is_over {
                return select(NEAR_BATCH_ENDED_EARLY, WALKED, loops_run());
            }
        }
        if at < end {
            continue;
        }
        if top == 0u {
            break;
        }
        top -= 1u;
        let entry = lower_stack[top];
        lo = bitcast<vec3<f32>>(entry.xyz);
        hi = upper_stack[top];
        node = entry.w;
    }
    let done = (top ^ opaque_zero) == 0u && (at ^ opaque_zero) >= end && loops_run();
    return select(NEAR_BATCH_ENDED_EARLY, WALKED, done);
}

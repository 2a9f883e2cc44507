// The walk of a query for closest points: the side of each plane first on which the query lies.
//
// What is done with triangles stands in another part: the function `visit_near`, which may lower `stop`.

// Subtrees that wait; a query that leaves more of them is left to the host.
const NEAR_ENTRIES: u32 = 64u;

// A subtree, and how far its cell is along each axis, at least.
var<private> near_stack: array<vec4<u32>, NEAR_ENTRIES>;
// Cells whose squared distance is greater do not count.
var<private> stop: f32;

// How far the box of the scene is from a point along each axis, in a unit.
fn gaps_to_scene(point: vec3<f32>, unit: f32) -> vec3<f32> {
    let below = difference3(near_batch.lower, point);
    let above = difference3(point, near_batch.upper);
    return scaled3(most3(most3(below, above), vec3<f32>(0.0)), unit);
}

// Visits the triangles of all cells that count. Returns WALKED or a mark.
fn walk_near(point: vec3<f32>, unit: f32) -> u32 {
    var gaps = gaps_to_scene(point, unit);
    if dot3(gaps, gaps) > stop {
        return WALKED;
    }
    var node = 0u;
    var top = 0u;
    // What is left of the leaf that the walk is in.
    var at = 0u;
    var end = 0u;
    // One loop for nodes, triangles and stack: drivers that run invocations in step count the rounds of inner loops even for those that are in
    // none.
    loop {
        if node != NO_NODE {
            let words = nodes[node];
            let tag = words.y & 3u;
            let payload = words.y >> 2u;
            if tag != 3u {
                let own = on_axis(point, tag);
                let plane = bitcast<f32>(words.x);
                let is_below = own < plane;
                let gap = product(abs(difference(plane, own)), unit);
                let far = with_axis(gaps, tag, most(gap, on_axis(gaps, tag)));
                if dot3(far, far) <= stop {
                    if top == NEAR_ENTRIES {
                        return NEAR_BATCH_OVERFULL;
                    }
                    let other = select(node + 1u, payload, is_below);
                    near_stack[top] = vec4<u32>(bitcast<vec3<u32>>(far), other);
                    top += 1u;
                }
                node = select(payload, node + 1u, is_below);
                continue;
            }
            at = words.x;
            end = at + payload;
            node = NO_NODE;
        }
        if at < end {
            visit_near(leaf_references[at]);
            at += 1u;
        }
        if at < end {
            continue;
        }
        if top == 0u {
            break;
        }
        top -= 1u;
        let entry = near_stack[top];
        let nearest = bitcast<vec3<f32>>(entry.xyz);
        if dot3(nearest, nearest) <= stop {
            node = entry.w;
            gaps = nearest;
        }
    }
    let done = (top ^ opaque_zero) == 0u && (at ^ opaque_zero) >= end && loops_run();
    return select(NEAR_BATCH_ENDED_EARLY, WALKED, done);
}

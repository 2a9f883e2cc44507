// Twin of core/src/query/intersect/watertight.rs: a triangle is met where the ray meets its closed image, by exact
// signs, and `t` never leaves the image by more than rounding. Ray and triangle alone decide, bit for bit.
//
// What few triangles need stands in any_triangle.wgsl, or, for a shader that leaves these to another, in
// plain_triangle.wgsl.

// The error of an interpolated `t` is at most this part of `disorder / |det|`.
const INTERPOLATION_ERROR: f32 = 0x1p-17f;
// Determinants from here on are known.
const DET_LEAST: f32 = 0x1p-74f;
// Sums of products of edge functions and depths from here on, times 8, are known.
const SUM_LEAST: f32 = 0x1p-90f;
// A `t` from a closer look counts as 0 below this.
const T_LEAST: f32 = 0x1p-64f;
// Images with less area than this, per square of the greatest sheared coordinate, are looked at more closely.
const SLIVER: f32 = 0x1p-8f;

// An edge function: twice the signed area of the origin and two sheared corners.
fn edge_function(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return difference(product(a.x, b.y), product(a.y, b.x));
}

// Edge functions opposite the first, second and third corner, not yet as they count: see `rounded_edges`.
fn edge_functions(seen: Sheared) -> vec3<f32> {
    return vec3<f32>(
        edge_function(seen.c, seen.b),
        edge_function(seen.a, seen.c),
        edge_function(seen.b, seen.a),
    );
}

// Edge functions as they count: those below EDGE_LEAST are zero.
fn rounded_edges(edges: vec3<f32>) -> vec3<f32> {
    return select(edges, vec3<f32>(), abs(edges) < vec3<f32>(EDGE_LEAST));
}

// What `side_met` says when rounded edge functions leave it open.
const SIDE_OPEN: i32 = 2;

// 1 where the image's front is met, -1 where its back is, 0 where neither. By the least and the greatest edge function, rounded or not:
// an H100 does comparisons at half the rate of products, and this gives it 3 to 5 % more rays than to compare each with zero.
//
// Rounded, an edge function is negative from -EDGE_LEAST down, positive from EDGE_LEAST up, and zero between. One is negative where the
// least is, and one positive where the greatest is. None is zero or of the other sign where the least is positive or the greatest negative.
// What is no number says nothing, so it leaves the side open.
fn side_met(edges: vec3<f32>) -> i32 {
    let lowest = min(min(edges.x, edges.y), edges.z);
    let highest = max(max(edges.x, edges.y), edges.z);
    if lowest <= -EDGE_LEAST && highest >= EDGE_LEAST {
        return 0;
    }
    let front = lowest >= EDGE_LEAST;
    if front || highest <= -EDGE_LEAST {
        return select(-1, 1, front);
    }
    // An edge function counts as zero, and the others are of one sign at most.
    return SIDE_OPEN;
}

fn is_culled(side: i32, culling: u32) -> bool {
    return (culling == CULL_BACK && side < 0) || (culling == CULL_FRONT && side > 0);
}

// A triangle as seen from the origin, of a scene that is not wide.
fn sheared(ray: PreparedRay, triangle: u32) -> Sheared {
    var seen: Sheared;
    let axes = axes_of(ray);
    let corners = corners_along(triangle, axes);
    let origin = along(axes, ray.origin);
    seen.away_a = distance3(corners.a, origin);
    seen.away_b = distance3(corners.b, origin);
    seen.away_c = distance3(corners.c, origin);
    seen.a = shear_corner(seen.away_a, ray.shear);
    seen.b = shear_corner(seen.away_b, ray.shear);
    seen.c = shear_corner(seen.away_c, ray.shear);
    return seen;
}

// Where a triangle is met, once it is known to be; open where interpolation does not serve. What is certainly beyond `stop`, which is at least
// 2^-13 of itself behind the best hit so far, may be left out: it cannot come before that.
fn finish_test(
    ray: PreparedRay,
    origin: vec3<f32>,
    index: u32,
    seen: Sheared,
    edges: vec3<f32>,
    t_min: f32,
    t_max: f32,
    stop: f32,
) -> Candidate {
    let sz = ray.shear.z;
    let depths = vec3<f32>(
        product(sz, seen.away_a.z),
        product(sz, seen.away_b.z),
        product(sz, seen.away_c.z),
    );
    let nearest = least_of(depths);
    let farthest = most_of(depths);
    if farthest < t_min || nearest > t_max {
        return no_candidate();
    }
    let det = sum(sum(edges.x, edges.y), edges.z);
    let total = sum(
        sum(product(edges.x, depths.x), product(edges.y, depths.y)),
        product(edges.z, depths.z),
    );
    let width = width_of(seen);
    let spread = difference(farthest, nearest);
    let fat = most(product(product(width, width), SLIVER), DET_LEAST);
    let eightfold = product(8.0, abs(total));
    // Disorder is the reach times the width times the spread. Nearly always a bound that takes no corners says enough.
    let is_fat = abs(det) >= fat;
    let loose = free_mul(free_mul(loose_reach(seen, width), width), spread);
    var interpolates = is_fat && most(loose, SUM_LEAST) <= eightfold;
    var disorder = 0.0;
    if !interpolates {
        disorder = product(product(reach_again(origin, index, seen), width), spread);
        interpolates = is_fat && most(disorder, SUM_LEAST) <= eightfold;
    }
    var hit = Candidate(true, false, 0.0, vec3<f32>(edges.y, edges.z, det));
    if interpolates {
        if free_mul(total, free_reciprocal(det)) > stop {
            return no_candidate();
        }
        hit.t = quotient(total, det);
    } else {
        var lower = nearest;
        var upper = farthest;
        if abs(det) >= DET_LEAST && disorder > SUM_LEAST {
            let interpolated = quotient(total, det);
            let part = quotient(disorder, abs(det));
            // An error beyond any float lets nothing go.
            if exponent(part) < 128 {
                let error = product(part, INTERPOLATION_ERROR);
                // Most such triangles are the one that the ray starts on; they need no closer look.
                let beyond = sum(interpolated, error) < t_min || difference(interpolated, error) > t_max;
                if disorder > eightfold && beyond {
                    return no_candidate();
                }
                // The bound holds for a determinant of any size (docs/design/gpu.md). Twice as wide, to be safe.
                lower = most(lower, difference(interpolated, product(2.0, error)));
                upper = least(upper, sum(interpolated, product(2.0, error)));
            }
        }
        return open_between(lower, upper);
    }
    hit.t = least(most(hit.t, nearest), farthest);
    if hit.t < t_min || hit.t > t_max {
        return no_candidate();
    }
    return hit;
}

// u and v. Snapped, since devices may ignore the sign of zero.
fn weights_over(weights: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(snap(quotient(weights.x, weights.z)), snap(quotient(weights.y, weights.z)));
}

// The greatest distance of a corner on any axis. Here `max` is `most`: no value is negative.
fn reach_of(seen: Sheared) -> f32 {
    let most_away = max(max(abs(seen.away_a), abs(seen.away_b)), abs(seen.away_c));
    return max(max(most_away.x, most_away.y), most_away.z);
}

// Not less than `reach_of`, and at most a little more than three times that: slopes are at most 1, so a corner is no farther off across the ray than
// its image and its distance along the ray together.
fn loose_reach(seen: Sheared, width: f32) -> f32 {
    let deepest = max(max(abs(seen.away_a.z), abs(seen.away_b.z)), abs(seen.away_c.z));
    return free_mul(0x1.004p+0f, free_mul_add(1.0, width, deepest));
}

fn distance3(p: vec3<f32>, q: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(difference(p.x, q.x), difference(p.y, q.y), difference(p.z, q.z));
}

// The greatest sheared coordinate.
fn width_of(seen: Sheared) -> f32 {
    let widest = max(max(abs(seen.a), abs(seen.b)), abs(seen.c));
    return max(widest.x, widest.y);
}

// The watertight test: where the ray meets the triangle within its limits; open where that takes a closer look.
fn watertight(ray: PreparedRay, index: u32, culling: u32, stop: f32) -> Candidate {
    if ray.wide {
        return open_candidate();
    }
    let seen = sheared(ray, index);
    let edges = edge_functions(seen);
    let side = side_met(edges);
    if side == SIDE_OPEN {
        return open_candidate();
    }
    if side == 0 || is_culled(side, culling) {
        return no_candidate();
    }
    let limits = inner_limits(ray);
    return finish_test(ray, ray.origin, index, seen, edges, limits.x, limits.y, stop);
}

// The triangle test of this shader.
fn test_triangle(ray: PreparedRay, triangle: u32, culling: u32, stop: f32) -> Candidate {
    return watertight(ray, triangle, culling, stop);
}

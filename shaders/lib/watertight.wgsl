// Twin of core/src/intersect.rs: the watertight ray/triangle test of Woop, Benthin and Wald 2013 in
// guarded arithmetic, and the rule for `t`. Ray and triangle alone decide, bit for bit.

// Edge functions below this are zero, which is inside: smaller ones could depend on flushing.
const EDGE_LEAST: f32 = 0x1p-98f;
// The error of an interpolated `t` is at most this part of `disorder / |det|`.
const INTERPOLATION_ERROR: f32 = 0x1p-17f;
// Products of doubles err by less than this part of their factors.
const DOUBLE_NOISE: f32 = 0x1p-40f;

// A triangle as seen from the origin: corners less origin in sheared axis order, and their images.
struct Sheared {
    away_a: vec3<f32>,
    away_b: vec3<f32>,
    away_c: vec3<f32>,
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

// An edge function: twice the signed area of the origin and two sheared corners.
fn edge_function(a: vec2<f32>, b: vec2<f32>) -> f32 {
    let value = difference(product(a.x, b.y), product(a.y, b.x));
    return select(value, 0.0, abs(value) < EDGE_LEAST);
}

// A corner less the origin, in the order of the sheared axes.
fn corner_away(axes: vec3<u32>, corner: vec3<f32>, origin: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        difference(on_axis(corner, axes.x), on_axis(origin, axes.x)),
        difference(on_axis(corner, axes.y), on_axis(origin, axes.y)),
        difference(on_axis(corner, axes.z), on_axis(origin, axes.z)),
    );
}

// The image of a corner in the plane across the ray.
fn shear_corner(away: vec3<f32>, shear: vec3<f32>) -> vec2<f32> {
    return vec2<f32>(
        difference(away.x, product(shear.x, away.z)),
        difference(away.y, product(shear.y, away.z)),
    );
}

// The greatest distance to a corner on any axis, times a factor.
fn scaled_reach(corner: vec3<f32>, origin: vec3<f32>, factor: f32) -> f32 {
    return most_of(abs(vec3<f32>(
        difference(product(corner.x, factor), product(origin.x, factor)),
        difference(product(corner.y, factor), product(origin.y, factor)),
        difference(product(corner.z, factor), product(origin.z, factor)),
    )));
}

// The watertight test: where the ray meets the triangle within its limits.
fn watertight(ray: PreparedRay, triangle: Triangle, culling: u32) -> Candidate {
    if !ray.wide {
        return sheared_test(ray, ray.origin, triangle, ray.t_min, ray.t_max, culling);
    }
    // Scaled by a power of two, which is exact, so that the largest distance is near 1. Small
    // numbers are not halved but raised by 2^29, since devices may flush what halving makes
    // subnormal; `lift` is what that adds to the exponent.
    let greatest = most(
        most(most_of(abs(triangle.a)), most_of(abs(triangle.b))),
        most(most_of(abs(triangle.c)), most_of(abs(ray.origin))),
    );
    let small = greatest < 0x1p+90f;
    let factor = select(0.5, 0x1p+29f, small);
    let lift = select(0, 30, small);
    var largest = scaled_reach(triangle.a, ray.origin, factor);
    largest = most(largest, scaled_reach(triangle.b, ray.origin, factor));
    largest = most(largest, scaled_reach(triangle.c, ray.origin, factor));
    if exponent(largest) - lift < -126 {
        return no_candidate();
    }
    let power = lift - exponent(largest);
    let origin = scale3(ray.origin, power);
    let scaled = Triangle(
        scale3(triangle.a, power),
        scale3(triangle.b, power),
        scale3(triangle.c, power),
    );
    // Scaling back may underflow or clamp: what is reported is held to the limits later.
    var hit = sheared_test(ray, origin, scaled, -GREATEST, GREATEST, culling);
    hit.t = scale(hit.t, -power);
    // Held to the inner limits as well, like that of the plain test: scaled to the caller's units, a
    // `t` before the ray's start may become 0, and whether its leaf is visited is a matter of luck.
    if hit.t < ray.t_min || hit.t > ray.t_max {
        return no_candidate();
    }
    return hit;
}

fn sheared_test(
    ray: PreparedRay,
    origin: vec3<f32>,
    triangle: Triangle,
    t_min: f32,
    t_max: f32,
    culling: u32,
) -> Candidate {
    var seen: Sheared;
    seen.away_a = corner_away(ray.axes, triangle.a, origin);
    seen.away_b = corner_away(ray.axes, triangle.b, origin);
    seen.away_c = corner_away(ray.axes, triangle.c, origin);
    seen.a = shear_corner(seen.away_a, ray.shear);
    seen.b = shear_corner(seen.away_b, ray.shear);
    seen.c = shear_corner(seen.away_c, ray.shear);
    let u = edge_function(seen.c, seen.b);
    let v = edge_function(seen.a, seen.c);
    let w = edge_function(seen.b, seen.a);
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return no_candidate();
    }
    return finish_test(ray, origin, triangle, seen, vec3<f32>(u, v, w), t_min, t_max, culling);
}

// False when the point (0, 0) is outside the interval of three numbers.
fn spans_zero(a: f32, b: f32, c: f32) -> bool {
    return least(least(a, b), c) <= 0.0 && most(most(a, b), c) >= 0.0;
}

// The rest of the watertight test, for the few triangles whose edges enclose the ray.
fn finish_test(
    ray: PreparedRay,
    origin: vec3<f32>,
    triangle: Triangle,
    seen: Sheared,
    edges: vec3<f32>,
    t_min: f32,
    t_max: f32,
    culling: u32,
) -> Candidate {
    // For a sliver met beside its end all three edge functions may round to zero: the ray must also
    // be within the bounds of the sheared corners. This loses nothing, since it is exact.
    if !spans_zero(seen.a.x, seen.b.x, seen.c.x) || !spans_zero(seen.a.y, seen.b.y, seen.c.y) {
        return no_candidate();
    }
    let det = sum(sum(edges.x, edges.y), edges.z);
    let culled = (culling == CULL_BACK && det < 0.0) || (culling == CULL_FRONT && det > 0.0);
    if det == 0.0 || culled {
        return no_candidate();
    }
    // The hit lies between the nearest and the farthest corner, whatever rounding says.
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
    let total = sum(
        sum(product(edges.x, depths.x), product(edges.y, depths.y)),
        product(edges.z, depths.z),
    );
    let interpolated = quotient(total, det);
    let noise = disorder(seen, difference(farthest, nearest));
    var t = interpolated;
    if noise > product(8.0, abs(total)) {
        // Most such triangles are the one that the ray starts on; they need no closer look.
        let part = quotient(noise, abs(det));
        // An error beyond any float lets nothing go.
        if exponent(part) < 128 {
            let error = product(part, INTERPOLATION_ERROR);
            if sum(interpolated, error) < t_min || difference(interpolated, error) > t_max {
                return no_candidate();
            }
        }
        let plane = distance_to_plane(origin, ray.direction, triangle);
        if plane.some {
            t = plane.t;
        } else {
            t = depth_on_longest_edge(seen, depths);
        }
    }
    t = least(most(t, nearest), farthest);
    if t < t_min || t > t_max {
        return no_candidate();
    }
    // Snapped, since devices may ignore the sign of zero.
    return Candidate(true, t, snap(quotient(edges.y, det)), snap(quotient(edges.z, det)));
}

// How badly `t` interpolated from the corners may err, times the determinant and 2^24 / 24.
fn disorder(seen: Sheared, spread: f32) -> f32 {
    let reach =
        most(most(most_of(abs(seen.away_a)), most_of(abs(seen.away_b))), most_of(abs(seen.away_c)));
    let a = abs(seen.a);
    let b = abs(seen.b);
    let c = abs(seen.c);
    let width = most(most(most(a.x, a.y), most(b.x, b.y)), most(c.x, c.y));
    return product(product(reach, width), spread);
}

// A vector of doubles.
struct Double3 {
    x: Double,
    y: Double,
    z: Double,
}

// p - q without error.
fn double3_difference_of(p: vec3<f32>, q: vec3<f32>) -> Double3 {
    return Double3(
        double_difference_of(p.x, q.x),
        double_difference_of(p.y, q.y),
        double_difference_of(p.z, q.z),
    );
}

// p_i q_j - p_j q_i: one component of a cross product.
fn double_minor(p_i: Double, p_j: Double, q_i: Double, q_j: Double) -> Double {
    return double_minus(double_times(p_i, q_j), double_times(p_j, q_i));
}

// The scalar product, rounded.
fn double3_dot(p: Double3, q: Double3) -> f32 {
    let xy = double_plus(double_times(p.x, q.x), double_times(p.y, q.y));
    return double_plus(xy, double_times(p.z, q.z)).high;
}

// The largest component.
fn double3_length(p: Double3) -> f32 {
    return most_of(abs(vec3<f32>(p.x.high, p.y.high, p.z.high)));
}

// An inner `t`, if there is one.
struct PlaneDistance {
    some: bool,
    t: f32,
}

// `t` of the triangle's plane, from differences without error and products of about 46 bits; none
// for a triangle without a plane or a ray within it.
fn distance_to_plane(
    origin: vec3<f32>,
    direction: vec3<f32>,
    triangle: Triangle,
) -> PlaneDistance {
    let ab = double3_difference_of(triangle.b, triangle.a);
    let ac = double3_difference_of(triangle.c, triangle.a);
    let oa = double3_difference_of(triangle.a, origin);
    let normal = Double3(
        double_minor(ab.y, ab.z, ac.y, ac.z),
        double_minor(ab.z, ab.x, ac.z, ac.x),
        double_minor(ab.x, ab.y, ac.x, ac.y),
    );
    let way = Double3(Double(direction.x, 0.0), Double(direction.y, 0.0), Double(direction.z, 0.0));
    let distance = double3_dot(normal, oa);
    let speed = double3_dot(normal, way);
    // Below this the normal is what rounding left: the triangle is a sliver or seen edge on.
    let noise = product(product(double3_length(ab), double3_length(ac)), DOUBLE_NOISE);
    if abs(speed) <= most(noise, LEAST_NORMAL) {
        return PlaneDistance(false, 0.0);
    }
    let t = quotient(distance, speed);
    return PlaneDistance(exponent(t) < 128, t);
}

// The longest edge so far, and the depth on it.
struct LongestEdge {
    squared: f32,
    depth: f32,
}

// The scalar product of an edge and a point.
fn along_edge(edge: vec2<f32>, point: vec2<f32>) -> f32 {
    return sum(product(edge.x, point.x), product(edge.y, point.y));
}

fn longer_edge(
    best: LongestEdge,
    p: vec2<f32>,
    q: vec2<f32>,
    p_depth: f32,
    q_depth: f32,
) -> LongestEdge {
    let edge = vec2<f32>(difference(q.x, p.x), difference(q.y, p.y));
    // Snapped, since devices may flush it.
    let squared = snap(along_edge(edge, edge));
    if squared > best.squared {
        let along = least(most(quotient(-along_edge(edge, p), squared), 0.0), 1.0);
        let depth = product(along, difference(q_depth, p_depth));
        return LongestEdge(squared, sum(p_depth, depth));
    }
    return best;
}

// `t` for a triangle too thin to have a plane: where its longest edge, as the ray sees it, passes
// the ray.
fn depth_on_longest_edge(seen: Sheared, depths: vec3<f32>) -> f32 {
    var best = LongestEdge(0.0, depths.x);
    best = longer_edge(best, seen.a, seen.b, depths.x, depths.y);
    best = longer_edge(best, seen.b, seen.c, depths.y, depths.z);
    best = longer_edge(best, seen.c, seen.a, depths.z, depths.x);
    return best.depth;
}

// The triangle test of this shader.
fn test_triangle(ray: PreparedRay, triangle: Triangle, culling: u32) -> Candidate {
    return watertight(ray, triangle, culling);
}

// Twin of core/src/query/certify/screen.rs: which triangles a ray certainly misses, by edge functions and bounds on
// their errors, and of which rays that can be told. Needs sheared.wgsl.

// Error of a sheared coordinate, per unit of the corners' greatest distance on any axis.
const BLUR: f32 = 0x1p-21f;
// Error of an edge function, per unit of the blur times the greatest sheared coordinate and blur.
const EDGE_BLUR: f32 = 8.0;
// Error of the depth of a corner, relative.
const DEPTH_NOISE: f32 = 0x1p-20f;
// Components of a direction below this, but not zero, are not known to be without error.
const DIRECTION_KNOWN: f32 = 0x1p-100f;

// Whether a component of a direction, as given, is without error as it was scaled.
fn is_known(given: f32, scaled: f32) -> bool {
    return snap(given) == 0.0 || abs(scaled) >= DIRECTION_KNOWN;
}

// Whether preparation left a ray unchanged, and the ray is in the range in which the bounds hold.
fn is_as_given(ray: Ray, prepared: PreparedRay) -> bool {
    return !prepared.wide && prepared.offset == 0.0
        && all(prepared.origin == snap3(ray.origin))
        && is_known(ray.direction.x, prepared.direction.x)
        && is_known(ray.direction.y, prepared.direction.y)
        && is_known(ray.direction.z, prepared.direction.z);
}

// An edge function: twice the signed area of the origin and two sheared corners.
fn sheared_edge(p: vec2<f32>, q: vec2<f32>) -> f32 {
    return difference(product(p.x, q.y), product(p.y, q.x));
}

// True when three numbers are all beyond zero by more than the blur.
fn is_beside(a: f32, b: f32, c: f32, blur: f32) -> bool {
    return least(least(a, b), c) > blur || most(most(a, b), c) < -blur;
}

// A triangle that a ray may meet; it certainly does not unless `some`.
struct Screened {
    some: bool,
    seen: Sheared,
    edges: vec3<f32>,
    // What an edge function may err.
    margin: f32,
    // The triangle is met no nearer than at this inner `t`.
    nearest: f32,
}

// Whether a ray may meet a triangle of a scene that is not wide, from a side that counts, at `farthest`, an inner `t`, or
// nearer.
fn screen(ray: PreparedRay, triangle: Triangle, culling: u32, farthest: f32) -> Screened {
    var out: Screened;
    out.some = false;
    var seen: Sheared;
    let axes = axes_of(ray);
    seen.away_a = corner_away(axes, triangle.a, ray.origin);
    seen.away_b = corner_away(axes, triangle.b, ray.origin);
    seen.away_c = corner_away(axes, triangle.c, ray.origin);
    seen.a = shear_corner(seen.away_a, ray.shear);
    seen.b = shear_corner(seen.away_b, ray.shear);
    seen.c = shear_corner(seen.away_c, ray.shear);
    let reach =
        most(most(most_of(abs(seen.away_a)), most_of(abs(seen.away_b))), most_of(abs(seen.away_c)));
    let blur = product(reach, BLUR);
    if is_beside(seen.a.x, seen.b.x, seen.c.x, blur) || is_beside(seen.a.y, seen.b.y, seen.c.y, blur) {
        return out;
    }
    let edges = vec3<f32>(
        sheared_edge(seen.c, seen.b),
        sheared_edge(seen.a, seen.c),
        sheared_edge(seen.b, seen.a),
    );
    let a = abs(seen.a);
    let b = abs(seen.b);
    let c = abs(seen.c);
    let width = most(most(most(a.x, a.y), most(b.x, b.y)), most(c.x, c.y));
    let margin = sum(product(product(blur, EDGE_BLUR), sum(width, blur)), EDGE_LEAST);
    let positive = edges.x > margin || edges.y > margin || edges.z > margin;
    let negative = edges.x < -margin || edges.y < -margin || edges.z < -margin;
    let culled = (culling == CULL_BACK && negative) || (culling == CULL_FRONT && positive);
    if (positive && negative) || culled {
        return out;
    }
    let depths = vec3<f32>(
        product(ray.shear.z, seen.away_a.z),
        product(ray.shear.z, seen.away_b.z),
        product(ray.shear.z, seen.away_c.z),
    );
    let first = least_of(depths);
    let last = most_of(depths);
    let nearest = difference(first, product(abs(first), DEPTH_NOISE));
    let greatest = sum(last, product(abs(last), DEPTH_NOISE));
    if nearest > least(farthest, ray.t_max) || greatest < ray.t_min {
        return out;
    }
    out.some = true;
    out.seen = seen;
    out.edges = edges;
    out.margin = margin;
    out.nearest = nearest;
    return out;
}

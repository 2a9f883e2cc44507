// Twin of core/src/ray.rs: rays, hits and options.

// The points origin + t * direction with t_min <= t <= t_max, both ends included. Limits may be
// infinite; components that are not finite, and NaN limits, are told by their bits, and such a ray
// hits nothing.
struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

// Where a ray meets a triangle. The point is (1 - u - v) * a + u * b + v * c. For a miss `triangle`
// is NO_TRIANGLE, `t` GREATEST (WGSL has no infinity) and the weights 0. `triangle` is UNFINISHED, and
// the rest as for a miss, when the driver ended the traversal early. It is UNDECIDED_HIT when a test that
// tells exact hits leaves open which it is; whatever may be hit is no nearer than `t`. It is DEFERRED when the ray is
// left to another shader, and UNSETTLED when all but the triangles that are set aside is known; a ray that is still so afterwards counts as unfinished.
struct Hit {
    t: f32,
    triangle: u32,
    u: f32,
    v: f32,
}

// Query settings.
struct QueryOptions {
    // CULL_NONE, CULL_BACK or CULL_FRONT: the side to ignore.
    culling: u32,
    // The index of a triangle to ignore, or NO_TRIANGLE.
    ignore: u32,
}

const NO_TRIANGLE: u32 = 0xffffffffu;
const UNFINISHED: u32 = 0xfffffffeu;
const UNDECIDED_HIT: u32 = 0xfffffffdu;
const DEFERRED: u32 = 0xfffffffcu;
const UNSETTLED: u32 = 0xfffffffbu;
const CULL_NONE: u32 = 0u;
const CULL_BACK: u32 = 1u;
const CULL_FRONT: u32 = 2u;

// The bits of infinity: `t` in the record of a miss.
const INFINITY_BITS: u32 = 0x7f800000u;

// Both sides count, no triangle is ignored.
fn default_options() -> QueryOptions {
    return QueryOptions(CULL_NONE, NO_TRIANGLE);
}

// A miss.
fn no_hit() -> Hit {
    return Hit(GREATEST, NO_TRIANGLE, 0.0, 0.0);
}

fn is_hit(hit: Hit) -> bool {
    return hit.triangle < UNSETTLED;
}

// Whether the ray was not followed to its end: the driver ended its walk, or it was left to another shader, which has not taken it up.
fn is_unfinished(hit: Hit) -> bool {
    return hit.triangle == UNFINISHED || hit.triangle == DEFERRED || hit.triangle == UNSETTLED;
}

// A ray from the 32 bytes of its record.
fn ray_of_words(first: vec4<u32>, second: vec4<u32>) -> Ray {
    let a = bitcast<vec4<f32>>(first);
    let b = bitcast<vec4<f32>>(second);
    return Ray(a.xyz, a.w, b.xyz, b.w);
}

// The 16 bytes of a hit's record.
fn hit_words(hit: Hit) -> vec4<u32> {
    let t = select(bitcast<u32>(hit.t), INFINITY_BITS, hit.triangle >= UNFINISHED);
    return vec4<u32>(t, hit.triangle, bitcast<u32>(hit.u), bitcast<u32>(hit.v));
}

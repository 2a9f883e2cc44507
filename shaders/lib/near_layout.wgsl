// Twin of core/src/layout/near.rs: what queries for what is near share. For kernels of 64 invocations.
//
// A query measures in a unit of its own, a power of two, from an origin of its own: in it nothing of the scene is farther away than 1 along any
// axis. So no size of a scene or distance overflows, and errors have one bound: NEAR_BATCH_SLACK.

struct NearBatch {
    count: u32,
    // Index of a triangle that does not count, or one that no triangle has.
    ignore: u32,
    // Words of what is written for a query.
    room: u32,
    // 1 where one triangle that is certainly met is enough.
    any: u32,
    // The box around all triangles.
    lower: vec3<f32>,
    zero: u32,
    upper: vec3<f32>,
    padding: u32,
}

// Two words a node, as in core/src/tree/node.rs.
@group(0) @binding(0) var<storage, read> nodes: array<vec2<u32>>;
// Triangle indices, named by leaves.
@group(0) @binding(1) var<storage, read> leaf_references: array<u32>;
// Snapped corners, nine numbers a triangle.
@group(0) @binding(2) var<storage, read> triangles: array<f32>;
@group(0) @binding(3) var<uniform> near_batch: NearBatch;

// In place of the number of triangles: the driver did not let the query finish; there is no room for what it needs.
const NEAR_BATCH_ENDED_EARLY: u32 = 0xffffffffu;
const NEAR_BATCH_OVERFULL: u32 = 0xfffffffeu;
// What a walk returns that was finished.
const WALKED: u32 = 0u;
// More than a distance or a bound of one may err, in the query's unit: 64 roundings of numbers below 1.
const NEAR_BATCH_SLACK: f32 = 0x1p-18f;
// A square that is greater by this is that of a distance that is certainly greater.
const SQUARE_SLACK: f32 = 0x1.00004p+0f;
// Squares below this are of lengths that count as 0: less than a rounding.
const LEAST_SQUARE: f32 = 0x1p-56f;
// Normals and edges whose squares are below this are none.
const LEAST_DIVISOR: f32 = 0x1p-100f;
const LANES: u32 = 64u;
// Where a walk is at no node.
const NO_NODE: u32 = 0xffffffffu;

// The query of an invocation: workgroups in rows, since one dimension is not long enough.
fn query_index(workgroup: vec3<u32>, workgroups: vec3<u32>, local: u32) -> u32 {
    return (workgroup.y * workgroups.x + workgroup.x) * LANES + local;
}

// False once a driver ends the loops of the invocation: llvmpipe then lets each loop run once.
fn loops_run() -> bool {
    var rounds = 0u;
    loop {
        if rounds >= (2u ^ opaque_zero) {
            break;
        }
        rounds += 1u;
    }
    return (rounds ^ opaque_zero) == 2u;
}

// 1 / sqrt(x) of a normal number, within a few roundings: from the bits, then three steps of Newton.
fn inverse_root(x: f32) -> f32 {
    var inverse = bitcast<f32>(0x5f3759dfu - (bitcast<u32>(x) >> 1u));
    let half = product(x, 0.5);
    inverse = product(inverse, difference(1.5, product(product(half, inverse), inverse)));
    inverse = product(inverse, difference(1.5, product(product(half, inverse), inverse)));
    inverse = product(inverse, difference(1.5, product(product(half, inverse), inverse)));
    return inverse;
}

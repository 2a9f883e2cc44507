// Runs every guarded operation, for the self-test to compare with the CPU's.
// One invocation a pair of operands.
// Reads: pairs of operands.
// Writes: eight results a pair, as bits.

struct CheckParameters {
    zero: u32,
    count: u32,
}

@group(0) @binding(0) var<uniform> parameters: CheckParameters;
@group(0) @binding(1) var<storage, read> operands: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> results: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    opaque_zero = parameters.zero;
    if id.x >= parameters.count {
        return;
    }
    let x = operands[id.x].x;
    let y = operands[id.x].y;
    let at = 8u * id.x;
    results[at] = bitcast<u32>(snapped_product(x, y));
    results[at + 1u] = bitcast<u32>(snapped_sum(x, y));
    results[at + 2u] = bitcast<u32>(snapped_difference(x, y));
    results[at + 3u] = bitcast<u32>(snap(quotient(x, y)));
    results[at + 4u] = bitcast<u32>(snap(two_product(x, y).low));
    results[at + 5u] = bitcast<u32>(snap(two_sum(x, y).low));
    // The two forms that compilers fuse and factor.
    let z = sum(x, 1.0);
    results[at + 6u] = bitcast<u32>(snap(difference(product(x, z), product(y, z))));
    results[at + 7u] = bitcast<u32>(snap(sum(sum(product(x, y), product(y, z)), product(z, x))));
}

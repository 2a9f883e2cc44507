// Twin of core/src/arithmetic.rs: guarded and free operations on f32.
//
// WGSL names no rounding mode and lets a compiler fuse, reassociate and flush. Each guarded operation
// rounds once, and its result passes through an integer operation that a compiler cannot see through,
// so that nothing merges with it. There is no hardware division: `quotient` works on mantissas.

// Zero at run time, which no compiler can know. Every entry point sets it first, from a buffer.
var<private> opaque_zero: u32;

// 2^-126, the least normal number.
const LEAST_NORMAL: f32 = 0x1p-126f;
// The greatest finite number, f32::MAX.
const GREATEST: f32 = 0x1.fffffep+127f;

// The rounding barrier.
fn guard(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ opaque_zero);
}

// a * b, rounded once.
fn product(a: f32, b: f32) -> f32 {
    return guard(a * b);
}

// a + b, rounded once.
fn sum(a: f32, b: f32) -> f32 {
    return guard(a + b);
}

// a - b, rounded once.
fn difference(a: f32, b: f32) -> f32 {
    return guard(a - b);
}

// +0 for zeros and for everything below the least normal number.
fn snap(x: f32) -> f32 {
    return select(x, 0.0, abs(x) < LEAST_NORMAL);
}

fn snapped_product(a: f32, b: f32) -> f32 {
    return snap(product(a, b));
}

fn snapped_sum(a: f32, b: f32) -> f32 {
    return snap(sum(a, b));
}

fn snapped_difference(a: f32, b: f32) -> f32 {
    return snap(difference(a, b));
}

// 2^shift a / b of two mantissas, from 2^23 to 2^24, give or take 6: WGSL allows the reciprocal an error of 2.5 units in
// the last place, which are up to 5 here, and a product rounds. The only free operations whose result reaches a tree:
// `quotient` makes it exact.
fn near_quotient(a: u32, b: u32, shift: u32) -> u32 {
    let near = guard(free_mul(f32(a), free_reciprocal(f32(b))));
    return u32(product(near, bitcast<f32>((127u + shift) << 23u)));
}

// a / b, rounded to nearest: exact on every device. A free quotient of the mantissas is made exact by what is
// left of the dividend, in whole numbers. Subnormal operands count as zero, subnormal results are zero.
fn quotient(a: f32, b: f32) -> f32 {
    let a_bits = bitcast<u32>(a);
    let b_bits = bitcast<u32>(b);
    let sign = (a_bits ^ b_bits) & 0x80000000u;
    let a_field = (a_bits >> 23u) & 0xffu;
    let b_field = (b_bits >> 23u) & 0xffu;
    let dividend = (a_bits & 0x7fffffu) | 0x800000u;
    let divisor = (b_bits & 0x7fffffu) | 0x800000u;
    // The mantissa is floor(2^shift dividend / divisor), from 2^23 to below 2^24, and then rounded.
    let less = select(0u, 1u, dividend < divisor);
    let shift = 23u + less;
    // 8 too low is too low for certain, and by less than 16. What is left is below 2^28: its last 32 bits tell it.
    var mantissa = near_quotient(dividend, divisor, shift) - 8u;
    var rest = (dividend << shift) - mantissa * divisor;
    let by_8 = select(0u, 8u, rest >= 8u * divisor);
    mantissa += by_8;
    rest -= by_8 * divisor;
    let by_4 = select(0u, 4u, rest >= 4u * divisor);
    mantissa += by_4;
    rest -= by_4 * divisor;
    let by_2 = select(0u, 2u, rest >= 2u * divisor);
    mantissa += by_2;
    rest -= by_2 * divisor;
    let by_1 = select(0u, 1u, rest >= divisor);
    mantissa += by_1;
    rest -= by_1 * divisor;
    let field = i32(a_field) - i32(b_field) + 127 - i32(less);
    // A quotient of two mantissas never lies half way between two others. But all bits set just below the least normal
    // number are half way to it from the subnormal number below: to nearest even, that is the least normal number.
    let up = field == 0 && mantissa == 0xffffffu;
    // Rounding up to 2^24 carries into the exponent.
    mantissa += select(0u, 1u, 2u * rest > divisor || up);
    let bits = (clamp(field, -1, 255) << 23u) + i32(mantissa) - 0x800000;
    let infinity = 0x7f800000u ^ opaque_zero;
    var out = select(min(u32(bits), infinity), 0u, bits < 0x800000);
    out = select(out, infinity, b_field == 0u || a_field == 0xffu);
    return bitcast<f32>(sign | select(out, 0u, a_field == 0u || b_field == 0xffu));
}

// The square root, rounded to nearest: exact on every device. An approximation by guarded products is
// made exact by what is left of the square, in whole numbers. Zero for zeros, subnormal and negative
// numbers; not for infinity and NaN.
fn square_root(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let field = bits >> 23u;
    if field == 0u || field >= 0xffu {
        return 0.0;
    }
    // x = part * 4^power, part from 1 to below 4.
    let odd = (field & 1u) ^ 1u;
    let part = bitcast<f32>(((127u + odd) << 23u) | (bits & 0x7fffffu));
    // 1 / sqrt(part) from the bits, then three steps of Newton: the error is a few units.
    var inverse = bitcast<f32>(0x5f3759dfu - (bitcast<u32>(part) >> 1u));
    let half = product(part, 0.5);
    inverse = product(inverse, difference(1.5, product(half, product(inverse, inverse))));
    inverse = product(inverse, difference(1.5, product(half, product(inverse, inverse))));
    inverse = product(inverse, difference(1.5, product(half, product(inverse, inverse))));
    // The root in units of 2^-23, and what part leaves of its square in units of 2^-46: below 2^31, so
    // that it is known from the last 32 bits.
    var root = (bitcast<u32>(clamp(product(part, inverse), 1.0, 0x1.fffffep+0f)) & 0x7fffffu) | 0x800000u;
    let mantissa = (bits & 0x7fffffu) | 0x800000u;
    var rest = bitcast<i32>((mantissa << (23u + odd)) - root * root);
    while rest < 0 {
        root -= 1u;
        rest += bitcast<i32>(2u * root + 1u);
    }
    while rest > bitcast<i32>(2u * root) {
        rest -= bitcast<i32>(2u * root + 1u);
        root += 1u;
    }
    // Half way between two numbers there is no root.
    if rest > bitcast<i32>(root) {
        root += 1u;
    }
    let root_field = (field + 127u - odd) >> 1u;
    return bitcast<f32>((root_field << 23u) + (root - 0x800000u));
}

// Products of doubles err by less than this part of their factors.
const DOUBLE_NOISE: f32 = 0x1p-40f;

// A sum of two floats that do not overlap: about 48 bits.
struct Double {
    high: f32,
    low: f32,
}

// a * b without error, as a rounded part and what is left. What is left comes from the mantissas:
// modulo 2^32, since it is below 2^24. Zero where the product is subnormal.
fn two_product(a: f32, b: f32) -> Double {
    let high = product(a, b);
    let a_bits = bitcast<u32>(a);
    let b_bits = bitcast<u32>(b);
    let high_bits = bitcast<u32>(high);
    let high_field = (high_bits >> 23u) & 0xffu;
    let a_exponent = exponent(a);
    let b_exponent = exponent(b);
    let all_high = high_field == 0u || high_field == 0xffu || a_exponent == -127 || b_exponent == -127;
    let a_mantissa = (a_bits & 0x7fffffu) | 0x800000u;
    let b_mantissa = (b_bits & 0x7fffffu) | 0x800000u;
    let high_mantissa = (high_bits & 0x7fffffu) | 0x800000u;
    let shift = u32(i32(high_field) - 127 - a_exponent - b_exponent + 23) & 31u;
    let rest = bitcast<i32>(a_mantissa * b_mantissa - (high_mantissa << shift));
    let rounded = f32(select(rest, -rest, (high_bits >> 31u) == 1u));
    let low = scale(rounded, a_exponent + b_exponent - 46);
    return Double(select(high, snap(high), all_high), select(low, 0.0, all_high));
}

// a + b without error, as a rounded part and what is left (Knuth's two-sum).
fn two_sum(a: f32, b: f32) -> Double {
    let high = sum(a, b);
    let b_part = difference(high, a);
    let a_part = difference(high, b_part);
    return Double(high, sum(difference(a, a_part), difference(b, b_part)));
}

// Dekker's fast two-sum: |high| >= |low|.
fn renormalise(high: f32, low: f32) -> Double {
    let rounded = sum(high, low);
    return Double(rounded, difference(low, difference(rounded, high)));
}

// a - b without error.
fn double_difference_of(a: f32, b: f32) -> Double {
    return two_sum(a, -b);
}

// The product, its two parts not yet added up: they may overlap.
fn double_times_loosely(a: Double, b: Double) -> Double {
    let exact = two_product(a.high, b.high);
    var low = sum(exact.low, product(a.high, b.low));
    low = sum(low, product(a.low, b.high));
    return Double(exact.high, low);
}

// The product, to about 2^-46 of itself.
fn double_times(a: Double, b: Double) -> Double {
    let loose = double_times_loosely(a, b);
    return renormalise(loose.high, loose.low);
}

// The product with a float, to about 2^-46 of itself.
fn double_times_float(a: Double, b: f32) -> Double {
    let exact = two_product(a.high, b);
    return renormalise(exact.high, sum(exact.low, product(a.low, b)));
}

// The sum, to about 2^-46 of the greater operand.
fn double_plus(a: Double, b: Double) -> Double {
    let exact = two_sum(a.high, b.high);
    return renormalise(exact.high, sum(exact.low, sum(a.low, b.low)));
}

// The difference, to about 2^-46 of the greater operand.
fn double_minus(a: Double, b: Double) -> Double {
    return double_plus(a, Double(-b.high, -b.low));
}

// A vector of doubles.
struct Double3 {
    high: vec3<f32>,
    low: vec3<f32>,
}

// One coordinate of a vector, by selection: an index that is not constant would send the vector to memory.
fn on_axis(v: vec3<f32>, axis: u32) -> f32 {
    return select(select(v.x, v.y, axis == 1u), v.z, axis == 2u);
}

// One coordinate of a vector of doubles.
fn double_on_axis(v: Double3, axis: u32) -> Double {
    return Double(on_axis(v.high, axis), on_axis(v.low, axis));
}

// The axis after this one; after the last comes the first.
fn axis_after(axis: u32) -> u32 {
    return select(axis + 1u, 0u, axis == 2u);
}

// p - q without error.
fn double3_difference_of(p: vec3<f32>, q: vec3<f32>) -> Double3 {
    let x = double_difference_of(p.x, q.x);
    let y = double_difference_of(p.y, q.y);
    let z = double_difference_of(p.z, q.z);
    return Double3(vec3<f32>(x.high, y.high, z.high), vec3<f32>(x.low, y.low, z.low));
}

// A vector as doubles.
fn double3_of(v: vec3<f32>) -> Double3 {
    return Double3(v, vec3<f32>());
}

// floor(log2 |x|) of a normal number, -127 for zero and subnormals.
fn exponent(x: f32) -> i32 {
    return i32((bitcast<u32>(x) >> 23u) & 0xffu) - 127;
}

// The power of two with this exponent, clamped to -126..=127.
fn power_of_two(power: i32) -> f32 {
    return bitcast<f32>(u32(clamp(power, -126, 127) + 127) << 23u);
}

// x * 2^power, clamped to finite values, subnormal results zero: by the exponent field alone, so that
// nothing overflows or is flushed on the way. Twin of `scale` in core/src/query/intersect.
fn scale(x: f32, power: i32) -> f32 {
    return scale_bits(bitcast<u32>(x), power);
}

// `scale` of the number with these bits, which may be subnormal or infinite.
fn scale_bits(bits: u32, power: i32) -> f32 {
    let sign = bits & 0x80000000u;
    var field = i32((bits >> 23u) & 0xffu);
    var mantissa = bits & 0x7fffffu;
    if field == 0 {
        if mantissa == 0u {
            return 0.0;
        }
        let highest = firstLeadingBit(mantissa);
        field = i32(highest) - 22;
        mantissa = (mantissa << (23u - highest)) & 0x7fffffu;
    }
    let scaled = field + power;
    if field == 255 || scaled >= 255 {
        return bitcast<f32>(sign | 0x7f7fffffu);
    }
    if scaled <= 0 {
        // All bits set just below the least normal number: to nearest, that is the least normal number.
        let up = scaled == 0 && mantissa == 0x7fffffu;
        return bitcast<f32>(select(0u, sign | 0x800000u, up));
    }
    return bitcast<f32>(sign | (u32(scaled) << 23u) | mantissa);
}

// Integers in the order of the floats; -0 comes just before +0.
fn ordered_bits(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return select(~bits, bits | 0x80000000u, (bits >> 31u) == 0u);
}

// The lesser value; the first on equality.
fn least(a: f32, b: f32) -> f32 {
    return select(a, b, b < a);
}

// The greater value; the first on equality.
fn most(a: f32, b: f32) -> f32 {
    return select(a, b, b > a);
}

// Unguarded operations: a compiler may fuse them and round as it likes. For results that are widened
// anyway, such as the distance to a plane.
fn free_mul(a: f32, b: f32) -> f32 {
    return a * b;
}

fn free_mul_add(a: f32, b: f32, c: f32) -> f32 {
    return a * b + c;
}

fn free_sub(a: f32, b: f32) -> f32 {
    return a - b;
}

// 1 / a to 2.5 ULP. The only hardware division.
fn free_reciprocal(a: f32) -> f32 {
    return 1.0 / a;
}

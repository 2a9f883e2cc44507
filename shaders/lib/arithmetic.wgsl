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

// a / b, rounded to nearest, by long division of the mantissas: exact on every device. Subnormal
// operands count as zero, subnormal results are zero.
fn quotient(a: f32, b: f32) -> f32 {
    let a_bits = bitcast<u32>(a);
    let b_bits = bitcast<u32>(b);
    let sign = (a_bits ^ b_bits) & 0x80000000u;
    let a_field = (a_bits >> 23u) & 0xffu;
    let b_field = (b_bits >> 23u) & 0xffu;
    if a_field == 0u || b_field == 0xffu {
        return bitcast<f32>(sign);
    }
    if b_field == 0u || a_field == 0xffu {
        return bitcast<f32>(sign | (0x7f800000u ^ opaque_zero));
    }
    let divisor = (b_bits & 0x7fffffu) | 0x800000u;
    // 8 bits of the quotient at a time: each dividend fits 32 bits.
    var rest = ((a_bits & 0x7fffffu) | 0x800000u);
    var digits = 0u;
    for (var i = 0u; i < 3u; i++) {
        let dividend = rest << 8u;
        let digit = dividend / divisor;
        rest = dividend - digit * divisor;
        digits = (digits << 8u) + digit;
    }
    // digits = floor(2^24 * a / b) of the mantissas, from above 2^23 to below 2^25.
    var field = i32(a_field) - i32(b_field) + 126;
    var mantissa = digits;
    if digits >= 0x1000000u {
        // One bit too many: round it off, to even on a tie.
        field += 1;
        mantissa = digits >> 1u;
        if (digits & 1u) == 1u && (rest != 0u || (mantissa & 1u) == 1u) {
            mantissa += 1u;
        }
    } else if 2u * rest > divisor || (2u * rest == divisor && (mantissa & 1u) == 1u) {
        mantissa += 1u;
    }
    if mantissa == 0x1000000u {
        mantissa = 0x800000u;
        field += 1;
    }
    if field <= 0 {
        return bitcast<f32>(sign);
    }
    if field >= 255 {
        return bitcast<f32>(sign | (0x7f800000u ^ opaque_zero));
    }
    return bitcast<f32>(sign | (u32(field) << 23u) | (mantissa & 0x7fffffu));
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
    if high_field == 0u || high_field == 0xffu || a_exponent == -127 || b_exponent == -127 {
        return Double(snap(high), 0.0);
    }
    let a_mantissa = (a_bits & 0x7fffffu) | 0x800000u;
    let b_mantissa = (b_bits & 0x7fffffu) | 0x800000u;
    let high_mantissa = (high_bits & 0x7fffffu) | 0x800000u;
    let shift = u32(i32(high_field) - 127 - a_exponent - b_exponent + 23);
    let rest = bitcast<i32>(a_mantissa * b_mantissa - (high_mantissa << shift));
    let rounded = f32(select(rest, -rest, (high_bits >> 31u) == 1u));
    return Double(high, scale(rounded, a_exponent + b_exponent - 46));
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

// A vector as doubles.
fn double3_of(v: vec3<f32>) -> Double3 {
    return Double3(Double(v.x, 0.0), Double(v.y, 0.0), Double(v.z, 0.0));
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

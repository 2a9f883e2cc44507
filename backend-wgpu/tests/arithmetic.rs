//! The guarded arithmetic of WGSL against that of the core, bit for bit, on this machine's device.
//!
//! Operands are normal numbers and zeros: subnormal operands do not occur, since coordinates and
//! results are snapped. A result that is subnormal in Rust may be flushed on the device or not, with
//! either sign of zero; both are compared after flushing. Operands whose result overflows are left
//! out: WGSL does not say what comes then, and no kernel lets it happen.

use crate::common::{self, hostile};
use splitplane_core::arithmetic::{
    Arithmetic, Double, Strict, exponent, flush, ordered_bits, power_of_two, snap,
};
use splitplane_test_support::random::Random;

/// How many pairs of operands each function is tried on.
const PAIRS: usize = 1 << 18;

/// Numbers at which rounding, ties, signs and exponents are awkward.
const SPECIAL: [f32; 22] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1.000_000_1,
    0.999_999_94,
    -1.5,
    2.0,
    3.0,
    0.1,
    1.0 / 3.0,
    16_777_215.0,
    16_777_216.0,
    -8_388_609.0,
    f32::MIN_POSITIVE,
    -1.175_494_5e-38,
    2.350_988_6e-38,
    f32::MAX,
    -1.701_411_7e38,
    1e-30,
    -1e30,
    3.155_443_6e-30,
];

/// A number with random sign and mantissa and this exponent.
fn with_exponent(random: &mut Random, exponent: i32) -> f32 {
    let mantissa = match random.below(4) {
        // Few bits, for ties.
        0 => (random.bits() & 0x7f_ffff) & (!0u32 << random.below(23)),
        1 => 0x7f_ffff >> random.below(23),
        _ => random.bits() & 0x7f_ffff,
    };
    let field = (exponent.clamp(-126, 127) + 127) as u32;
    f32::from_bits((random.bits() & 0x8000_0000) | (field << 23) | mantissa)
}

/// Pairs of operands: all special ones, then random ones with exponents in `range`, half of them with
/// exponents close together.
fn pairs(range: std::ops::Range<i32>, seed: u64) -> Vec<[f32; 2]> {
    let mut random = Random::new(seed);
    let within = |x: &f32| *x == 0.0 || range.contains(&exponent(*x));
    let special: Vec<f32> = SPECIAL.into_iter().filter(within).collect();
    let mut pairs: Vec<[f32; 2]> =
        special.iter().flat_map(|&a| special.iter().map(move |&b| [a, b])).collect();
    while pairs.len() < PAIRS {
        let width = (range.end - range.start) as usize;
        let a = range.start + random.below(width) as i32;
        let b = match random.below(2) {
            0 => range.start + random.below(width) as i32,
            _ => (a + random.below(61) as i32 - 30).clamp(range.start, range.end - 1),
        };
        pairs.push([with_exponent(&mut random, a), with_exponent(&mut random, b)]);
    }
    pairs
}

/// Every normal number, about.
const ALL: std::ops::Range<i32> = -126..128;
/// Where no part of a double under- or overflows.
const MIDDLE: std::ops::Range<i32> = -10..30;

/// What two words of a result are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    Floats,
    Words,
}

/// Two words for each pair, by WGSL: `statement` sets `r: vec2<u32>` from `a` and `b`.
fn on_the_device(library: &str, statement: &str, pairs: &[[f32; 2]]) -> Vec<[u32; 2]> {
    let source = format!(
        "{library}
        @group(0) @binding(0) var<storage, read> input: array<vec2<u32>>;
        @group(0) @binding(1) var<storage, read_write> output: array<vec2<u32>>;
        @group(0) @binding(2) var<uniform> zeros: vec4<u32>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
            opaque_zero = zeros.x;
            if id.x >= arrayLength(&input) {{ return; }}
            let a = bitcast<f32>(input[id.x].x);
            let b = bitcast<f32>(input[id.x].y);
            var r: vec2<u32>;
            {statement}
            output[id.x] = r;
        }}"
    );
    let words =
        common::run_words(&source, bytemuck::cast_slice(pairs), 2 * pairs.len(), pairs.len());
    words.as_chunks::<2>().0.to_vec()
}

fn arithmetic() -> String {
    let part = splitplane_shaders::LIBRARY.iter().find(|part| part.name == "arithmetic");
    part.expect("a part").text.to_string()
}

/// How many results differ between device and core, and the first of them in words.
fn differences(
    library: &str,
    statement: &str,
    form: Form,
    pairs: &[[f32; 2]],
    reference: &dyn Fn(f32, f32) -> Option<[u32; 2]>,
) -> (usize, String) {
    // Subnormals flushed, zeros without sign.
    let canonical = |word: u32| match form {
        Form::Floats => flush(f32::from_bits(word)).to_bits(),
        Form::Words => word,
    };
    let found = on_the_device(library, statement, pairs);
    let (mut count, mut compared, mut first) = (0, 0, String::new());
    for ([a, b], found) in pairs.iter().zip(found) {
        let Some(expected) = reference(*a, *b) else { continue };
        compared += 1;
        if expected.map(canonical) != found.map(canonical) {
            if count == 0 {
                first = format!("{a:e} and {b:e}: found {found:x?}, expected {expected:x?}");
            }
            count += 1;
        }
    }
    assert!(compared > 100_000, "only {compared} pairs were compared");
    (count, first)
}

/// Zero differences over exponents in `range`.
fn same(
    name: &str,
    statement: &str,
    form: Form,
    range: std::ops::Range<i32>,
    reference: &dyn Fn(f32, f32) -> Option<[u32; 2]>,
) {
    let pairs = pairs(range, 21);
    let (count, first) = differences(&arithmetic(), statement, form, &pairs, reference);
    assert_eq!(count, 0, "{name}: the first of {count}: {first}");
}

/// A rounded result, unless it overflows, or is the least normal number rounded up from below: where
/// subnormals are flushed, that may happen before or after rounding.
fn rounded(exact: f64) -> Option<[u32; 2]> {
    let least = f64::from(f32::MIN_POSITIVE);
    let rounded = exact as f32;
    let up = exact.abs() < least && rounded.abs() == f32::MIN_POSITIVE;
    if up { None } else { finite(rounded) }
}

/// A result, unless it overflows.
fn finite(x: f32) -> Option<[u32; 2]> {
    x.is_finite().then_some([x.to_bits(), 0])
}

fn finite_pair((high, low): (f32, f32)) -> Option<[u32; 2]> {
    (high.is_finite() && low.is_finite()).then_some([high.to_bits(), low.to_bits()])
}

fn finite_double(double: Double) -> Option<[u32; 2]> {
    finite_pair((double.high, double.low))
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn rounded_operations() {
    let one = |call: &str| format!("r = vec2<u32>(bitcast<u32>({call}), 0u);");
    let check = |call: &str, reference: &dyn Fn(f32, f32) -> Option<[u32; 2]>| {
        same(call, &one(call), Form::Floats, ALL, reference);
    };
    // Products are exact in f64; quotients of floats are never close enough to a tie for the second
    // rounding to count.
    check("product(a, b)", &|a, b| rounded(f64::from(a) * f64::from(b)));
    check("sum(a, b)", &|a, b| finite(Strict::sum(a, b)));
    check("difference(a, b)", &|a, b| finite(Strict::difference(a, b)));
    check("quotient(a, b)", &|a, b| finite(snap(Strict::quotient(a, b))));
    check("snapped_product(a, b)", &|a, b| {
        rounded(f64::from(a) * f64::from(b))?;
        finite(Strict::snapped_product(a, b))
    });
    check("snapped_sum(a, b)", &|a, b| finite(Strict::snapped_sum(a, b)));
    check("snapped_difference(a, b)", &|a, b| finite(Strict::snapped_difference(a, b)));
    check("least(a, b)", &|a, b| finite(if b < a { b } else { a }));
    check("most(a, b)", &|a, b| finite(if b > a { b } else { a }));
}

/// These are exact words, signs of zeros included.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn operations_on_bits() {
    let check = |name: &str, statement: &str, reference: &dyn Fn(f32, f32) -> [u32; 2]| {
        same(name, statement, Form::Words, ALL, &|a, b| Some(reference(a, b)));
    };
    check("ordered_bits", "r = vec2<u32>(ordered_bits(a), ordered_bits(b));", &|a, b| {
        [ordered_bits(a), ordered_bits(b)]
    });
    check("exponent", "r = bitcast<vec2<u32>>(vec2<i32>(exponent(a), exponent(b)));", &|a, b| {
        [exponent(a) as u32, exponent(b) as u32]
    });
    check("snap", "r = bitcast<vec2<u32>>(vec2<f32>(snap(a), snap(b)));", &|a, b| {
        [snap(a).to_bits(), snap(b).to_bits()]
    });
    check(
        "power_of_two",
        "let p = bitcast<i32>(bitcast<u32>(a) % 600u) - 300;
         r = vec2<u32>(bitcast<u32>(power_of_two(p)), 0u);",
        &|a, _| [power_of_two((a.to_bits() % 600) as i32 - 300).to_bits(), 0],
    );
}

/// Square roots of whatever is positive and normal, squares and their neighbours among them; zero of
/// zeros, subnormal and negative numbers.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn square_roots() {
    let mut pairs = pairs(ALL, 26);
    let mut random = Random::new(27);
    for pair in &mut pairs {
        let a = match random.below(8) {
            // Exact squares and the numbers beside them.
            0 | 1 => {
                let root = (1 + random.below(4095)) as f32;
                f32::from_bits(((root * root).to_bits() + random.below(3) as u32) - 1)
            }
            // Beside the squares of 24-bit numbers, where rounding is closest.
            2..=4 => {
                let exponent = random.below(126) as i32 - 63;
                let root = with_exponent(&mut random, exponent).abs();
                f32::from_bits(((root * root).to_bits() + random.below(3) as u32) - 1)
            }
            5 => power_of_two(random.below(254) as i32 - 126),
            6 => f32::from_bits(random.bits() & 0x807f_ffff),
            _ => pair[0],
        };
        pair[0] = a;
    }
    let words = "r = vec2<u32>(bitcast<u32>(square_root(bitcast<f32>(input[id.x].x))), 0u);";
    let reference = |a: f32, _: f32| {
        let root = if a.is_normal() && a > 0.0 { a.sqrt() } else { 0.0 };
        Some([root.to_bits(), 0])
    };
    let (count, first) = differences(&arithmetic(), words, Form::Words, &pairs, &reference);
    assert_eq!(count, 0, "square_root: the first of {count}: {first}");
    // One mantissa of every two neighbouring powers of two in 64: all exponents behave alike.
    let step = (0..1u32 << 24).step_by(53).map(|m| [f32::from_bits(0x3f80_0000 + m), 0.0]);
    let steps: Vec<[f32; 2]> = step.collect();
    let (count, first) = differences(&arithmetic(), words, Form::Words, &steps, &reference);
    assert_eq!(count, 0, "square_root: the first of {count}: {first}");
    let faulty = arithmetic().replacen("root -= 1u;", "", 1);
    assert_ne!(faulty, arithmetic());
    let (count, _) = differences(&faulty, words, Form::Words, &steps, &reference);
    assert!(count > 0, "a fault in square_root goes unnoticed");
}

/// `scale` is private to the core; this is its text.
fn scale(x: f32, power: i32) -> f32 {
    let scaled = if power.abs() <= 126 {
        x * power_of_two(power)
    } else {
        let half = power / 2;
        x * power_of_two(half) * power_of_two(power - half)
    };
    snap(scaled.clamp(-f32::MAX, f32::MAX))
}

/// Powers in reach of rays and triangles; operands of every kind, subnormal and infinite included.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn scaling() {
    let mut pairs = pairs(ALL, 22);
    let mut random = Random::new(23);
    for pair in &mut pairs {
        pair[1] = (random.below(257) as i32 - 128) as f32;
        match random.below(20) {
            0 => pair[0] = f32::from_bits(random.bits() & 0x807f_ffff),
            1 => pair[0] = random.pick(&[f32::INFINITY, f32::NEG_INFINITY, 0.0, -0.0]),
            // Results next to the least normal number.
            2..=5 => {
                let power = random.below(100) as i32;
                let power = if power == 0 { 1 } else { power };
                pair[0] = with_exponent(&mut random, power - 127);
                pair[1] = -power as f32;
            }
            _ => {}
        }
    }
    let statement = "r = vec2<u32>(bitcast<u32>(scale_bits(input[id.x].x, i32(b))), 0u);";
    let reference = |a: f32, b: f32| Some([scale(a, b as i32).to_bits(), 0]);
    let (count, first) = differences(&arithmetic(), statement, Form::Words, &pairs, &reference);
    assert_eq!(count, 0, "scale: the first of {count}: {first}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn operations_without_error() {
    let two = "r = vec2<u32>(bitcast<u32>(d.high), bitcast<u32>(d.low));";
    let check = |call: &str, range, reference: &dyn Fn(f32, f32) -> Option<[u32; 2]>| {
        same(call, &format!("let d = {call}; {two}"), Form::Floats, range, reference);
    };
    check("two_sum(a, b)", -100..127, &|a, b| finite_pair(Strict::two_sum(a, b)));
    // What is left of a product that is subnormal, or next to it, is flushed with it.
    check("two_product(a, b)", ALL, &|a, b| {
        rounded(f64::from(a) * f64::from(b))?;
        let (high, low) = Strict::two_product(a, b);
        let low = if flush(high) == 0.0 { 0.0 } else { low };
        finite_pair((high, low))
    });
    check("double_difference_of(a, b)", -100..127, &|a, b| {
        finite_double(Double::difference_of::<Strict>(a, b))
    });
}

/// Doubles made of a pair: their products and sums.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn doubles() {
    let two = "r = vec2<u32>(bitcast<u32>(d.high), bitcast<u32>(d.low));";
    let given = "let p = two_product(a, b); let q = two_sum(b, a);";
    let parts = |a: f32, b: f32| {
        let (high, low) = Strict::two_product(a, b);
        (Double { high, low }, Double::difference_of::<Strict>(b, -a))
    };
    let check = |call: &str, reference: &dyn Fn(Double, Double) -> Double| {
        let statement = format!("{given} let d = {call}; {two}");
        same(call, &statement, Form::Floats, MIDDLE, &|a, b| {
            let (p, q) = parts(a, b);
            finite_double(reference(p, q))
        });
    };
    check("double_times(p, q)", &|p, q| p.times::<Strict>(q));
    check("double_plus(p, q)", &|p, q| p.plus::<Strict>(q));
    check("double_minus(p, q)", &|p, q| p.minus::<Strict>(q));
}

/// The same sum of three products, raw and guarded: guarded it is Rust's everywhere. Raw, a compiler
/// may fuse or factor it, and llvmpipe's does; so this comparison is seen to fail.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn raw_arithmetic_differs_and_guarded_does_not() {
    let pairs = pairs(MIDDLE, 24);
    let reference = |x: f32, y: f32| {
        let z = x - y;
        finite(x * y + y * z + z * x)
    };
    let guarded = "let z = difference(a, b);
        let g = sum(sum(product(a, b), product(b, z)), product(z, a));
        r = vec2<u32>(bitcast<u32>(g), 0u);";
    let raw = "let z = a - b; r = vec2<u32>(bitcast<u32>(a * b + b * z + z * a), 0u);";
    let count = |statement| differences(&arithmetic(), statement, Form::Floats, &pairs, &reference);
    let (guarded, first) = count(guarded);
    assert_eq!(guarded, 0, "guarded: {first}");
    let (raw, first) = count(raw);
    println!("raw: {raw} of {} differ, the first: {first}", pairs.len());
    if common::is_llvmpipe() {
        assert!(raw > 0, "llvmpipe no longer rearranges raw arithmetic");
    }
}

/// Quotients are exact whatever a driver rounds within what WGSL allows; beyond that they are not.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn quotients_on_drivers_that_round_badly() {
    let pairs = pairs(MIDDLE, 26);
    let statement = "r = vec2<u32>(bitcast<u32>(quotient(a, b)), 0u);";
    let reference = |a: f32, b: f32| finite(Strict::quotient(a, b));
    let count = |driver: &hostile::Driver| {
        let library = driver.compiled(&arithmetic());
        differences(&library, statement, Form::Floats, &pairs, &reference)
    };
    for driver in hostile::ALLOWED {
        let (differ, first) = count(driver);
        assert_eq!(differ, 0, "{}: {first}", driver.name);
    }
    assert!(count(&hostile::FORBIDDEN).0 > 0, "{}: not seen", hostile::FORBIDDEN.name);
}

/// Faults in the text of the arithmetic change results.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    let two = "r = vec2<u32>(bitcast<u32>(d.high), bitcast<u32>(d.low));";
    let pair = |call: &str| format!("let d = {call}; {two}");
    let one = |call: &str| format!("r = vec2<u32>(bitcast<u32>({call}), 0u);");
    let quotient = |a: f32, b: f32| finite(Strict::quotient(a, b));
    let two_product = |a: f32, b: f32| finite_pair(Strict::two_product(a, b));
    let scaled = |a: f32, _: f32| Some([scale(a, -3).to_bits(), 0]);
    type Reference<'a> = &'a dyn Fn(f32, f32) -> Option<[u32; 2]>;
    let faults: [(&str, &str, String, Reference<'_>); 5] = [
        ("2u * rest > divisor", "rest > divisor", one("quotient(a, b)"), &quotient),
        ("divisor, shift) - 8u", "divisor, shift)", one("quotient(a, b)"), &quotient),
        ("rest -= by_2 * divisor;", "", one("quotient(a, b)"), &quotient),
        ("select(rest, -rest", "select(rest, rest", pair("two_product(a, b)"), &two_product),
        ("scaled == 0 && mantissa", "scaled == 1 && mantissa", one("scale(a, -3)"), &scaled),
    ];
    let mut pairs = pairs(MIDDLE, 25);
    // Just below the least normal number after scaling.
    pairs.push([f32::from_bits(0x01ff_ffff), 1.0]);
    for (right, wrong, statement, reference) in faults {
        let (count, first) =
            differences(&arithmetic(), &statement, Form::Floats, &pairs, reference);
        assert_eq!(count, 0, "without a fault: {first}");
        let faulty = arithmetic().replacen(right, wrong, 1);
        assert_ne!(faulty, arithmetic(), "{right}: the text is not there");
        let (count, _) = differences(&faulty, &statement, Form::Floats, &pairs, reference);
        assert!(count > 0, "{wrong} in place of {right} goes unnoticed");
    }
}

//! Small shaders with one fault each, and near misses without any.
//!
//! A line that must be found ends in `// found`: the finding is on it, or on a call that is.

use super::rules::Rule;
use super::{Free, arithmetic, assert_clean, lint};
use crate::source::Text;

/// What surrounds a planted function `test`.
const FRAME: &str = "
struct Parameters { zero: u32, other: u32 }
struct Pair { first: f32, second: f32 }
@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read_write> numbers: array<f32>;
var<private> kept: f32;
var<workgroup> shared_pairs: array<Pair, 4>;
";

const MAIN: &str = "
@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) local: u32) {
    opaque_zero = parameters.zero;
    numbers[0] = test(numbers[1], numbers[2], numbers[3]);
}
";

/// The arithmetic, then a planted text.
fn planted(text: &str) -> Vec<Text> {
    let main = if text.contains("fn main") { "" } else { MAIN };
    let text = format!("{FRAME}{text}{main}");
    vec![arithmetic().into(), Text { name: "planted".to_owned(), text }]
}

/// A kernel without fault that uses every guarded operation.
pub(crate) fn mini_kernel() -> Vec<Text> {
    planted(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return difference(sum(product(product(a, b), c), b), sum(a, difference(b, c)));
        }",
    )
}

/// The planted text has a finding of this rule, on a line marked `// found` or called from one, and
/// every marked line has one.
#[track_caller]
fn found(rule: Rule, text: &str) {
    let findings = lint(planted(text), Free::Allowed);
    let all: String = findings.iter().map(|finding| format!("\n{finding}")).collect();
    let lines: Vec<String> = findings
        .iter()
        .filter(|finding| finding.rule == rule)
        .flat_map(|f| [f.place.to_string()].into_iter().chain(f.calls.iter().cloned()))
        .collect();
    assert!(text.contains("// found"));
    for line in text.lines().filter(|line| line.ends_with("// found")) {
        assert!(lines.iter().any(|found| found.contains(line.trim())), "{line}{all}");
    }
}

#[track_caller]
fn clean(text: &str) {
    assert_clean(text, &lint(planted(text), Free::Allowed));
}

#[test]
fn raw_operations() {
    for line in
        ["a * b", "a + b", "a - b", "(vec2(a, b) * c).x", "(mat2x2f(a, b, c, a) * vec2(b, c)).x"]
    {
        let text =
            format!("fn test(a: f32, b: f32, c: f32) -> f32 {{\n return {line}; // found\n}}");
        found(Rule::Raw, &text);
    }
    // A compound assignment, and code that nothing calls.
    found(
        Rule::Raw,
        "fn unused(a: f32) -> f32 {
            var x = a;
            x += a; // found
            return x;
        }
        fn test(a: f32, b: f32, c: f32) -> f32 { return a; }",
    );
}

#[test]
fn inexact_operations() {
    for line in [
        "a / b",
        "a % b",
        "sqrt(a)",
        "inverseSqrt(a)",
        "fma(a, b, c)",
        "dot(vec2(a, b), vec2(b, c))",
        "cross(vec3(a, b, c), vec3(c, b, a)).x",
        "length(vec2(a, b))",
        "distance(vec2(a, b), vec2(b, c))",
        "normalize(vec2(a, b)).x",
        "mix(a, b, c)",
        "smoothstep(a, b, c)",
        "step(a, b)",
        "pow(a, b)",
        "exp(a)",
        "exp2(a)",
        "log(a)",
        "log2(a)",
        "sin(a)",
        "atan2(a, b)",
        "reflect(vec2(a, b), vec2(b, c)).x",
        "refract(vec2(a, b), vec2(b, c), a).x",
        "faceForward(vec2(a, b), vec2(b, c), vec2(a, c)).x",
        "determinant(mat2x2f(a, b, c, a))",
        "round(a)",
        "fract(a)",
        "modf(a).fract",
        "frexp(a).fract",
        "ldexp(a, 3)",
        "degrees(a)",
        "unpack2x16snorm(bitcast<u32>(a)).x",
        "f32(pack4x8snorm(vec4(a, b, c, a)))",
    ] {
        let text =
            format!("fn test(a: f32, b: f32, c: f32) -> f32 {{\n return {line}; // found\n}}");
        found(Rule::Inexact, &text);
    }
}

#[test]
fn values_that_are_not_finite() {
    found(
        Rule::NotFinite,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let bits = 0x7f800000u;
            return bitcast<f32>(bits); // found
        }",
    );
    found(
        Rule::NotFinite,
        "const QUIET: u32 = 0x7fc00000u;
        fn test(a: f32, b: f32, c: f32) -> f32 {
            return max(a, bitcast<f32>(QUIET)); // found
        }",
    );
}

#[test]
fn results_merge_directly() {
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return guard(a * b + c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return sum(a * b, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return product(a - b, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return sum(fma(a, b, c), c); // found
        }",
    );
}

#[test]
fn results_merge_through_variables() {
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            var x = 0.0;
            x = free_mul(a, b);
            return sum(x, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            kept = free_mul(a, b);
            return use_kept(c);
        }
        fn use_kept(c: f32) -> f32 {
            return sum(kept, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            shared_pairs[u32(a)].second = free_sub(a, b);
            workgroupBarrier();
            return product(shared_pairs[u32(b)].second, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            numbers[4] = free_sub(a, b);
            return product(numbers[5], c); // found
        }",
    );
    // Behind a pointer.
    found(
        Rule::Merged,
        "fn fill(into: ptr<function, f32>, a: f32) { *into = free_mul(a, a); }
        fn test(a: f32, b: f32, c: f32) -> f32 {
            var x = 0.0;
            fill(&x, a);
            return sum(x, c); // found
        }",
    );
}

#[test]
fn results_merge_through_functions() {
    found(
        Rule::Merged,
        "fn double(a: f32) -> f32 { return free_mul(a, 2.0); }
        fn test(a: f32, b: f32, c: f32) -> f32 {
            return sum(double(a), c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn plus_one(a: f32) -> f32 {
            return sum(a, 1.0); // found
        }
        fn test(a: f32, b: f32, c: f32) -> f32 {
            return plus_one(free_mul(a, b)); // found
        }",
    );
    // A helper is clean for one caller and not for another.
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let x = least(free_mul(a, b), c);
            let y = least(a, c);
            return sum(y, product(x, a)); // found
        }",
    );
}

#[test]
fn results_merge_through_values() {
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let pair = Pair(a, free_reciprocal(b));
            return product(pair.second, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let v = vec3(a, free_mul(b, c), c).zyx;
            return product(v.x, c); // found
        }",
    );
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            var list = array<f32, 3>(a, free_mul(b, c), c);
            return product(list[u32(a)], c); // found
        }",
    );
    for line in [
        "-free_mul(a, b)",
        "abs(free_mul(a, b))",
        "max(free_mul(a, b), c)",
        "clamp(free_mul(a, b), -c, c)",
        "select(free_mul(a, b), c, a < b)",
        "bitcast<f32>(bitcast<u32>(free_mul(a, b)) & 0x7fffffffu)",
    ] {
        let text = format!(
            "fn test(a: f32, b: f32, c: f32) -> f32 {{\n return sum({line}, c); // found\n}}"
        );
        found(Rule::Merged, &text);
    }
}

#[test]
fn barriers_that_are_none() {
    for barrier in [
        "bitcast<u32>(free_mul(a, b)) ^ 0u",
        "bitcast<u32>(free_mul(a, b)) ^ parameters.zero",
        "bitcast<u32>(free_mul(a, b)) | opaque_zero",
        "bitcast<u32>(free_mul(a, b)) + opaque_zero",
        "(bitcast<u32>(free_mul(a, b)) & 0x7fffffffu) ^ opaque_zero",
    ] {
        let text = format!(
            "fn test(a: f32, b: f32, c: f32) -> f32 {{\n return sum(bitcast<f32>({barrier}), c); // found\n}}"
        );
        found(Rule::Merged, &text);
    }
    // A namesake in another place.
    found(
        Rule::Merged,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let opaque_zero = 0u;
            let x = bitcast<f32>(bitcast<u32>(free_mul(a, b)) ^ opaque_zero);
            return sum(x, c); // found
        }",
    );
}

#[test]
fn free_results_in_buffers() {
    found(
        Rule::Written,
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            numbers[4] = free_sub(a, b); // found
            return a;
        }",
    );
}

#[test]
fn zeros_that_are_not_set() {
    let function = "fn test(a: f32, b: f32, c: f32) -> f32 {
        opaque_zero = 1u; // found
        return sum(a, b);
    }";
    found(Rule::Barrier, function);
    for start in [
        "",
        "opaque_zero = 0u;",
        "opaque_zero = parameters.other;",
        "numbers[0] = 0.0; opaque_zero = parameters.zero;",
        "if numbers[1] > 0.0 { opaque_zero = parameters.zero; }",
        "opaque_zero = parameters.zero; opaque_zero = 0u;",
        "set_zero();",
    ] {
        let text = format!(
            "fn set_zero() {{ opaque_zero = parameters.zero; }}
            @compute @workgroup_size(64)\nfn main() {{ {start} numbers[0] = sum(numbers[1], 1.0); }}"
        );
        let findings = lint(planted(&text), Free::Allowed);
        assert!(findings.iter().any(|finding| finding.rule == Rule::Barrier), "{start}");
    }
}

#[test]
fn free_operations_in_a_tree_kernel() {
    let text = "fn test(a: f32, b: f32, c: f32) -> f32 {
        if free_sub(a, b) > c { return a; }
        return b;
    }";
    assert_clean(text, &lint(planted(text), Free::Allowed));
    let findings = lint(planted(text), Free::Forbidden);
    assert!(matches!(&findings[..], [finding] if finding.rule == Rule::Free), "{findings:?}");
}

#[test]
fn near_misses() {
    assert_clean("mini", &lint(mini_kernel(), Free::Forbidden));
    // Guarded by hand, the zero on either side.
    clean(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let x = bitcast<f32>(opaque_zero ^ bitcast<u32>(free_mul(a, b)));
            return sum(guard(free_mul(x, b)), c);
        }",
    );
    // Free results that only free operations and comparisons see.
    clean(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let t = free_mul(free_sub(a, b), free_reciprocal(c));
            let least_t = free_sub(t, free_mul_add(abs(t), 0.5, c));
            return select(a, b, max(least_t, c) < a);
        }",
    );
    // One member is free, the other is not.
    clean(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            var pair = Pair(sum(a, b), free_mul(b, c));
            pair.second = free_sub(pair.second, a);
            return product(pair.first, c);
        }",
    );
    // A helper gives each caller its own.
    clean(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            let x = least(free_mul(a, b), c);
            return sum(select(least(a, c), c, x < c), product(a, b));
        }",
    );
    // Integers compute as they like; constants are folded before any device sees them.
    clean(
        "const THIRD: f32 = 1.0 / 3.0;
        fn test(a: f32, b: f32, c: f32) -> f32 {
            let i = bitcast<u32>(a) * 3u + bitcast<u32>(b) / 7u % 5u;
            let n = countOneBits(i) + extractBits(i, 3u, 2u);
            return product(floor(max(a, f32(n))), THIRD);
        }",
    );
    // An infinity that no compiler can see.
    clean(
        "fn test(a: f32, b: f32, c: f32) -> f32 {
            return bitcast<f32>(0x7f800000u ^ opaque_zero);
        }",
    );
    // The entry point leaves the zero to a function that sets it before all else.
    clean(
        "fn sum_of_numbers() -> f32 {
            opaque_zero = parameters.zero;
            return sum(numbers[1], numbers[2]);
        }
        @compute @workgroup_size(64)
        fn main() {
            if numbers[0] > 1.0 { numbers[0] = sum_of_numbers(); }
        }",
    );
    // A kernel without floats needs no zero.
    clean(
        "@compute @workgroup_size(64)
        fn main(@builtin(local_invocation_index) local: u32) {
            numbers[local] = bitcast<f32>(local + 1u);
        }",
    );
}

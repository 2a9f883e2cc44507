//! The WGSL twins of bins and wide costs against the core's, bit for bit, on this machine's device.

use crate::common;
use splitplane_core::aabb::Aabb;
use splitplane_core::arithmetic::{Hostile, Strict, power_of_two, snap};
use splitplane_core::build::bins::{BinAxis, expected_split_cost, wide_leaf_cost, wide_split_cost};
use splitplane_core::config::{BuildConfig, MAX_BINS};
use splitplane_test_support::random::Random;

/// How many cases each function is tried on.
const CASES: usize = 1 << 17;

/// What the parts of a shader need, then some of them.
fn library(replaced: [&str; 2]) -> String {
    let mut text = String::from(
        "struct Parameters {
            bins: u32, block_width: u32, traversal_cost: u32, intersection_cost: u32
        }
        var<private> parameters: Parameters;\n",
    );
    for name in ["arithmetic", "aabb", "sah", "wide", "bins"] {
        let part = splitplane_shaders::LIBRARY.iter().find(|part| part.name == name);
        text.push_str(part.expect("a part").text);
    }
    let [from, to] = replaced;
    assert!(text.contains(from), "the text to change is gone: {from}");
    text.replace(from, to)
}

/// Eight words for each eight, by WGSL: `statement` sets `r` from `g`, two `array<u32, 8>`.
fn on_the_device(library: &str, statement: &str, cases: &[[u32; 8]]) -> Vec<[u32; 8]> {
    let source = format!(
        "{library}
        @group(0) @binding(0) var<storage, read> input: array<array<u32, 8>>;
        @group(0) @binding(1) var<storage, read_write> output: array<array<u32, 8>>;
        @group(0) @binding(2) var<uniform> zeros: vec4<u32>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
            opaque_zero = zeros.x;
            if id.x >= arrayLength(&input) {{ return; }}
            var g = input[id.x];
            var r = array<u32, 8>();
            {statement}
            output[id.x] = r;
        }}"
    );
    let words =
        common::run_words(&source, bytemuck::cast_slice(cases), 8 * cases.len(), cases.len());
    words.as_chunks::<8>().0.to_vec()
}

/// A snapped coordinate of this exponent.
fn coordinate(random: &mut Random, exponent: i32) -> f32 {
    let mantissa = match random.below(3) {
        0 => 0,
        1 => (random.bits() & 0x7f_ffff) & (!0u32 << random.below(23)),
        _ => random.bits() & 0x7f_ffff,
    };
    let magnitude = power_of_two(exponent).to_bits() | mantissa;
    f32::from_bits(magnitude | (random.bits() & 0x8000_0000))
}

/// Ends of bounds, ends of a reference within them, the number of bins and a border. Bounds of all sizes:
/// wide, narrow for where they lie, flat, as large as can be; ends of references at borders and between.
fn places() -> Vec<[u32; 8]> {
    let mut random = Random::new(51);
    let mut cases = Vec::new();
    while cases.len() < CASES {
        let exponent = match random.below(4) {
            0 => random.below(254) as i32 - 126,
            1 => 120 + random.below(8) as i32,
            2 => random.below(20) as i32 - 126,
            _ => random.below(20) as i32 - 10,
        };
        let a = coordinate(&mut random, exponent);
        let b = match random.below(5) {
            0 => f32::from_bits(a.to_bits() ^ (random.bits() & 0xff)),
            1 => a,
            2 => -a,
            3 => 0.0,
            _ => {
                let near = exponent + random.below(5) as i32 - 2;
                coordinate(&mut random, near)
            }
        };
        let (lo, hi) = if a <= b { (a, b) } else { (b, a) };
        let bins = random.pick(&[2, 3, 7, 16, 31, 32, 63, 64]);
        let axis = BinAxis::of::<Strict>(&bounds(lo, hi), 0, bins);
        let mut ends = [0, 1].map(|_| {
            let at = match (random.below(4), &axis) {
                (0, Some(axis)) => {
                    axis.border::<Strict>(1 + random.below(bins as usize - 1) as u32)
                }
                (1, _) => random.pick(&[lo, hi]),
                _ => {
                    let part = random.unit();
                    (f64::from(lo) * (1.0 - part) + f64::from(hi) * part) as f32
                }
            };
            snap(at.clamp(lo, hi))
        });
        ends.sort_by(f32::total_cmp);
        // Planar references, too.
        if random.below(8) == 0 {
            ends[0] = ends[1];
        }
        let border = 1 + random.below(bins as usize - 1) as u32;
        let [x, y] = ends.map(f32::to_bits);
        cases.push([lo.to_bits(), hi.to_bits(), x, y, bins, border, 0, 0]);
    }
    cases
}

fn bounds(lo: f32, hi: f32) -> Aabb {
    Aabb { lo: [lo; 3], hi: [hi; 3] }
}

const PLACES: &str = "
    parameters.bins = g[4];
    let axis = bins_between(bitcast<f32>(g[0]), bitcast<f32>(g[1]));
    if axis.divisible {
        let range = bin_range(axis, bitcast<f32>(g[2]), bitcast<f32>(g[3]));
        let border = bin_border(axis, g[5]);
        r = array<u32, 8>(
            1u, bitcast<u32>(axis.lower), bitcast<u32>(axis.quarter), bitcast<u32>(axis.scale),
            range.x, range.y, bitcast<u32>(border), 0u,
        );
    }";

fn expected_place(case: &[u32; 8]) -> [u32; 8] {
    let [lo, hi, x, y] = [0, 1, 2, 3].map(|word| f32::from_bits(case[word]));
    let (bins, border) = (case[4], case[5]);
    let Some(axis) = BinAxis::of::<Strict>(&bounds(lo, hi), 0, bins) else { return [0; 8] };
    // What a device may flush is snapped.
    assert_eq!(BinAxis::of::<Hostile>(&bounds(lo, hi), 0, bins), Some(axis), "{lo:e}..{hi:e}");
    let [start, end] = axis.range::<Strict>(x, y);
    assert_eq!(axis.range::<Hostile>(x, y), [start, end], "{axis:?} {x:e} {y:e}");
    assert!(start <= end && end < bins, "{axis:?} {x:e} {y:e}");
    let plane = axis.border::<Strict>(border);
    assert!((lo..=hi).contains(&plane), "{axis:?} {plane:e}");
    let [lower, quarter, scale, plane] =
        [axis.lower, axis.quarter, axis.scale, plane].map(f32::to_bits);
    [1, lower, quarter, scale, start, end, plane, 0]
}

/// Half areas of node, left and right, references on both sides, and costs.
fn costs() -> Vec<[u32; 8]> {
    let mut random = Random::new(52);
    let area = |random: &mut Random| match random.below(4) {
        0 => 3 * 1023 * 1023,
        1 => 3,
        _ => 3 + random.below(3 * 1023 * 1023 - 2) as u32,
    };
    let count = |random: &mut Random| match random.below(4) {
        0 => random.below(300) as u32,
        1 => 1 << 30,
        _ => random.bits() >> (2 + random.below(20)),
    };
    let case = |_| {
        let [node, left_area, right_area] = [(); 3].map(|()| area(&mut random));
        let [left, right] = [(); 2].map(|()| count(&mut random));
        let cost = random.pick(&[1, 4, 100, 683]);
        [node, left_area, right_area, left, right, random.pick(&[1, 7, 16, 64]), 1367, cost]
    };
    (0..CASES).map(case).collect()
}

const COSTS: &str = "
    parameters.block_width = g[5];
    parameters.traversal_cost = g[6];
    parameters.intersection_cost = g[7];
    let split = wide_split_cost(g[0], vec2<u32>(g[1], g[2]), g[3], g[4]);
    let leaf = wide_leaf_cost(g[0], g[3]);
    let less = select(0u, 1u, wide_less(split, leaf)) + select(0u, 2u, wide_less(leaf, split));
    let expected = expected_split_cost(g[0], vec2<u32>(g[1], g[2]), g[3], g[4]);
    r = array<u32, 8>(split.x, split.y, leaf.x, leaf.y, less, expected.x, expected.y, 0u);";

fn expected_cost(case: &[u32; 8]) -> [u32; 8] {
    let [node, left_area, right_area, left, right, block_width, traversal_cost, intersection_cost] =
        *case;
    let config =
        BuildConfig { traversal_cost, intersection_cost, block_width, ..BuildConfig::default() };
    let split = wide_split_cost(&config, [node, left_area, right_area], left, right);
    let leaf = wide_leaf_cost(&config, node, left);
    let words = |cost: u64| [cost as u32, (cost >> 32) as u32];
    let less = u32::from(split < leaf) + 2 * u32::from(leaf < split);
    let expected = expected_split_cost(&config, [node, left_area, right_area], left, right);
    let ([a, b], [c, d], [e, f]) = (words(split), words(leaf), words(expected));
    [a, b, c, d, less, e, f, 0]
}

/// How many results differ, and the first of them in words.
fn differences(
    library: &str,
    statement: &str,
    cases: &[[u32; 8]],
    expected: fn(&[u32; 8]) -> [u32; 8],
) -> (usize, String) {
    let (mut count, mut first) = (0, String::new());
    for (case, found) in cases.iter().zip(on_the_device(library, statement, cases)) {
        let expected = expected(case);
        if found != expected {
            if count == 0 {
                first = format!("{case:x?}: found {found:x?}, expected {expected:x?}");
            }
            count += 1;
        }
    }
    (count, first)
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn bins_are_the_cores() {
    let cases = places();
    let divisible = cases.iter().filter(|case| expected_place(case)[0] == 1).count();
    let flat = cases.len() - divisible;
    assert!(divisible > CASES / 2 && flat > CASES / 50, "{divisible} and {flat}");
    let largest = f32::from_bits(cases.iter().map(|case| expected_place(case)[2]).max().unwrap());
    assert!(largest > 0.9 * power_of_two(126) && MAX_BINS == 64, "{largest:e}");
    let (count, first) = differences(&library(["", ""]), PLACES, &cases, expected_place);
    assert_eq!(count, 0, "the first: {first}");
}

#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn wide_costs_are_the_cores() {
    let (count, first) = differences(&library(["", ""]), COSTS, &costs(), expected_cost);
    assert_eq!(count, 0, "the first: {first}");
}

/// Faults in the text change results.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn planted_faults_are_seen() {
    for fault in [
        ["f32(whole) == end && whole > 0u", "f32(whole) == end"],
        ["whole > 0u", "false"],
        ["parameters.bins - 1u);\n    return", "parameters.bins);\n    return"],
        ["bitcast<u32>(x) ^ opaque_zero", "(bitcast<u32>(x) & 0xfffffffeu) ^ opaque_zero"],
        ["snapped_product(lo, 0.25), quarter", "snapped_product(lo, 0.5), quarter"],
    ] {
        let (count, _) = differences(&library(fault), PLACES, &places(), expected_place);
        assert!(count > 0, "{fault:?} goes unnoticed");
    }
    for fault in [
        ["select(0u, 1u, low < a.x)", "0u"],
        ["low.y + a.y * b", "low.y"],
        ["(middle >> 16u) + (other >> 16u)", "(middle >> 16u)"],
        ["a.y == b.y && a.x < b.x", "false"],
        ["children.y, areas.y", "children.x, areas.y"],
        ["case 2u: { base = 362u; }", "case 2u: { base = 361u; }"],
        ["(base + 4u) >> 3u", "base >> 3u"],
        ["(part.y << (32u - power)) | ", ""],
        ["if blocks <= 4u", "if blocks <= 5u"],
    ] {
        let (count, _) = differences(&library(fault), COSTS, &costs(), expected_cost);
        assert!(count > 0, "{fault:?} goes unnoticed");
    }
}

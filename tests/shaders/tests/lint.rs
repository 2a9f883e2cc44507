//! The lint of float arithmetic in shaders.
//!
//! WGSL lets a compiler fuse, reassociate and approximate. What keeps trees and watertight hits the
//! same on every device is that each float operation stands alone behind the barrier of
//! `arithmetic.wgsl`. This lint reads every shader in naga's form and holds it to that:
//!
//! - *Raw*: float `+ - *` stands only in `product`, `sum`, `difference` and the `free_` functions of
//!   the arithmetic module. *Inexact*: no float division but the one in `free_reciprocal`, no
//!   remainder, and of the built-in functions of floats only those that choose or truncate.
//! - *Merged*: no result that has not passed the barrier reaches another float operation, through
//!   variables, arguments, results, structs, arrays, selections, signs and masks. Only the exclusive
//!   or of a float's bits with `opaque_zero` is a barrier. This catches results of free operations
//!   that wander into guarded ones, which *raw* does not. *Unguarded*: `product`, `sum` and
//!   `difference` return what passed the barrier. *Written*: nothing else is written to a buffer.
//! - *Barrier*: every entry point whose functions use `opaque_zero`, or the function through which it
//!   reaches them, sets it first, from a member `zero` of a buffer, and nothing else writes it. *Free*: kernels
//!   that trace no rays, as the tables of their sets say, call no free operation at all: all of the tree
//!   builder's, some of the ray tracer's and of the queries. But for the first guess of `quotient`, which that corrects.
//! - *NotFinite*: no infinity or NaN that a compiler can see, as a literal or a constant's bits.
//!
//! Shaders of accuracy `fast` (names that end in `_fast`) may compute as they like.
//!
//! Not checked: that a free result decides nothing through a comparison; that integers are small
//! enough for an exact conversion to float (WGSL does not say how others round); subnormals and
//! signs of zeros; anything a compiler does to integers; whether `min` and `max` meet NaN. The order
//! of statements is not regarded, so a variable that ever holds an unguarded result always does;
//! and all elements of an array count as one.

use std::collections::BTreeSet;

use splitplane_core::kernel::{
    Access, Binding, DeviceChecks, KernelSet, RayQueries, Slot, TreeBuilder,
};
use splitplane_render::RayTracer;
use splitplane_shaders::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, LIBRARY, NEAR, POINT_BUILD, POINTS, Part, QUERIES,
    RENDER, RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, RenderFeatures, Shader,
    TriangleTest, filtered_scene_traversal, render_parts, scene_traversal,
};

use crate::source::{self, Parsed, Text, texts};
use rules::{Finding, Rule};

mod barrier;
mod flow;
mod planted;
mod rules;
mod strict;

/// Who may call free operations.
#[derive(Clone, Copy, PartialEq)]
enum Free {
    /// Kernels that trace rays: results that are widened anyway.
    Allowed,
    /// All others.
    Forbidden,
}

/// All faults of a module.
fn lint(parts: Vec<Text>, free: Free) -> Vec<Finding> {
    let parsed = Parsed::new(parts).unwrap_or_else(|error| panic!("{error}"));
    let bodies = rules::bodies(&parsed);
    let mut findings = Vec::new();
    strict::check(&parsed, &bodies, &mut findings);
    barrier::check(&parsed, &bodies, free == Free::Allowed, &mut findings);
    flow::check(&parsed, &bodies, &mut findings);
    findings.sort();
    findings
}

/// The shaders the lint applies to: those of every set.
fn linted() -> impl Iterator<Item = (&'static Shader, Free)> {
    let kernels = KERNELS.iter().map(|shader| (shader, free_in::<TreeBuilder>(shader)));
    let rebuilt = KERNEL_RETRIES.iter().map(|shader| (shader, Free::Forbidden));
    // These read nodes, but what they compute is the same everywhere.
    let compress = COMPRESS.iter().map(|shader| (shader, Free::Forbidden));
    let points = POINT_BUILD.iter().chain(POINTS).chain(NEAR);
    let points = points.map(|shader| (shader, Free::Forbidden));
    let queries = QUERIES.iter().map(|shader| (shader, free_in::<RayQueries>(shader)));
    let render = RENDER.iter().map(|shader| (shader, free_in::<RayTracer>(shader)));
    let compressed = RENDER_COMPRESSED.iter().map(|shader| (shader, Free::Allowed));
    let retries = RENDER_RETRIES.iter().map(|shader| (shader, Free::Allowed));
    // They trace nothing, but are joined with parts of what does.
    let settles = RENDER_SETTLES.iter().map(|shader| (shader, Free::Allowed));
    let checks = CHECKS.iter().map(|shader| (shader, free_in::<DeviceChecks>(shader)));
    let all = kernels
        .chain(rebuilt)
        .chain(compress)
        .chain(points)
        .chain(queries)
        .chain(render)
        .chain(compressed)
        .chain(retries)
        .chain(settles)
        .chain(checks);
    all.filter(|(shader, _)| !shader.name.ends_with("_fast"))
}

/// Only kernels that trace rays, and so read the nodes of a tree, may call free operations.
fn free_in<K: KernelSet>(shader: &Shader) -> Free {
    let own = shader.parts.last().map_or("", |part| part.name);
    let row = K::KERNELS.iter().find(|row| row.name == own).expect("a kernel of the set");
    let reads_tree = K::slots(row.kernel).any(|slot| match slot {
        Slot::Storage(Binding { buffer, access: Access::Read }) => {
            ["nodes", "compressed_nodes", "box_nodes", "shapes"].contains(&K::buffer(buffer).name)
        }
        _ => false,
    });
    if reads_tree { Free::Allowed } else { Free::Forbidden }
}

fn arithmetic() -> &'static Part {
    LIBRARY.iter().find(|part| part.name == rules::ARITHMETIC).expect("arithmetic.wgsl")
}

/// Fails with all findings, if there are any.
fn assert_clean(name: &str, findings: &[Finding]) {
    let list: String = findings.iter().map(|finding| format!("\n{finding}")).collect();
    assert!(findings.is_empty(), "{name}:{list}");
}

#[test]
fn every_shader_keeps_the_rules() {
    for (shader, free) in linted() {
        assert_clean(shader.name, &lint(texts(shader), free));
    }
}

/// What stands in where rays keep their stacks in the memory of the workgroup keeps them too.
#[test]
fn every_shader_with_the_other_stack_keeps_the_rules() {
    let mut linted_so = 0;
    for (shader, free) in linted() {
        if let Some(texts) = source::workgroup_stacks(shader) {
            assert_clean(shader.name, &lint(texts, free));
            linted_so += 1;
        }
    }
    // All lean kernels but those of accuracy `fast`.
    assert_eq!(linted_so, 16);
}

/// What stands in for what a scene does not need keeps them too.
#[test]
fn every_choice_of_features_keeps_the_rules() {
    for choice in 0..16u32 {
        let has = |bit: u32| choice & (1 << bit) != 0;
        let features = RenderFeatures {
            textures: has(0),
            smooth_normals: has(1),
            area_lights: has(2),
            dielectrics: has(3),
            ..RenderFeatures::ALL
        };
        for shader in RENDER {
            let parts = render_parts(shader.name, &features).expect("a kernel of the table");
            // The others do not depend on features.
            if ["shade", "shadow_rays", "next_paths"].contains(&shader.name) {
                let texts = parts.iter().map(Text::from).collect();
                assert_clean(shader.name, &lint(texts, free_in::<RayTracer>(shader)));
            }
        }
    }
}

/// Those of exact frames.
#[test]
fn every_exact_shader_keeps_the_rules() {
    let features = RenderFeatures { test: TriangleTest::Certain, ..RenderFeatures::ALL };
    let traced = RENDER.iter().chain(RENDER_RETRIES).filter(|shader| {
        let name = shader.name.trim_end_matches("_retry");
        ["closest_hits", "shadow_hits", "shadow_hits_through_glass"].contains(&name)
    });
    let mut linted = 0;
    for shader in traced {
        let parts = render_parts(shader.name, &features).expect("a kernel of the table");
        assert_clean(shader.name, &lint(parts.iter().map(Text::from).collect(), Free::Allowed));
        linted += 1;
    }
    assert_eq!(linted, 6);
}

/// The texts for a host's own shader that traces scenes keep them too. The options of a ray are in the memory of its invocation, so the barrier's zero is set a
/// second time from there: the first time it is from a buffer, as it has to be.
#[test]
fn a_hosts_texts_for_scenes_keep_the_rules() {
    let entry = "
fn accept_hit(hit: SceneHit) -> bool { return hit.u < 0.5; }
@group(0) @binding(0) var<storage, read_write> found: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let ray = Ray(vec3<f32>(0.0, 1.0, 2.0), 0.0, vec3<f32>(0.0, 0.0, 1.0), 1.0);
    let words = scene_hit_words(trace_scene(ray, default_scene_options(), id.x > 7u));
    found[id.x] = words[0];
}";
    let split = |text: &str| {
        let own = arithmetic();
        let (before, after) = text.split_once(own.text).expect("the arithmetic");
        let part = |name: &str, text: &str| Text { name: name.to_owned(), text: text.to_owned() };
        vec![part("before", before), own.into(), part("after", &(after.to_owned() + entry))]
    };
    let again =
        |finding: &Finding| finding.rule == Rule::Barrier && finding.function == "trace_entered";
    for text in [scene_traversal(1, 0), filtered_scene_traversal(1, 0)] {
        let (known, others): (Vec<_>, Vec<_>) =
            lint(split(&text), Free::Allowed).into_iter().partition(again);
        assert_clean("a host's text", &others);
        assert_eq!(known.len(), 1);
        let merged = text.replacen(
            "product(length, BOX_DIRECTION_LEAST)",
            "product(free_mul(length, 0.5), 0.5)",
            1,
        );
        let unset = text.replacen("opaque_zero = scene_facts.zero;", "", 1);
        for (faulty, rule) in [(merged, Rule::Merged), (unset, Rule::Barrier)] {
            assert_ne!(faulty, text);
            let found = lint(split(&faulty), Free::Allowed);
            assert!(
                found.iter().any(|finding| finding.rule == rule && !again(finding)),
                "{found:?}"
            );
        }
    }
}

/// Also while no shader uses it.
#[test]
fn the_arithmetic_keeps_the_rules() {
    assert_clean(rules::ARITHMETIC, &lint(vec![arithmetic().into()], Free::Forbidden));
}

/// The shaders with one text replaced by another; those that lack it are left out.
fn mutants(from: &str, to: &str) -> Vec<(String, Vec<Text>, Free)> {
    let mini = planted::mini_kernel();
    let shaders = linted().map(|(shader, free)| (shader.name.to_owned(), texts(shader), free));
    let mut mutants = Vec::new();
    for (name, mut parts, free) in shaders.chain([("mini".to_owned(), mini, Free::Allowed)]) {
        let mut replaced = 0;
        for part in &mut parts {
            replaced += part.text.matches(from).count();
            part.text = part.text.replace(from, to);
        }
        if replaced > 0 {
            mutants.push((name, parts, free));
        }
    }
    mutants
}

/// Without its barrier a guarded operation is reported in every shader that has it, and where its
/// results meet another operation, that is reported as well.
#[test]
fn an_operation_without_barrier_is_found_in_every_shader() {
    for (function, from, to) in [
        ("product", "return guard(a * b);", "return a * b;"),
        ("sum", "return guard(a + b);", "return a + b;"),
        ("difference", "return guard(a - b);", "return a - b;"),
    ] {
        let mutants = mutants(from, to);
        assert!(!mutants.is_empty());
        for (name, parts, free) in mutants {
            let findings = lint(parts, free);
            let found = |rule| findings.iter().any(|f: &Finding| f.rule == rule);
            assert!(
                findings.iter().any(|f| f.rule == Rule::Unguarded && f.function == function),
                "{name}: {function}"
            );
            assert!(found(Rule::Merged), "{name}: {function}");
        }
    }
}

/// Who may call free operations is as it should be.
#[test]
fn only_those_that_trace_rays_may_be_free() {
    let free = linted().filter(|(_, free)| *free == Free::Allowed);
    let names: Vec<&str> = free.map(|(shader, _)| shader.name).collect();
    assert_eq!(
        names,
        [
            "closest_hit",
            "closest_hit_retry",
            "closest_hit_exact",
            "closest_hit_retry_exact",
            "any_hit",
            "any_hit_retry",
            "any_hit_exact",
            "any_hit_retry_exact",
            "list_triangles",
            "list_triangles_retry",
            "count_crossings",
            "count_crossings_retry",
            "closest_hit_compressed",
            "any_hit_compressed",
            "enter_instances",
            "trace_instances",
            "trace_instances_retry",
            "trace_instances_masked",
            "trace_instances_retry_masked",
            "trace_shapes",
            "first_costs",
            "closest_hits",
            "shadow_hits",
            "shadow_hits_through_glass",
            "closest_hits_compressed",
            "shadow_hits_compressed",
            "shadow_hits_through_glass_compressed",
            "closest_hits_retry",
            "shadow_hits_retry",
            "shadow_hits_through_glass_retry",
            "closest_hits_settle",
        ]
    );
}

/// A free multiply-add in place of guarded operations is found in every query.
#[test]
fn a_free_multiply_add_is_found_in_every_query() {
    let (shear, limits) = (
        ("difference(away.x, product(shear.x, away.z))", "free_mul_add(-shear.x, away.z, away.x)"),
        (
            "snapped_difference(snapped_product(hi, 0.5), snapped_product(lo, 0.5))",
            "free_mul_add(hi, 0.5, snapped_product(lo, -0.5))",
        ),
    );
    let moved = ("snapped_sum(two, snapped_product(m.z, z))", "free_mul_add(m.z, z, two)");
    let stop = (
        "product(length, BOX_DIRECTION_LEAST)",
        "product(free_mul(length, 0.5), BOX_DIRECTION_LEAST)",
    );
    for shader in QUERIES.iter().filter(|shader| !shader.name.ends_with("_fast")) {
        let free = free_in::<RayQueries>(shader);
        let ((from, to), rule) = match free {
            // They prepare no ray for triangles.
            Free::Allowed if ["enter_instances", "trace_shapes"].contains(&shader.name) => {
                (stop, Rule::Merged)
            }
            Free::Allowed => (shear, Rule::Merged),
            Free::Forbidden if shader.name == "move_vertices" => (moved, Rule::Free),
            Free::Forbidden => (limits, Rule::Free),
        };
        let mut parts = texts(shader);
        let mut replaced = 0;
        for part in &mut parts {
            replaced += part.text.matches(from).count();
            part.text = part.text.replace(from, to);
        }
        assert!(replaced > 0, "{}", shader.name);
        let findings = lint(parts, free);
        assert!(findings.iter().any(|finding| finding.rule == rule), "{}", shader.name);
    }
}

/// A kernel that traces no rays may not take a free operation for a guarded one.
#[test]
fn a_free_operation_is_found_in_every_kernel() {
    for (shader, free) in linted().filter(|(_, free)| *free == Free::Forbidden) {
        let mut parts = texts(shader);
        let mut replaced = 0;
        for part in parts.iter_mut().filter(|part| part.name != rules::ARITHMETIC) {
            for guarded in ["snapped_product(", "= product("] {
                let free = if guarded.starts_with('=') { "= free_mul(" } else { "free_mul(" };
                replaced += part.text.matches(guarded).count();
                part.text = part.text.replace(guarded, free);
            }
        }
        let findings = lint(parts, free);
        let found = findings.iter().filter(|finding| finding.rule == Rule::Free).count();
        assert_eq!(found, replaced, "{}", shader.name);
    }
}

/// A barrier that a compiler sees through is none.
#[test]
fn a_barrier_of_a_known_number_is_found_in_every_shader() {
    for (name, parts, free) in mutants("bitcast<u32>(x) ^ opaque_zero", "bitcast<u32>(x) ^ 0u") {
        let found: BTreeSet<_> = lint(parts, free)
            .into_iter()
            .filter(|finding| finding.rule == Rule::Unguarded)
            .map(|finding| finding.function)
            .collect();
        assert_eq!(found, rules::GUARDED.map(str::to_owned).into(), "{name}");
    }
}

/// An entry point that forgets the zero leaves the barrier open.
#[test]
fn a_zero_that_is_not_set_is_found_in_every_shader() {
    let (statement, start) = ("opaque_zero = ", "opaque_zero = 0u * ");
    let mutants = mutants(statement, start);
    assert!(!mutants.is_empty());
    for (name, parts, free) in mutants {
        let findings = lint(parts, free);
        assert!(findings.iter().any(|finding| finding.rule == Rule::Barrier), "{name}");
    }
}

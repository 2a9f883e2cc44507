//! What naga makes of the shaders for DirectX and Metal, held to what the arithmetic rests on there.
//!
//! Metal compiles with fast math unless it is told otherwise, and HLSL has no word for a single operation that may not be
//! changed. So in both only the barrier protects a guarded operation: it must be there in the text, and nothing that
//! fast math treats in a way of its own may be: functions of `fast::`, fused operations, questions about NaN.
//!
//! With `SPLITPLANE_TRANSLATED=FOLDER` in the environment the texts are left there, and SPIR-V and WGSL too, for compilers that are
//! not part of the tests: `scripts/shader_compilers.sh`. `NAME.workgroup` is a shader with the stacks of rays in the memory of the
//! workgroup.

use std::collections::BTreeSet;
use std::path::Path;

use naga::back::{hlsl, msl, spv};
use splitplane_shaders::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, NEAR, POINT_BUILD, POINTS, QUERIES, RENDER,
    RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, Shader,
};

use crate::source::{self, Parsed, Text, texts};

fn shaders() -> impl Iterator<Item = &'static Shader> {
    [
        KERNELS,
        KERNEL_RETRIES,
        COMPRESS,
        QUERIES,
        POINT_BUILD,
        POINTS,
        NEAR,
        RENDER,
        RENDER_COMPRESSED,
        RENDER_RETRIES,
        RENDER_SETTLES,
        CHECKS,
    ]
    .into_iter()
    .flatten()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Language {
    Hlsl,
    Metal,
}

fn to_hlsl(parsed: &Parsed) -> String {
    let options = hlsl::Options { shader_model: hlsl::ShaderModel::V6_0, ..Default::default() };
    let pipeline = hlsl::PipelineOptions::default();
    let mut text = String::new();
    let mut writer = hlsl::Writer::new(&mut text, &options, &pipeline);
    let written = writer.write(&parsed.module, &parsed.info, None).expect("HLSL");
    assert!(written.entry_point_names.iter().all(Result::is_ok), "{written:?}");
    text
}

fn to_metal(parsed: &Parsed) -> String {
    let options = msl::Options { lang_version: (2, 4), ..Default::default() };
    let pipeline = msl::PipelineOptions::default();
    let (text, written) =
        msl::write_string(&parsed.module, &parsed.info, &options, &pipeline).expect("Metal");
    assert!(written.entry_point_names.iter().all(Result::is_ok));
    text
}

fn to_spirv(parsed: &Parsed) -> Vec<u32> {
    let options = spv::Options {
        lang_version: (1, 3),
        flags: spv::WriterFlags::empty(),
        ..Default::default()
    };
    spv::write_vec(&parsed.module, &parsed.info, &options, None).expect("SPIR-V")
}

/// What may not stand in a text.
const FORBIDDEN: [&str; 12] = [
    "fast::",
    "fma(",
    "mad(",
    "fmax3",
    "fmin3",
    "isnan(",
    "isinf(",
    "isfinite(",
    "INFINITY",
    "NAN",
    "rsqrt(",
    "pow(",
];

/// The helpers of naga's own that texts may have: none of them computes with floats, but those that convert.
const HELPERS: [&str; 8] = [
    "naga_abs",
    "naga_div",
    "naga_dot",
    "naga_extractBits",
    "naga_f2i32",
    "naga_f2u32",
    "naga_mod",
    "naga_neg",
];

/// The body of a function, if the text has one of this name.
fn body<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let start = text
        .match_indices(&format!("float {name}("))
        .map(|(at, _)| at)
        .find(|at| at.checked_sub(1).is_none_or(|before| text.as_bytes()[before] == b'\n'))?;
    let open = start + text[start..].find('{')?;
    Some(&text[open + 1..open + text[open..].find("\n}")?])
}

/// What is wrong with a text.
fn faults(text: &str, language: Language) -> Vec<String> {
    let mut faults = Vec::new();
    for word in FORBIDDEN {
        let whole = |at: usize| {
            let before = text[..at].chars().next_back();
            let after = text[at + word.len()..].chars().next();
            let part = |c: char| c.is_ascii_alphanumeric() || c == '_';
            // What ends in a sign of its own ends there.
            let ends = !word.ends_with(part) || !after.is_some_and(part);
            !before.is_some_and(part) && ends
        };
        if text.match_indices(word).any(|(at, _)| whole(at)) {
            faults.push(format!("`{word}` stands there"));
        }
    }
    let name_at = |at: usize| -> &str {
        let end = text[at..].find(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        &text[at..end.map_or(text.len(), |end| at + end)]
    };
    let helpers: BTreeSet<&str> = text
        .match_indices("naga_")
        .map(|(at, _)| name_at(at))
        .filter(|name| text.contains(&format!("{name}(")))
        .collect();
    let known = |name: &&str| HELPERS.iter().any(|helper| name.starts_with(helper));
    faults.extend(helpers.iter().filter(|name| !known(name)).map(|name| format!("helper {name}")));
    // The barrier, and the three operations through it.
    let barrier = match language {
        Language::Hlsl => "asfloat((asuint(x) ^ ",
        Language::Metal => "as_type<float>(as_type<uint>(x) ^ ",
    };
    let guard = body(text, "guard");
    let guarded = [("product", " * "), ("sum", " + "), ("difference", " - ")];
    if let Some(guard) = guard {
        let opaque = guard.contains("opaque_zero");
        if !opaque || !(guard.contains(barrier) || split_barrier(guard, language)) {
            faults.push(format!("the barrier is {}", guard.trim()));
        }
        if guard.matches(['*', '+']).count() > 0 {
            faults.push("the barrier computes".to_owned());
        }
    }
    for (name, operator) in guarded {
        let Some(body) = body(text, name) else { continue };
        let one = body.matches(operator).count() == 1;
        let through = body.matches("guard(").count() == 1;
        let others = [" * ", " + ", " - "].iter().filter(|o| body.contains(*o)).count() == 1;
        // The result of the call is what is returned.
        let result = body.split("guard(").next().and_then(|before| {
            before.trim_end().trim_end_matches('=').trim_end().rsplit(' ').next()
        });
        let returned = result.is_some_and(|result| body.contains(&format!("return {result};")));
        if guard.is_none() || !one || !through || !others || !returned {
            faults.push(format!("{name} is not guarded: {}", body.trim()));
        }
    }
    faults
}

/// The zero may be read into a variable first.
fn split_barrier(guard: &str, language: Language) -> bool {
    let Some((read, _)) = guard.split_once(" = opaque_zero;") else { return false };
    let Some(name) = read.rsplit(' ').next() else { return false };
    match language {
        Language::Hlsl => guard.contains(&format!("return asfloat((asuint(x) ^ {name}));")),
        Language::Metal => {
            guard.contains(&format!("return as_type<float>(as_type<uint>(x) ^ {name});"))
        }
    }
}

/// Both texts of a shader.
fn translated(parts: Vec<Text>) -> [(Language, String); 2] {
    let parsed = Parsed::new(parts).unwrap_or_else(|error| panic!("{error}"));
    [(Language::Hlsl, to_hlsl(&parsed)), (Language::Metal, to_metal(&parsed))]
}

#[test]
fn every_shader_keeps_its_barrier_in_every_language() {
    let folder = std::env::var_os("SPLITPLANE_TRANSLATED");
    let mut guarded = 0;
    let whole = shaders().map(|shader| (shader.name.to_owned(), texts(shader)));
    let other_stack = shaders().filter_map(|shader| {
        Some((format!("{}.workgroup", shader.name), source::workgroup_stacks(shader)?))
    });
    for (name, texts) in whole.chain(other_stack) {
        let source: String = texts.iter().map(|part| format!("{}\n", part.text)).collect();
        let parsed = Parsed::new(texts).unwrap_or_else(|error| panic!("{error}"));
        let spirv = to_spirv(&parsed);
        let made = [(Language::Hlsl, to_hlsl(&parsed)), (Language::Metal, to_metal(&parsed))];
        if let Some(folder) = &folder {
            let path = |ending: &str| Path::new(folder).join(format!("{name}.{ending}"));
            let words: Vec<u8> = spirv.iter().flat_map(|word| word.to_le_bytes()).collect();
            std::fs::write(path("spv"), words).expect("the folder can be written to");
            std::fs::write(path("wgsl"), source).expect("the folder can be written to");
            for (language, text) in &made {
                let ending = if *language == Language::Hlsl { "hlsl" } else { "metal" };
                std::fs::write(path(ending), text).expect("the folder can be written to");
            }
        }
        for (language, text) in made {
            let faults = faults(&text, language);
            assert!(faults.is_empty(), "{name}, {language:?}: {faults:#?}");
            guarded += usize::from(body(&text, "guard").is_some());
        }
    }
    // Some shaders compute with no floats at all; most do.
    assert!(guarded > shaders().count(), "{guarded}");
}

/// The text for a host's own shader that traces scenes, with a function of the host's.
#[test]
fn a_hosts_text_for_scenes_keeps_its_barrier_in_every_language() {
    let own = "
fn accept_hit(hit: SceneHit) -> bool { return hit.u < 0.5; }
@group(0) @binding(0) var<storage, read_write> found: array<u32>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let ray = Ray(vec3<f32>(0.0, 1.0, 2.0), 0.0, vec3<f32>(0.0, 0.0, 1.0), 1.0);
    found[id.x] = scene_closest_hit(ray, default_scene_options()).triangle;
    found[id.x + 64u] = u32(scene_any_hit(ray, default_scene_options()));
}";
    for text in [
        splitplane_shaders::scene_traversal(1, 0) + own,
        splitplane_shaders::filtered_scene_traversal(1, 0) + own,
    ] {
        let text = || vec![Text { name: "host".to_owned(), text: text.clone() }];
        assert!(!to_spirv(&Parsed::new(text()).expect("valid WGSL")).is_empty());
        for (language, text) in translated(text()) {
            assert_eq!(faults(&text, language), Vec::<String>::new(), "{language:?}");
            assert!(body(&text, "guard").is_some());
        }
    }
}

/// Each fault in a shader, or in the text itself, is found in both languages.
#[test]
fn planted_faults_are_found() {
    let arithmetic = || {
        let shader = splitplane_shaders::find("arithmetic_check").expect("the check");
        texts(shader)
    };
    let planted = |from: &str, to: &str| {
        let mut parts = arithmetic();
        let mut replaced = 0;
        for part in &mut parts {
            replaced += part.text.matches(from).count();
            part.text = part.text.replace(from, to);
        }
        assert_eq!(replaced, 1, "{from}");
        translated(parts)
    };
    for (from, to, told) in [
        ("return guard(a * b);", "return a * b;", "product is not guarded"),
        ("return guard(a + b);", "return guard(a) + b;", "sum is not guarded"),
        ("return guard(a - b);", "return guard(a - b) - b;", "difference is not guarded"),
        ("bitcast<u32>(x) ^ opaque_zero", "bitcast<u32>(x) ^ 0u", "the barrier is"),
        ("return a * b + c;", "return fma(a, b, c);", "(` stands there"),
    ] {
        // What a shader does not use is translated too.
        for (language, text) in planted(from, to) {
            let faults = faults(&text, language);
            assert!(faults.iter().any(|fault| fault.contains(told)), "{language:?}: {faults:?}");
        }
    }
    for (language, text) in translated(arithmetic()) {
        assert_eq!(faults(&text, language), Vec::<String>::new());
        for (from, to) in [("abs(", "fast::abs("), ("abs(", "isnan("), ("abs(", "pow(")] {
            let text = text.replacen(from, to, 1);
            assert!(!faults(&text, language).is_empty(), "{language:?}: {to}");
        }
    }
}

//! The shaders of the ray tracer against its records and names: what must agree for a device to do the
//! host's bidding. The same as `shaders/tests/abi.rs` holds the tree builder's to, with its modules:
//!
//! - `RENDER` are the kernels of the ray tracer in their order, and the files of the CPU's kernels.
//! - With every choice of features a kernel parses and validates with nothing that plain WebGPU lacks; it
//!   binds `frame`, `counters`, what `Kernel::bindings` says, and the tree where it traces rays.
//! - Records that cross have the size and the words of `splitplane_render::layout`.
//! - Module-scope constants have the value of the constant of the same name.

use splitplane_shaders::RENDER;

use source::{Parsed, Text, texts};

#[allow(dead_code, reason = "the other half is the tree builder's")]
#[path = "../../shaders/tests/abi/bindings.rs"]
mod bindings;
#[allow(dead_code, reason = "the other half is the tree builder's")]
#[path = "../../shaders/tests/abi/constants.rs"]
mod constants;
#[allow(dead_code, reason = "the other half is the tree builder's")]
#[path = "../../shaders/tests/abi/names.rs"]
mod names;
#[allow(dead_code, reason = "the other half is the tree builder's")]
#[macro_use]
#[path = "../../shaders/tests/abi/records.rs"]
mod records;
#[path = "abi/render.rs"]
mod render;
#[allow(dead_code, reason = "the other half is the lint's")]
#[path = "../../shaders/tests/support/source.rs"]
mod source;

fn parse(parts: Vec<Text>) -> Parsed {
    Parsed::new(parts).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn kernels_of_the_ray_tracer_have_the_names_of_their_files() {
    let in_table: Vec<_> = RENDER.iter().map(|shader| shader.name).collect();
    let in_rust: Vec<_> =
        splitplane_render::kernel::Kernel::ALL.iter().map(|kernel| kernel.name()).collect();
    assert_eq!(in_table, in_rust);
    let cpu = names::files("src/cpu/kernels", ".rs");
    // The CPU asks its accelerator for closest hits.
    let cpu = cpu.iter().map(String::as_str).filter(|name| *name != "mod").chain(["closest_hits"]);
    assert_eq!(names::differences("cpu", in_rust.iter().copied(), cpu), [""; 0]);
}

/// With every choice of features: what a scene does not need may be missing, and nothing else.
#[test]
fn kernels_of_the_ray_tracer_agree_with_it() {
    let known = render::known();
    let variants = render::variants();
    assert!(variants.len() > RENDER.len() + 20, "only {} variants", variants.len());
    let mut all = Vec::new();
    for (kernel, parts) in variants {
        let parsed = parse(parts.clone());
        let mut faults = bindings::limit_faults(&parsed);
        faults.extend(render::binding_faults(&parsed, kernel));
        faults.extend(render::record_faults(&parsed));
        faults.extend(constants::faults(&parsed, &parts, &known));
        all.extend(faults.into_iter().map(|fault| format!("{kernel:?}: {fault}")));
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

/// Each replacement in a kernel of the ray tracer brings a fault that says this.
#[test]
fn faults_of_the_ray_tracers_kernels_are_found() {
    use splitplane_render::kernel::Kernel as K;
    let known = render::known();
    for (kernel, from, to, words) in [
        (K::Accumulate, "read_write> radiance", "read> radiance", "radiance is Storage"),
        (K::Accumulate, "@binding(5)", "@binding(7)", "in place of shadow_light at 5"),
        (K::ClosestHits, "nodes: array<vec2<u32>>", "nodes: array<u32>", "nodes has another type"),
        (K::ClosestHits, "scene: Scene", "scene: Hit", "scene has another type"),
        (K::Shade, "hits: array<vec4<u32>>", "hits: array<vec2<u32>>", "hits has another type"),
        (K::ScanSpawned, "read_write> counters", "read> counters", "counters is Storage"),
        (K::Shade, "    offset: f32,\n    geometric", "    geometric", "Surface: member `offset`"),
        (K::CameraRays, "    step_y: vec3<f32>,\n    samples", "    samples", "Frame: member"),
        (K::NextPaths, "SURFACE_REFRACTS: u32 = 2u", "SURFACE_REFRACTS: u32 = 3u", "constant"),
        (K::BeginWave, "COUNTER_WAVE: u32 = 3u", "COUNTER_WAVE: u32 = 2u", "constant COUNTER_WAVE"),
        (K::Shade, "ONE_OVER_PI: f32 = 0.318", "ONE_OVER_PI: f32 = 0.319", "constant ONE_OVER_PI"),
    ] {
        let shader = RENDER.iter().find(|shader| shader.name == kernel.name()).expect("a kernel");
        let mut parts = texts(shader);
        let mut replaced = 0;
        for part in &mut parts {
            replaced += part.text.matches(from).count();
            part.text = part.text.replacen(from, to, 1);
        }
        assert!(replaced > 0, "{from}");
        // What no longer validates is found sooner.
        let Ok(parsed) = Parsed::new(parts.clone()) else { continue };
        let mut faults = render::binding_faults(&parsed, kernel);
        faults.extend(render::record_faults(&parsed));
        faults.extend(constants::faults(&parsed, &parts, &known));
        assert!(faults.iter().any(|fault| fault.contains(words)), "{from}: {faults:?}");
    }
}

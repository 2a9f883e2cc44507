//! The shaders against the core: what must agree for a device to do the host's bidding.
//!
//! - Every shader parses and validates with nothing that plain WebGPU lacks, has one compute entry
//!   point `main`, binds group 0 only, and keeps to WebGPU's default limits: 8 storage buffers, 256
//!   invocations a workgroup, 16,384 bytes of workgroup memory.
//! - `KERNELS` are the kernels of the core in their order, the files of `kernels/`, and the files of
//!   the CPU's kernels. Every file of `lib/` is in `LIBRARY`, every file of `queries/` in `QUERIES`.
//! - A kernel binds `parameters`, `counters`, then what `Kernel::storage_bindings` says, with its
//!   name, access and element size.
//! - Records that cross have the core's size and words (see `abi/records.rs` for what may differ).
//! - Module-scope constants have the value of the core's constant of the same name, or stand on a
//!   list with a reason. All have a type; naga would drop them otherwise, and this test miss them.
//! - Each kernel and query begins with a comment that says what one invocation or workgroup does,
//!   what is read and what is written.
//!
//! The kernels of the ray tracer are held against `splitplane_render` by that package's own tests, with the
//! modules of this one.
//!
//! Not checked: bindings and records of queries, other than `Ray` and `Hit`, which are between the
//! shaders and the backend that binds them; that the ways words are packed in `ChunkState` agree;
//! literals inside functions; whether a header is true; whether a kernel that chooses says how it
//! breaks ties.

use std::collections::BTreeSet;

use splitplane_core::kernel::{Counter, Kernel};
use splitplane_core::layout::Counters;
use splitplane_shaders::{KERNELS, LIBRARY, QUERIES, RENDER, Shader};

use constants::Number;
use source::{Parsed, Text, texts};

#[path = "abi/bindings.rs"]
mod bindings;
#[path = "abi/constants.rs"]
mod constants;
#[path = "abi/names.rs"]
mod names;
#[path = "abi/planted.rs"]
mod planted;
#[macro_use]
#[path = "abi/records.rs"]
mod records;
#[path = "support/source.rs"]
mod source;

fn parse(parts: Vec<Text>) -> Parsed {
    Parsed::new(parts).unwrap_or_else(|error| panic!("{error}"))
}

/// Collects the faults of each shader and fails with all of them.
fn assert_none(shaders: &[Shader], faults: impl Fn(&Shader) -> Vec<String>) {
    let all: Vec<String> = shaders
        .iter()
        .flat_map(|shader| {
            faults(shader).into_iter().map(|fault| format!("{}: {fault}", shader.name))
        })
        .collect();
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

#[test]
fn every_shader_is_valid_within_the_limits_of_webgpu() {
    for table in [KERNELS, QUERIES] {
        assert_none(table, |shader| match Parsed::new(texts(shader)) {
            Ok(parsed) => bindings::limit_faults(&parsed),
            Err(error) => vec![error],
        });
    }
}

#[test]
fn kernels_have_the_names_of_the_core_and_of_their_files() {
    let in_table: Vec<_> = KERNELS.iter().map(|shader| shader.name).collect();
    let in_core: Vec<_> = Kernel::ALL.iter().map(|kernel| kernel.name()).collect();
    assert_eq!(in_table, in_core);
    let files = names::files("kernels", ".wgsl");
    let mut cpu = names::files("../backend-cpu/src/kernels", ".rs");
    cpu.remove("mod");
    for (what, files) in [("kernels/", files), ("backend-cpu", cpu)] {
        let files: Vec<_> = files.iter().map(String::as_str).collect();
        assert_eq!(names::differences(what, in_core.iter().copied(), files), [""; 0]);
    }
}

#[test]
fn tables_hold_every_file() {
    let library: BTreeSet<_> = LIBRARY.iter().map(|part| part.name.to_owned()).collect();
    assert_eq!(library, names::files("lib", ".wgsl"));
    assert_eq!(names::own_files(KERNELS), names::files("kernels", ".wgsl"));
    assert_eq!(names::own_files(QUERIES), names::files("queries", ".wgsl"));
    assert_eq!(names::own_files(RENDER), names::files("render", ".wgsl"));
}

#[test]
fn kernels_bind_what_the_core_says() {
    assert_none(KERNELS, |shader| {
        let kernel = Kernel::ALL.into_iter().find(|kernel| kernel.name() == shader.name);
        kernel.map_or_else(
            || vec!["no such kernel".to_owned()],
            |kernel| bindings::binding_faults(&parse(texts(shader)), kernel),
        )
    });
}

#[test]
fn records_have_the_layout_of_the_core() {
    assert_none(KERNELS, |shader| records::faults(&parse(texts(shader)), true));
    assert_none(QUERIES, |shader| records::faults(&parse(texts(shader)), false));
}

#[test]
fn constants_have_the_values_of_the_core() {
    let known = constants::of_core();
    assert_eq!(constants::needless(&known), [""; 0]);
    for table in [KERNELS, QUERIES] {
        assert_none(table, |shader| {
            let parts = texts(shader);
            constants::faults(&parse(parts.clone()), &parts, &known)
        });
    }
}

/// What the scanner reads in the text is what the compiler reads.
#[test]
fn the_scanner_reads_the_core() {
    use splitplane_core::{config, intersect, layout, node, sah};
    let known = constants::of_core();
    let float = |x: f32| Number::F32(x.to_bits());
    for (name, number) in [
        ("CHUNK", Number::U32(config::CHUNK)),
        ("MAX_SMALL", Number::U32(config::MAX_SMALL)),
        ("PLANE_SLACK", float(intersect::PLANE_SLACK)),
        ("STOP_SLACK", float(intersect::STOP_SLACK)),
        ("COORDINATE_MOST", float(intersect::COORDINATE_MOST)),
        ("OUTWARD", float(2f32.powi(-20))),
        ("LEAST_EXPONENT", Number::I32(sah::LEAST_EXPONENT)),
        ("TRANSFER", Number::U32(layout::Decision::TRANSFER)),
        ("TOP_NODE_EMPTY", Number::U32(layout::TopNode::EMPTY)),
        ("KD_NODE_MAX_INDEX", Number::U32(node::KdNode::MAX_INDEX)),
        ("AXIS_Z", Number::U32(node::Axis::Z as u32)),
        ("COUNTER_TRIANGLES", Number::U32(Counter::Triangles as u32)),
        ("COUNTER_ACTIVE_NODES", Number::U32(Counter::ActiveNodes as u32)),
        ("COUNTER_OVERFLOW", Number::U32(Counter::Overflow as u32)),
    ] {
        assert_eq!(known.get(name), Some(&BTreeSet::from([number])), "{name}");
    }
    let counters = known.keys().filter(|name| name.starts_with("COUNTER_")).count();
    assert_eq!(counters, Counters::default().words.len());
}

#[test]
fn every_kernel_says_what_it_does() {
    for table in [KERNELS, QUERIES, RENDER] {
        assert_none(table, |shader| {
            let own = shader.parts.last().map_or("", |part| part.text);
            names::header_faults(own)
        });
    }
}

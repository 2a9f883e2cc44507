//! The shaders against the core: what must agree for a device to do the host's bidding.
//!
//! - Every shader parses and validates with nothing that plain WebGPU lacks, has one compute entry
//!   point `main`, binds group 0 only, and keeps to WebGPU's default limits: 8 storage buffers, 256
//!   invocations a workgroup, 16,384 bytes of workgroup memory.
//! - `KERNELS` are the kernels of the core in their order, the files of `kernels/`, and the files of
//!   the CPU's kernels. Every file of `lib/` is in `LIBRARY`, every file of `queries/` in `QUERIES`.
//! - A kernel binds what the table of its set says (`KernelSet::slots`), with its name, access and
//!   element size; it reads what it is said to read and writes what it is said to write; where a grid
//!   counts invocations, workgroups are as wide as it says. That holds for seven sets: the tree
//!   builder, the node compressor, the builder of trees of points, the queries to rays and to points, the self-test, and the ray tracer of `splitplane_render` with every choice of features.
//! - The tables themselves are in order, and ARCHITECTURE.md says the same.
//! - Records that cross have the core's size and words (see `abi/records.rs` for what may differ).
//! - Module-scope constants have the value of the core's constant of the same name, or stand on a
//!   list with a reason. All have a type; naga would drop them otherwise, and this test miss them.
//! - Each kernel and query begins with a comment that says what one invocation or workgroup does,
//!   what is read and what is written.
//!
//! Not checked: that the ways words are packed in `ChunkState` agree; literals inside functions; whether
//! a header is true; whether a kernel that chooses says how it breaks ties.

use std::collections::BTreeSet;

use splitplane_core::build::reference::kernels::is_of_middle_stage;
use splitplane_core::kernel::{
    Counter, DeviceChecks, Kernel, KernelSet, NearQueries, NodeCompressor, PointBuilder,
    PointQueries, QueryKernel, RayQueries, TreeBuilder,
};
use splitplane_core::layout::Counters;
use splitplane_render::RayTracer;
use splitplane_shaders::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, LIBRARY, NEAR, POINT_BUILD, POINTS, QUERIES, RENDER,
    RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, Shader, TriangleTest, continue_lists, join,
    kernel_retry, parts_by_halves, query,
};

use crate::source::{self, Parsed, Text};
use constants::Number;
use sets::Shaders;

mod architecture;
mod bindings;
mod constants;
mod names;
mod planted;
mod planted_sets;
#[macro_use]
mod records;
mod render;
mod sets;
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

/// All texts of a set, held to its table.
fn assert_agrees<S: Shaders>() {
    assert_eq!(sets::table_faults::<S>(), [""; 0]);
    let mut own = names::own_files(S::TABLE);
    S::RETRIES.iter().for_each(|table| own.extend(names::own_files(table)));
    assert_eq!(own, names::files(S::FOLDER, ".wgsl"));
    let known = S::known();
    let mut missing: Vec<&str> = S::KERNELS.iter().map(|row| row.name).collect();
    let mut all = Vec::new();
    for (kernel, parts) in S::texts() {
        let name = S::kernel(kernel).name;
        missing.retain(|other| *other != name);
        let faults = sets::faults::<S>(&parts, kernel, &known);
        all.extend(faults.into_iter().map(|fault| format!("{name}: {fault}")));
    }
    assert!(all.is_empty(), "\n{}", all.join("\n"));
    assert_eq!(missing, [""; 0], "without a shader");
}

#[test]
fn the_tree_builder_agrees_with_its_table() {
    assert_agrees::<TreeBuilder>();
}

/// A kernel and what finishes its work use all their buffers between them.
#[test]
fn kernels_and_what_finishes_them_use_all_their_buffers() {
    let mut shared = 0;
    for kernel in Kernel::ALL {
        let Some(retry) = kernel_retry(kernel.name()) else { continue };
        let bound: Vec<_> = TreeBuilder::slots(kernel).collect();
        let [own, other] = [&KERNELS[kernel as usize], retry].map(|shader| {
            bindings::use_faults::<TreeBuilder>(&parse(source::texts(shader)), &bound, true)
        });
        let both: Vec<_> = own.iter().filter(|fault| other.contains(fault)).collect();
        assert_eq!(both, [""; 0], "{kernel:?}");
        shared += usize::from(!own.is_empty());
    }
    assert!(shared >= 2, "{shared}");
}

#[test]
fn the_node_compressor_agrees_with_its_table() {
    assert_agrees::<NodeCompressor>();
}

#[test]
fn the_point_builder_agrees_with_its_table() {
    assert_agrees::<PointBuilder>();
}

#[test]
fn the_queries_to_points_agree_with_their_table() {
    assert_agrees::<PointQueries>();
}

#[test]
fn the_queries_for_what_is_near_agree_with_their_table() {
    assert_agrees::<NearQueries>();
}

#[test]
fn the_queries_agree_with_their_table() {
    assert_agrees::<RayQueries>();
}

/// Shaders whose rays keep their stacks in the memory of the workgroup keep to the limits of it too.
#[test]
fn the_other_stack_keeps_to_the_limits() {
    let mut checked = 0;
    for shader in QUERIES.iter().chain(RENDER).chain(RENDER_COMPRESSED) {
        if let Some(texts) = source::workgroup_stacks(shader) {
            assert_eq!(bindings::limit_faults(&parse(texts)), [""; 0], "{}", shader.name);
            checked += 1;
        }
    }
    assert_eq!(checked, 18);
}

/// Texts whose lists go on in second bindings are valid, and keep to the limits. What is bound to them, a test of
/// `splitplane_wgpu` compares.
#[test]
fn lists_go_on_in_second_bindings() {
    let mut continued = 0;
    // By halves there is no middle stage.
    let middle: Vec<_> = Kernel::ALL
        .into_iter()
        .filter(|&kernel| is_of_middle_stage(kernel))
        .map(Kernel::name)
        .collect();
    // Scenes of many objects that need halves are answered through their geometries' own trees.
    let whole = |name: &str| middle.contains(&name) || name.starts_with("trace_instances");
    let shaders = KERNELS.iter().chain(COMPRESS).chain(QUERIES).chain(NEAR);
    for shader in shaders.filter(|shader| !whole(shader.name)) {
        let source = join(&parts_by_halves(shader));
        let lists: &[&str] = match shader.name {
            "scatter_references" => &["triangles"],
            _ => &["input", "triangles", "references"],
        };
        let declared = |name: &&&str| source.contains(&format!("> {name}: array<"));
        let lists: Vec<&str> = lists.iter().filter(declared).copied().collect();
        let text = continue_lists(&source, &lists, 16).expect("declared lists");
        let parsed = parse(vec![Text { name: shader.name.into(), text }]);
        assert_eq!(bindings::limit_faults(&parsed), [""; 0], "{}", shader.name);
        for list in &lists {
            let names =
                parsed.module.global_variables.iter().filter_map(|(_, v)| v.name.as_deref());
            assert_eq!(names.filter(|name| name.strip_prefix("more_") == Some(list)).count(), 1);
            continued += 1;
        }
    }
    assert!(continued >= 20, "only {continued}");
}

#[test]
fn the_self_test_agrees_with_its_table() {
    assert_agrees::<DeviceChecks>();
}

#[test]
fn the_ray_tracer_agrees_with_its_table() {
    let variants = RayTracer::texts().len();
    assert!(variants > RENDER.len() + 20, "only {variants} variants");
    assert_agrees::<RayTracer>();
}

#[test]
fn kernels_have_the_names_of_the_core_and_of_their_files() {
    let in_table: Vec<_> = KERNELS.iter().map(|shader| shader.name).collect();
    let in_core: Vec<_> = Kernel::ALL.iter().map(|kernel| kernel.name()).collect();
    assert_eq!(in_table, in_core);
    let mut files = names::files("kernels", ".wgsl");
    KERNEL_RETRIES.iter().for_each(|retry| assert!(files.remove(retry.name), "{}", retry.name));
    let mut cpu = names::files("../backend-cpu/src/build/twin/kernels", ".rs");
    cpu.remove("mod");
    for (what, files) in [("kernels/", files), ("backend-cpu", cpu)] {
        let files: Vec<_> = files.iter().map(String::as_str).collect();
        assert_eq!(names::differences(what, in_core.iter().copied(), files), [""; 0]);
    }
}

#[test]
fn the_library_holds_every_file() {
    let library: BTreeSet<_> = LIBRARY.iter().map(|part| part.name.to_owned()).collect();
    assert_eq!(library, names::files("lib", ".wgsl"));
}

#[test]
fn lists_of_constants_have_nothing_needless() {
    assert_eq!(constants::needless(&constants::of_core()), [""; 0]);
}

/// What the scanner reads in the text is what the compiler reads.
#[test]
fn the_scanner_reads_the_core() {
    use splitplane_core::query::intersect;
    use splitplane_core::tree::node;
    use splitplane_core::{config, layout, sah};
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
    assert_eq!(counters, Counter::ALL.len());
    assert!(counters <= Counters::default().words.len());
}

#[test]
fn every_kernel_says_what_it_does() {
    for table in [
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
    ] {
        assert_none(table, |shader| {
            let own = shader.parts.last().map_or("", |part| part.text);
            names::header_faults(own)
        });
    }
}

#[test]
fn queries_have_the_names_of_their_files() {
    // Those that go through compressed nodes bind these, and have the text of the others, as those that ask masks have.
    let file = |kernel: QueryKernel| {
        kernel.name().trim_end_matches("_compressed").trim_end_matches("_masked").to_owned()
    };
    assert_eq!(names::own_files(QUERIES), QueryKernel::ALL.into_iter().map(file).collect());
    for shader in QUERIES {
        let kernel = sets::kernel_of::<RayQueries>(shader).name();
        assert!(shader.name.starts_with(kernel), "{} is a text of {kernel}", shader.name);
    }
    for kernel in QueryKernel::ALL {
        assert!(query(kernel.name(), TriangleTest::Watertight).is_some(), "{kernel:?}");
    }
}

#[test]
fn kernels_of_the_ray_tracer_have_the_names_of_their_files() {
    let in_table: Vec<_> = RENDER.iter().map(|shader| shader.name).collect();
    let in_rust: Vec<_> =
        splitplane_render::kernel::Kernel::ALL.iter().map(|kernel| kernel.name()).collect();
    assert_eq!(in_table, in_rust);
    let cpu = names::files("../render/src/cpu/kernels", ".rs");
    // The CPU asks its accelerator for closest hits.
    let cpu = cpu.iter().map(String::as_str).filter(|name| *name != "mod").chain(["closest_hits"]);
    assert_eq!(names::differences("cpu", in_rust.iter().copied(), cpu), [""; 0]);
}

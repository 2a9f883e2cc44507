//! Small shaders with one fault each: every check fails where it must.

use splitplane_core::kernel::{Kernel, TreeBuilder};

use super::constants::{self, Known};
use super::names::{differences, header_faults};
use super::{parse, records, sets};
use crate::source::Text;

/// A faultless `node_bounds`, without what it does.
const KERNEL: &str = "
struct Parameters {
    zero: u32, swapped: u32, first: u32, count: u32,
    traversal_cost: u32, intersection_cost: u32, block_width: u32, small_node_limit: u32,
    hand_over_limit: u32, empty_cutoff: u32, max_depth: u32, reference_cap: u32, node_cap: u32,
    first_index: u32, chunk_room: u32, node_room: u32, reference_room: u32,
    small_root_room: u32, small_reference_room: u32, top_node_room: u32, level_room: u32,
    tree_node_room: u32, leaf_reference_room: u32, subtree_room: u32,
    middle_reference_room: u32, middle_node_room: u32, middle_leaf_room: u32, bins: u32,
    clip: u32, view: u32, reference_half: u32, small_reference_half: u32,
}
struct LargeNode {
    lo: vec3<f32>, first: u32, hi: vec3<f32>, count: u32,
    node: u32, depth: u32, source: u32, source_chunks: u32,
    side: u32, inseparable: u32, first_chunk: u32, padding: u32,
}
struct Chunk { node: u32, first: u32, count: u32, span_sides: u32 }
@group(0) @binding(0) var<uniform> parameters: Parameters;
@group(0) @binding(1) var<storage, read> counters: array<u32, 32>;
@group(0) @binding(2) var<storage, read> active_nodes: array<LargeNode>;
@group(0) @binding(3) var<storage, read> chunk_state: array<u32>;
@group(0) @binding(4) var<storage, read_write> chunks: array<Chunk>;
@group(0) @binding(5) var<storage, read_write> node_bounds: array<f32>;
var<workgroup> lanes: array<vec4<u32>, 256>;
const CHUNK: u32 = 256u;
const LANES: u32 = 256u;
const OUTWARD: f32 = 0x1p-20f;
@compute @workgroup_size(LANES)
fn main() { lanes[0] = vec4(0u); }
";

fn texts(text: &str) -> Vec<Text> {
    vec![Text { name: "planted".to_owned(), text: text.to_owned() }]
}

/// All faults of a module taken for `node_bounds`.
fn faults(text: &str) -> Vec<String> {
    let known = constants::of_core();
    // The model does nothing, so it does not use what it binds.
    let mut faults = sets::faults::<TreeBuilder>(&texts(text), Kernel::NodeBounds, &known);
    faults.retain(|fault| !fault.contains("though declared"));
    faults
}

#[test]
fn the_model_has_no_fault() {
    assert_eq!(faults(KERNEL), [""; 0]);
}

/// Each replacement brings a fault that says this.
#[test]
fn every_fault_is_found() {
    for (from, to, words) in [
        // Bindings.
        ("var<storage, read> counters", "var<storage, read_write> counters", "counters is Storage"),
        ("counters: array<u32, 32>", "counters: array<u32, 31>", "counters has another type"),
        ("counters: array<u32, 32>", "counters: array<f32, 32>", "counters has another type"),
        ("var<uniform> parameters", "var<storage> parameters", "parameters is Storage"),
        ("@binding(5)", "@binding(6)", "node_bounds at 6 in place of node_bounds at 5"),
        ("read_write> chunks", "read> chunks", "chunks is Storage"),
        ("read> active_nodes", "read_write> active_nodes", "active_nodes is Storage"),
        ("chunks: array<Chunk>", "chunks: array<vec2<u32>>", "chunks has another type"),
        ("state: array<u32>", "state: array<vec4<u32>>", "chunk_state has another type"),
        ("@group(0) @binding(4)", "@group(1) @binding(4)", "chunks is not in group 0"),
        (
            "@group(0) @binding(4) var<storage, read_write> chunks: array<Chunk>",
            "var<private> chunks: Chunk",
            "node_bounds is not bound",
        ),
        (
            "var<workgroup> lanes",
            "@group(0) @binding(6) var<storage> more: array<u32>; var<workgroup> lanes",
            "more is bound besides",
        ),
        // Limits.
        ("array<vec4<u32>, 256>", "array<vec4<u32>, 1025>", "16400 bytes of workgroup memory"),
        ("@workgroup_size(LANES)", "@workgroup_size(LANES, 2)", "workgroups of [256, 2, 1]"),
        ("@workgroup_size(LANES)", "@workgroup_size(2, 1, 128)", "workgroups of [2, 1, 128]"),
        ("fn main()", "fn start()", "entry point start"),
        ("@compute @workgroup_size(LANES)", "", "0 entry points"),
        // Records.
        (
            "first: u32, count: u32, span_sides: u32",
            "count: u32, first: u32, span_sides: u32",
            "`first`",
        ),
        ("{ node: u32, first: u32", "{ first: u32, node: u32", "Chunk: member `node` differs"),
        ("hi: vec3<f32>", "upper: vec3<f32>", "LargeNode: member `hi` differs"),
        ("hi: vec3<f32>", "hi: vec3<u32>", "LargeNode: member `hi` differs"),
        ("count: u32, span_sides", "count: i32, span_sides", "Chunk: member `count` differs"),
        ("span_sides: u32 }", "span_sides: u32, more: u32 }", "Chunk: 20 bytes instead of 16"),
        (
            "span_sides: u32 }",
            "span_sides: u32, more: u32 }",
            "Chunk: a member that the record lacks",
        ),
        ("tree_node_room: u32, ", "", "Parameters: member `tree_node_room` differs"),
        (
            "reference_half: u32, small_reference_half: u32,",
            "",
            "Parameters: 120 bytes instead of 128",
        ),
        ("struct Chunk {", "alias Chunk = Chink; struct Chink {", "Chink: no record of the core"),
        // Constants.
        ("CHUNK: u32 = 256u", "CHUNK: u32 = 128u", "constant CHUNK is Some(U32(128))"),
        ("CHUNK: u32 = 256u", "CHUNK: i32 = 256", "constant CHUNK is Some(I32(256))"),
        ("CHUNK: u32 = 256u", "CHUNK = 256", "constant CHUNK of planted.wgsl has no type"),
        ("OUTWARD: f32 = 0x1p-20f", "OUTWARD: f32 = 0x1.000002p-20f", "constant OUTWARD is"),
        ("const OUTWARD", "const INWARD", "constant INWARD is not the core's"),
        ("const OUTWARD", "override OUTWARD", "an override"),
        ("@workgroup_size(LANES)", "@workgroup_size(16, 8)", "constant LANES is"),
    ] {
        assert!(KERNEL.contains(from), "{from}");
        let found = faults(&KERNEL.replacen(from, to, 1));
        assert!(found.iter().any(|fault| fault.contains(words)), "{from} -> {to}: {found:?}");
    }
}

/// The order of bindings, when two of them change places.
#[test]
fn bindings_in_another_order_are_found() {
    let text = KERNEL
        .replace("@binding(2)", "@binding(9)")
        .replace("@binding(3)", "@binding(2)")
        .replace("@binding(9)", "@binding(3)");
    let found = faults(&text);
    let fault = "chunk_state at 2 in place of active_nodes at 2";
    assert!(found.iter().any(|found| found == fault), "{found:?}");
}

/// What only looks different.
#[test]
fn near_misses() {
    for (from, to) in [
        ("first_chunk: u32, padding: u32", "@size(8) first_chunk: u32"),
        ("hi: vec3<f32>", "hi_x: f32, hi_y: f32, hi_z: f32"),
        ("chunks: array<Chunk>", "chunks: array<u32>"),
        ("array<vec4<u32>, 256>", "array<vec4<u32>, 1024>"),
        // It does not cross, so its name is its own.
        ("struct Chunk {", "struct Sides { masks: vec4<u32> } struct Chunk {"),
        ("var<workgroup>", "var<private> x: array<f32, 3>; var<workgroup>"),
    ] {
        assert!(KERNEL.contains(from), "{from}");
        assert_eq!(faults(&KERNEL.replacen(from, to, 1)), [""; 0], "{from} -> {to}");
    }
}

/// A twin of a record agrees also where it does not cross.
#[test]
fn layout_wgsl_is_held_to_the_core() {
    let mut parts = texts(KERNEL);
    let text = "struct TopNode { kind: u32, split: f32, left: u32, right: u32 }";
    parts.push(Text { name: "layout".to_owned(), text: text.to_owned() });
    let found = records::faults(&parse(parts), &records::of_core(), "layout");
    assert!(matches!(&found[..], [fault] if fault.contains("`split`")), "{found:?}");
}

#[test]
fn more_than_eight_storage_buffers_are_found() {
    let more: String = (6..10)
        .map(|i| format!("@group(0) @binding({i}) var<storage> more_{i}: array<u32>;\n"))
        .collect();
    let found = faults(&format!("{KERNEL}{more}"));
    assert!(found.iter().any(|fault| fault == "9 storage buffers"), "{found:?}");
}

/// A name that stands for two numbers serves neither.
#[test]
fn the_scanner_reads_what_it_should() {
    let mut known = Known::new();
    constants::scan(
        "pub const ONE: f32 = 1.5e-3; // a comment\nconst TWO: u32 = (1 << 30) - 1;\n\
         impl Some {\n    pub const TWO: u32 = 0x1_0;\n}\n\
         pub enum Many {\n    /// First.\n    AtFirst = 4,\n    Then,\n}\n\
         #[cfg(test)]\nconst ONE: f32 = 2.0;\n",
        &mut known,
    );
    use constants::Number::{F32, U32};
    let list: Vec<_> =
        known.iter().map(|(name, n)| (&name[..], n.iter().copied().collect())).collect();
    let expected: Vec<(&str, Vec<_>)> = vec![
        ("MANY_AT_FIRST", vec![U32(4)]),
        ("MANY_THEN", vec![U32(5)]),
        ("ONE", vec![F32(1.5e-3f32.to_bits())]),
        ("SOME_TWO", vec![U32(16)]),
        ("TWO", vec![U32(16), U32((1 << 30) - 1)]),
    ];
    assert_eq!(list, expected);
}

#[test]
fn names_that_differ_are_found() {
    assert_eq!(differences("x", ["a", "b"], ["b", "c"]), ["x: a", "x: c"]);
}

#[test]
fn missing_headers_are_found() {
    let header = "// Does.\n// One invocation a thing.\n// Reads: a.\n// Writes: b.\n\nfn f() {}\n";
    assert_eq!(header_faults(header), [""; 0]);
    for start in ["// One ", "// Reads:", "// Writes:"] {
        let found = header_faults(&header.replace(start, "// Else "));
        assert_eq!(found, [format!("no line `{start}` in the header")]);
    }
    // Not in the first comment.
    assert_eq!(header_faults(&format!("fn g() {{}}\n{header}")).len(), 3);
}

//! The table of kernels in ARCHITECTURE.md says what the tree builder's declares.

use std::path::Path;

use splitplane_core::kernel::{Access, Grid, Kernel, KernelSet, TreeBuilder};

use super::constants::snake;

/// What the line of the table before the first kernel is.
const HEAD: [&str; 2] = ["| kernel | grid | reads | writes |", "|---|---|---|---|"];

/// The line of a kernel.
fn line(kernel: Kernel) -> String {
    let words = |counter| snake(&format!("{counter:?}")).replace('_', " ");
    let grid = match kernel.grid() {
        Grid::One => "one".to_owned(),
        Grid::Each(counter) => words(counter),
        Grid::Invocations(counter, width) => format!("{}, {width} a workgroup", words(counter)),
        Grid::Few(counter, width) => {
            format!("{}, {width} a workgroup or more", words(counter))
        }
    };
    let list = |wanted: fn(Access) -> bool| {
        let named = kernel.bindings().filter(|binding| wanted(binding.access));
        named.map(|binding| format!("`{:?}`", binding.buffer)).collect::<Vec<_>>().join(", ")
    };
    let reads = list(|access| matches!(access, Access::Read | Access::ReadWrite));
    let writes = list(|access| access != Access::Read);
    format!("| `{}` | {grid} | {reads} | {writes} |", kernel.name())
}

/// The lines of the table in a document, one a kernel.
fn lines(document: &str) -> Vec<&str> {
    let mut lines = document.lines().skip_while(|line| *line != HEAD[0]);
    assert_eq!([lines.next(), lines.next()], HEAD.map(Some), "the table's head");
    lines.take_while(|line| line.starts_with('|')).collect()
}

#[test]
fn the_document_has_the_table_of_the_tree_builder() {
    let path =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders")).join("../ARCHITECTURE.md");
    let document = std::fs::read_to_string(path).expect("ARCHITECTURE.md");
    let wanted: Vec<String> = TreeBuilder::KERNELS.iter().map(|row| line(row.kernel)).collect();
    assert_eq!(lines(&document), wanted, "as it should be:\n{}", wanted.join("\n"));
}

/// A line that says something else, or that is missing, is seen.
#[test]
fn a_stale_table_is_seen() {
    let wanted: Vec<String> = TreeBuilder::KERNELS.iter().map(|row| line(row.kernel)).collect();
    let document = |lines: &[String]| format!("x\n{}\n{}\n\ny", HEAD.join("\n"), lines.join("\n"));
    assert_eq!(lines(&document(&wanted)), wanted);
    for (from, to) in
        [("`NodeBounds`", "`Chunks`"), ("| one |", "| chunks |"), ("emit_top", "emit")]
    {
        let mut stale = wanted.clone();
        let line = stale.iter_mut().find(|line| line.contains(from)).expect("such a line");
        *line = line.replace(from, to);
        assert_ne!(lines(&document(&stale)), wanted, "{from}");
    }
    assert_ne!(lines(&document(&wanted[1..])), wanted);
}

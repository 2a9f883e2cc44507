//! The canonical text of a tree, for snapshots and for people.

use crate::config::{Stages, Sweep};
use crate::tree::KdTreeView;
use crate::tree::node::NodeKind;
use crate::tree::stats::TreeStats;
use alloc::string::String;
use core::fmt::{self, Write};

/// The tree as text: a header with configuration, bounds, counts and digest, then one line per node
/// in preorder, indented by depth; floats as decimal and as bits. At most `most_nodes` nodes; a
/// last line says how many were left out.
pub fn dump(tree: &KdTreeView<'_>, most_nodes: usize) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_dump(&mut out, tree, most_nodes);
    out
}

fn write_dump(out: &mut String, tree: &KdTreeView<'_>, most_nodes: usize) -> fmt::Result {
    let stats = TreeStats::of(tree);
    let config = &tree.config;
    writeln!(out, "digest {}", tree.digest())?;
    write!(
        out,
        "preset {} K_T {} K_I {} W {}",
        config.preset().name(),
        config.traversal_cost,
        config.intersection_cost,
        config.block_width
    )?;
    if let Some(Stages { small_node_limit, empty_cutoff, .. }) = config.stages() {
        write!(out, " T {small_node_limit} C_e {empty_cutoff}/256")?;
    }
    let references = config.references_per_triangle;
    write!(out, " max_depth {} references_per_triangle {references}", config.max_depth)?;
    if let Some(Stages { nodes_per_triangle, .. }) = config.stages() {
        write!(out, " nodes_per_triangle {nodes_per_triangle}")?;
    }
    if let Some(Sweep { empty_bonus, bad_splits }) = config.sweep() {
        write!(out, " empty_bonus {empty_bonus}/256 bad_splits {bad_splits}")?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "triangles {} references {} nodes {} leaves {} empty {} depth {} largest leaf {}",
        tree.triangles,
        stats.references,
        stats.nodes,
        stats.leaves,
        stats.empty_leaves,
        stats.max_depth,
        stats.largest_leaf
    )?;
    writeln!(out, "sah cost {:.6} by blocks {:.6}", stats.sah_cost, stats.block_cost)?;
    for (name, corner) in [("lo", tree.bounds.lo), ("hi", tree.bounds.hi)] {
        writeln!(
            out,
            "bounds {name} {} {} {}",
            Float(corner[0]),
            Float(corner[1]),
            Float(corner[2])
        )?;
    }
    write!(out, "leaves by depth")?;
    for leaves in &stats.leaves_by_depth[..=stats.max_depth as usize] {
        write!(out, " {leaves}")?;
    }
    writeln!(out)?;
    let mut result = Ok(());
    tree.walk(|index, kind, _, depth| {
        if index >= most_nodes || result.is_err() {
            return;
        }
        result = write_node(out, tree, index, kind, depth);
    });
    result?;
    if tree.nodes.len() > most_nodes {
        writeln!(out, "... {} more nodes", tree.nodes.len() - most_nodes)?;
    }
    Ok(())
}

fn write_node(
    out: &mut String,
    tree: &KdTreeView<'_>,
    index: usize,
    kind: NodeKind,
    depth: u32,
) -> fmt::Result {
    write!(out, "{:width$}{index} ", "", width = 2 * depth as usize)?;
    match kind {
        NodeKind::Interior { axis, split, right } => {
            writeln!(out, "{axis:?} {} right {right}", Float(split))
        }
        NodeKind::Leaf { count: 0, .. } => writeln!(out, "empty"),
        NodeKind::Leaf { first, count } => {
            write!(out, "leaf {count}:")?;
            for triangle in tree.leaf(first, count) {
                write!(out, " {triangle}")?;
            }
            writeln!(out)
        }
    }
}

/// A float as decimal and as bits.
struct Float(f32);

impl fmt::Display for Float {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}/{:08x}", self.0, self.0.to_bits())
    }
}

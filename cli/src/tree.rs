//! What is said about a tree, its file, and whether it is sound.

use super::failure::Failure;
use super::files;
use serde::Serialize;
use splitplane::core::tree::{file, stats, validate};
use splitplane::{Accelerator, Mesh};
use std::path::Path;

/// Counts and cost of a tree.
#[derive(Debug, Serialize)]
pub(super) struct TreeStats {
    pub(super) nodes: usize,
    pub(super) leaves: usize,
    pub(super) empty_leaves: usize,
    pub(super) references: usize,
    pub(super) max_depth: u32,
    pub(super) sah_cost: f64,
}

/// What a report says of a tree; the cost is that of [`stats::TreeStats::sah_cost`].
pub(super) fn tree_stats(accelerator: &dyn Accelerator) -> TreeStats {
    let stats = stats::TreeStats::of(&accelerator.tree().view());
    TreeStats {
        nodes: stats.nodes,
        leaves: stats.leaves,
        empty_leaves: stats.empty_leaves,
        references: stats.references,
        max_depth: stats.max_depth,
        sah_cost: stats.sah_cost,
    }
}

/// Writes the tree to a file of the format that [`file`] describes.
pub(super) fn save_tree(
    path: &Path,
    accelerator: &dyn Accelerator,
    mesh: &Mesh<'_>,
) -> Result<(), Failure> {
    files::write(path, &file::write(&accelerator.tree().view(), mesh)?)
}

/// Checks that the tree is sound and loses no part of the mesh.
pub(super) fn check_tree(accelerator: &dyn Accelerator, mesh: &Mesh<'_>) -> Result<(), String> {
    let tree = accelerator.tree();
    validate::validate_mesh(&tree.view(), mesh).map_err(|violation| violation.to_string())
}

//! A tree by the reference executor.

use super::{Budget, ReferenceExecutor};
use crate::backend::BuildOptions;
use crate::build::schedule;
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::report::BuildSummary;
use crate::tree::KdTree;

/// Builds a tree on the calling thread, with nothing but the core: the same bytes as every backend.
///
/// Ignores the layout in the options: it says what queries read, and the reference traversal
/// ([`crate::query::traverse`]) reads the tree itself.
///
/// # Errors
/// A configuration out of range, a limit that binds, a watch that cancels the build, and
/// [`BuildError::PresetNotOnDevice`] for preset `best`, which the schedule does not build.
pub fn build(
    mesh: &Mesh<'_>,
    options: &BuildOptions<'_>,
) -> Result<(KdTree, BuildSummary), BuildError> {
    let BuildOptions { config, max_memory, watch, .. } = *options;
    let budget = Budget::new(max_memory, watch);
    let mut executor = ReferenceExecutor::new(*mesh, config, budget)?;
    let preset = config.preset();
    let planes = preset.planes().ok_or(BuildError::PresetNotOnDevice { preset })?;
    schedule::build(&mut executor, planes)?;
    let summary = executor.summary();
    Ok((executor.into_tree(), summary))
}

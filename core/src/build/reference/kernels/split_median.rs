use super::{node_bounds, range};
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::decide::{cut_empty_space, median_or_sweep_while};
use crate::config::BuildConfig;
use crate::layout::{ChunkBounds, Decision, LargeNode, Reference};

/// Decides about an active node in preset `fast`: its tight bounds, see [`node_bounds`], cuts of empty space, see [`cut_empty_space`], then a
/// split at the spatial median of the longest axis or a transfer to the small list, see
/// [`median_or_sweep_while`].
///
/// References are read only where the plane that made the node separated nothing.
pub fn split_median<A: Arithmetic>(
    config: &BuildConfig,
    node: usize,
    active_nodes: &[LargeNode],
    chunk_bounds: &[ChunkBounds],
    references: &[Reference],
) -> Decision {
    let tight = node_bounds(node, active_nodes, chunk_bounds);
    split_median_while::<A>(config, &active_nodes[node], &tight, references, |_| true)
}

/// As [`split_median`], for a node by itself, whose tight bounds are known. `go_on` is called at intervals with the amount of
/// work since the last call, in references read and written. Once it returns false, the decision is
/// invalid.
pub fn split_median_while<A: Arithmetic>(
    config: &BuildConfig,
    node: &LargeNode,
    tight: &Aabb,
    references: &[Reference],
    go_on: impl FnMut(u64) -> bool,
) -> Decision {
    let (decision, cell) = cut_empty_space::<A>(config, node, tight);
    let Some(cell) = cell else { return decision };
    let own = || &references[range(node.first, node.count)];
    decision.split_at(median_or_sweep_while::<A>(node, &cell, own, go_on))
}

use super::chunks_of;
use crate::aabb::Aabb;
use crate::arithmetic::Arithmetic;
use crate::build::bins::NodeBins;
use crate::build::decide::{border_or_median, cut_empty_space};
use crate::config::BuildConfig;
use crate::layout::{ChunkBins, Decision, LargeNode};

/// Decides about an active node in preset `balanced`: cuts of empty space, see [`cut_empty_space`], then
/// a split at a border of bins or a transfer to the small list, see [`border_or_median`].
pub fn split_binned<A: Arithmetic>(
    config: &BuildConfig,
    node: usize,
    active_nodes: &[LargeNode],
    node_bounds: &[Aabb],
    chunk_bins: &[ChunkBins],
) -> Decision {
    let (node, tight) = (&active_nodes[node], &node_bounds[node]);
    let (decision, cell) = cut_empty_space::<A>(config, node, tight);
    let Some(cell) = cell else { return decision };
    let bins = NodeBins::sum(&chunk_bins[chunks_of(node)], config.bins());
    decision.split_at(border_or_median::<A>(config, node, &cell, tight, &bins))
}

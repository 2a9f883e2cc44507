//! What a tree is like, apart from the times it takes.

use splitplane_core::backend::Accelerator;
use splitplane_core::config::BuildConfig;
use splitplane_core::tree::KdTreeView;
use splitplane_core::tree::digest::Xxh64;
use splitplane_core::tree::stats::TreeStats;

/// What a tree is like, whoever traces through it.
pub(super) struct Likeness {
    pub(super) stats: TreeStats,
    pub(super) digest: String,
    /// A name of nodes and references alone; the digest counts what shaped them, too.
    pub(super) tree: u64,
    pub(super) query_bytes: u64,
    pub(super) peak_bytes: u64,
}

impl Likeness {
    pub(super) fn of(tree: &dyn Accelerator) -> Likeness {
        let view = tree.tree().view();
        // One K_T, K_I and W for all, whatever shaped the tree: else costs do not compare.
        let fast = BuildConfig::default();
        let config = BuildConfig {
            traversal_cost: fast.traversal_cost,
            intersection_cost: fast.intersection_cost,
            block_width: fast.block_width,
            ..view.config
        };
        Likeness {
            stats: TreeStats::of(&KdTreeView { config, ..view }),
            digest: tree.tree().digest().to_string(),
            tree: name_of_nodes(&view),
            query_bytes: tree.query_bytes(),
            peak_bytes: tree.summary().peak_bytes,
        }
    }
}

/// XXH64 over nodes and references.
fn name_of_nodes(tree: &KdTreeView<'_>) -> u64 {
    let mut state = Xxh64::new(0);
    for node in tree.nodes {
        state.write_words(&node.words());
    }
    state.write_words(tree.references);
    state.finish()
}

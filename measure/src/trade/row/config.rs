//! The configuration of a tree, as it stands in files.

use serde::{Deserialize, Serialize};
use splitplane_core::config::{BuildConfig, Preset};

/// What shaped a tree, as it stands in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// K_T.
    pub traversal_cost: u32,
    /// K_I.
    pub intersection_cost: u32,
    /// W.
    pub block_width: u32,
    /// T.
    pub small_node_limit: u32,
    /// C_e, in 256ths.
    pub empty_cutoff: u32,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Bins of an axis.
    pub bins: u32,
    /// Whether references are clipped.
    pub clip: bool,
    /// The cap on references, for each triangle.
    pub references_per_triangle: u32,
    /// The cap on nodes, for each triangle.
    pub nodes_per_triangle: u32,
    /// What a split with an empty side is forgiven, in 256ths.
    pub empty_bonus: u32,
    /// How many bad splits in a row are tried.
    pub bad_splits: u32,
}

/// Knobs that the builder does not have are 0.
impl From<BuildConfig> for Config {
    fn from(config: BuildConfig) -> Config {
        let [_, _, _, _, small_node_limit, empty_cutoff, _, _, nodes_per_triangle, bins, ..] =
            config.words();
        let [.., empty_bonus, bad_splits] = config.words();
        Config {
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit,
            empty_cutoff,
            max_depth: config.max_depth,
            bins,
            clip: config.clip,
            references_per_triangle: config.references_per_triangle,
            nodes_per_triangle,
            empty_bonus,
            bad_splits,
        }
    }
}

impl Config {
    /// The configuration of a preset with those of these knobs that it has.
    pub fn with(&self, preset: Preset) -> BuildConfig {
        let mut config = BuildConfig {
            traversal_cost: self.traversal_cost,
            intersection_cost: self.intersection_cost,
            block_width: self.block_width,
            max_depth: self.max_depth,
            references_per_triangle: self.references_per_triangle,
            clip: self.clip,
            ..preset.config()
        };
        if let Some(stages) = config.stages_mut() {
            stages.small_node_limit = self.small_node_limit;
            stages.empty_cutoff = self.empty_cutoff;
            stages.nodes_per_triangle = self.nodes_per_triangle;
        }
        if let Some(bins) = config.bins_mut() {
            *bins = self.bins;
        }
        if let Some(sweep) = config.sweep_mut() {
            sweep.empty_bonus = self.empty_bonus;
            sweep.bad_splits = self.bad_splits;
        }
        config
    }
}

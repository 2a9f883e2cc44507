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

impl From<BuildConfig> for Config {
    fn from(config: BuildConfig) -> Config {
        Config {
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit: config.small_node_limit,
            empty_cutoff: config.empty_cutoff,
            max_depth: config.max_depth,
            bins: config.bins,
            clip: config.clip,
            references_per_triangle: config.references_per_triangle,
            nodes_per_triangle: config.nodes_per_triangle,
            empty_bonus: config.empty_bonus,
            bad_splits: config.bad_splits,
        }
    }
}

impl Config {
    /// The configuration of a preset with these knobs.
    pub fn with(&self, preset: Preset) -> BuildConfig {
        BuildConfig {
            preset,
            traversal_cost: self.traversal_cost,
            intersection_cost: self.intersection_cost,
            block_width: self.block_width,
            small_node_limit: self.small_node_limit,
            empty_cutoff: self.empty_cutoff,
            max_depth: self.max_depth,
            references_per_triangle: self.references_per_triangle,
            nodes_per_triangle: self.nodes_per_triangle,
            bins: self.bins,
            clip: self.clip,
            empty_bonus: self.empty_bonus,
            bad_splits: self.bad_splits,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configurations_survive_a_file() {
        for preset in Preset::ALL {
            let config = BuildConfig { clip: false, max_depth: 9, ..BuildConfig::preset(preset) };
            let text = serde_json::to_string(&Config::from(config)).unwrap();
            let read: Config = serde_json::from_str(&text).unwrap();
            assert_eq!(read.with(preset), config);
        }
    }
}

//! Who builds, for a row of a table.

use serde::Serialize;
use splitplane_core::config::{BuildConfig, Preset};

/// A preset on a backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Builder {
    /// How the tree is built.
    pub preset: Preset,
    /// On the GPU; else on the CPU.
    pub gpu: bool,
    /// The one that the others are compared with: it builds on one thread.
    pub offline: bool,
    /// With the costs of [`EQUAL_COSTS`], as all others of this kind; else as its preset is tuned.
    pub equal: bool,
}

/// K_T and K_I of builders at equal knobs, with W = 1: as 15 to 20, the ratio of Wald and Havran 2006. The survey does not
/// give its own.
pub const EQUAL_COSTS: [u32; 2] = [3, 4];

impl Builder {
    /// The builders of a report, the offline one first: it on one thread, then the presets that build
    /// in parallel on all threads, then these on the GPU; all as tuned, then all at equal knobs.
    pub fn all(offline: Preset, gpu: bool) -> Vec<Builder> {
        let mut builders = Vec::new();
        for equal in [false, true] {
            builders.push(Builder { preset: offline, gpu: false, offline: true, equal });
            for gpu in [false, true].into_iter().take(1 + usize::from(gpu)) {
                for preset in [Preset::Balanced, Preset::Fast] {
                    builders.push(Builder { preset, gpu, offline: false, equal });
                }
            }
        }
        builders
    }

    /// What shapes its trees.
    pub fn config(&self) -> BuildConfig {
        let config = BuildConfig::preset(self.preset);
        if self.equal { at_equal_knobs(config) } else { config }
    }

    /// `tuned` or `equal`.
    pub fn knobs(&self) -> &'static str {
        if self.equal { "equal" } else { "tuned" }
    }
}

/// The same with the costs of all builders at equal knobs, triangles counted one by one.
pub fn at_equal_knobs(config: BuildConfig) -> BuildConfig {
    let [traversal_cost, intersection_cost] = EQUAL_COSTS;
    BuildConfig { traversal_cost, intersection_cost, block_width: 1, ..config }
}

/// What shaped the trees of a preset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Knobs {
    /// Its name.
    pub preset: &'static str,
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
    /// What a split with an empty side is forgiven, in 256ths.
    pub empty_bonus: u32,
    /// How many bad splits in a row are tried.
    pub bad_splits: u32,
}

impl From<Preset> for Knobs {
    fn from(preset: Preset) -> Knobs {
        let config = BuildConfig::preset(preset);
        Knobs {
            preset: preset.name(),
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit: config.small_node_limit,
            empty_cutoff: config.empty_cutoff,
            max_depth: config.max_depth,
            bins: config.bins,
            clip: config.clip,
            empty_bonus: config.empty_bonus,
            bad_splits: config.bad_splits,
        }
    }
}

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
        let config = self.preset.config();
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
    /// T, where the builder has stages.
    pub small_node_limit: Option<u32>,
    /// C_e, in 256ths, likewise.
    pub empty_cutoff: Option<u32>,
    /// Most levels below the root.
    pub max_depth: u32,
    /// Bins of an axis, where the builder has bins.
    pub bins: Option<u32>,
    /// Whether references are clipped.
    pub clip: bool,
    /// The discount of a split with an empty side, in 256ths; preset `best`.
    pub empty_bonus: Option<u32>,
    /// How many bad splits in a row are tried; preset `best`.
    pub bad_splits: Option<u32>,
}

impl From<Preset> for Knobs {
    fn from(preset: Preset) -> Knobs {
        let mut config = preset.config();
        Knobs {
            preset: preset.name(),
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit: config.stages().map(|stages| stages.small_node_limit),
            empty_cutoff: config.stages().map(|stages| stages.empty_cutoff),
            max_depth: config.max_depth,
            bins: config.bins_mut().copied(),
            clip: config.clip,
            empty_bonus: config.sweep().map(|sweep| sweep.empty_bonus),
            bad_splits: config.sweep().map(|sweep| sweep.bad_splits),
        }
    }
}

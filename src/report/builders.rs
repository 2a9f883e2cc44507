//! Who builds, for a row of a table.

use serde::Serialize;
use splitplane_core::config::Preset;

/// A preset on a backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Builder {
    /// How the tree is built.
    pub preset: Preset,
    /// On the GPU; else on the CPU.
    pub gpu: bool,
    /// The one that the others are compared with: it builds on one thread.
    pub offline: bool,
}

impl Builder {
    /// The builders of a report, the offline one first: it on one thread, then the presets that build
    /// in parallel on all threads, then these on the GPU.
    pub fn all(offline: Preset, gpu: bool) -> Vec<Builder> {
        let mut builders = vec![Builder { preset: offline, gpu: false, offline: true }];
        for gpu in [false, true].into_iter().take(1 + usize::from(gpu)) {
            for preset in [Preset::Balanced, Preset::Fast] {
                builders.push(Builder { preset, gpu, offline: false });
            }
        }
        builders
    }
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
        let config = splitplane_core::config::BuildConfig::preset(preset);
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

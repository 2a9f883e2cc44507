//! Build configuration: all settings that shape a tree.

use thiserror::Error;

/// Greatest number of triangles of a small node: a triangle set is one 64-bit mask.
pub const MAX_SMALL: u32 = 64;
/// Greatest depth any tree may have; traversal stacks have this many entries.
pub const MAX_DEPTH: u32 = 96;
/// References of a chunk, the unit of work of the large-node stage.
pub const CHUNK: u32 = 256;
/// Most nodes one small root may emit; part of the tree format.
pub const SMALL_ROOT_NODES: u32 = 511;
/// Most references one small root may emit; part of the tree format.
pub const SMALL_ROOT_REFERENCES: u32 = 1023;

/// Most bins of an axis.
pub const MAX_BINS: u32 = 64;

/// Which builder makes the tree. All three give the same format, and every query reads it alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Preset {
    /// The paper's builder: empty-space cutoff, else the spatial median of the longest axis
    /// (Zhou et al. 2008, Algorithm 2); masks below.
    #[default]
    Fast,
    /// Binned SAH in the large-node stage (Shevtsov, Soupikov and Kapustin 2007; Danilewski, Popov
    /// and Slusallek 2010); masks below.
    Balanced,
    /// The offline builder: greedy SAH over all planes, with clipped events (Wald and Havran 2006).
    /// On the CPU only.
    Best,
}

impl Preset {
    /// All presets, by build time.
    pub const ALL: [Preset; 3] = [Preset::Fast, Preset::Balanced, Preset::Best];

    /// The preset's name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Preset::Fast => "fast",
            Preset::Balanced => "balanced",
            Preset::Best => "best",
        }
    }

    /// How the large-node stage finds its planes; `None` for [`Preset::Best`], which has no such
    /// stage: the schedule does not build it.
    pub const fn planes(self) -> Option<Planes> {
        match self {
            Preset::Fast => Some(Planes::Median),
            Preset::Balanced => Some(Planes::Binned),
            Preset::Best => None,
        }
    }
}

/// How the large-node stage finds the planes that split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Planes {
    /// The spatial median of the longest axis.
    Median,
    /// The best by SAH among the borders of bins.
    Binned,
}

/// All settings that shape a tree. Equal mesh and equal configuration give equal bytes on every
/// backend and thread count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildConfig {
    /// How large nodes are split.
    pub preset: Preset,
    /// K_T, the cost of stepping through one interior node (Eq. 1), in the unit of
    /// `intersection_cost`. 1 or more.
    pub traversal_cost: u32,
    /// K_I, the cost of testing one block of `block_width` triangles (Eq. 1). 1 or more. Only the
    /// ratio C_ts = K_T / K_I matters.
    pub intersection_cost: u32,
    /// W, how many triangles one test takes at once: a leaf of n costs K_I * ceil(n / W). 1 gives
    /// the classic heuristic.
    pub block_width: u32,
    /// T, the most triangles a small node may have; 1 to [`MAX_SMALL`].
    pub small_node_limit: u32,
    /// C_e in 256ths: empty space beyond this part of a node's extent on one side is cut off.
    /// 1 to 255; the paper's re-implementations use 25 %, which is 64.
    pub empty_cutoff: u32,
    /// Most levels below the root; 1 to [`MAX_DEPTH`]. A node at this depth becomes a leaf.
    pub max_depth: u32,
    /// The large-node stage stops splitting where its references would exceed this many per
    /// triangle (plus 4,096). 1 or more. Bounds memory on inputs that no plane separates.
    pub references_per_triangle: u32,
    /// The same cap for nodes of the large-node stage.
    pub nodes_per_triangle: u32,
    /// Bins of each axis, whose borders are the candidates of [`Preset::Balanced`]; 2 to
    /// [`MAX_BINS`]. The other presets have none.
    pub bins: u32,
    /// Whether references are clipped to the cells they go to: their bounds then hold only the part
    /// of the triangle inside. Without it a build is faster and the tree is larger.
    pub clip: bool,
    /// The part of its cost by which a split with an empty side is discounted, in 256ths; 0 to 255.
    /// [`Preset::Best`] only; the others cut empty space by `empty_cutoff`.
    pub empty_bonus: u32,
    /// How many splits in a row that cost more than a leaf are tried before the node becomes a leaf;
    /// those under which the cost did not fall are retracted. 0 to 8. [`Preset::Best`] only.
    pub bad_splits: u32,
}

impl Default for BuildConfig {
    /// Preset [`Preset::Fast`], tuned for wide triangle tests.
    fn default() -> BuildConfig {
        BuildConfig {
            preset: Preset::Fast,
            traversal_cost: 1,
            intersection_cost: 4,
            block_width: 16,
            small_node_limit: MAX_SMALL,
            empty_cutoff: 64,
            max_depth: 64,
            references_per_triangle: 8,
            nodes_per_triangle: 4,
            bins: 32,
            clip: true,
            empty_bonus: 0,
            bad_splits: 0,
        }
    }
}

/// Why a configuration cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ConfigError {
    /// A value lies outside its range.
    #[error("{field} is {value}, but must be from {least} to {most}")]
    OutOfRange {
        /// The field of [`BuildConfig`].
        field: &'static str,
        /// Its value.
        value: u32,
        /// Least allowed value.
        least: u32,
        /// Greatest allowed value.
        most: u32,
    },
    /// Costs of a node could exceed 32 bits. Not for [`Preset::Best`], whose costs are in `f64`.
    #[error(
        "traversal_cost + 2 * intersection_cost * ceil(small_node_limit / block_width) is {sum}, \
         but must be at most {most}, or costs would not fit 32 bits"
    )]
    CostTooLarge {
        /// The sum.
        sum: u64,
        /// Its greatest allowed value.
        most: u32,
    },
}

/// A preset with its knobs as tuned: see [`BuildConfig::preset`].
impl From<Preset> for BuildConfig {
    fn from(preset: Preset) -> BuildConfig {
        BuildConfig::preset(preset)
    }
}

impl BuildConfig {
    /// A preset with its knobs as tuned by trace time on real scenes.
    pub fn preset(preset: Preset) -> BuildConfig {
        let fast = BuildConfig { preset, ..BuildConfig::default() };
        match preset {
            Preset::Fast | Preset::Balanced => fast,
            Preset::Best => BuildConfig {
                intersection_cost: 2,
                block_width: 8,
                empty_bonus: 26,
                bad_splits: 0,
                ..fast
            },
        }
    }

    /// Greatest sum of costs for which the integer SAH fits 32 bits: a half area is at most
    /// 3 * 1023^2 = 3,139,587, and 1,367 times that is below 2^32.
    pub const MAX_COST: u32 = 1367;

    /// Checks every field; the builders call it first.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let ranges = [
            ("traversal_cost", self.traversal_cost, 1, Self::MAX_COST),
            ("intersection_cost", self.intersection_cost, 1, Self::MAX_COST),
            ("block_width", self.block_width, 1, MAX_SMALL),
            ("small_node_limit", self.small_node_limit, 1, MAX_SMALL),
            ("empty_cutoff", self.empty_cutoff, 1, 255),
            ("max_depth", self.max_depth, 1, MAX_DEPTH),
            ("references_per_triangle", self.references_per_triangle, 1, 1 << 16),
            ("nodes_per_triangle", self.nodes_per_triangle, 1, 1 << 16),
            ("bins", self.bins, 2, MAX_BINS),
            ("empty_bonus", self.empty_bonus, 0, 255),
            ("bad_splits", self.bad_splits, 0, 8),
        ];
        for (field, value, least, most) in ranges {
            if value < least || value > most {
                return Err(ConfigError::OutOfRange { field, value, least, most });
            }
        }
        if self.preset == Preset::Best {
            // Its costs are in `f64`.
            return Ok(());
        }
        let blocks = u64::from(self.small_node_limit.div_ceil(self.block_width));
        let sum = u64::from(self.traversal_cost) + 2 * u64::from(self.intersection_cost) * blocks;
        if sum > u64::from(Self::MAX_COST) {
            return Err(ConfigError::CostTooLarge { sum, most: Self::MAX_COST });
        }
        Ok(())
    }

    /// C_ts = K_T / K_I.
    pub fn cost_ratio(&self) -> f64 {
        f64::from(self.traversal_cost) / f64::from(self.intersection_cost)
    }

    /// The configuration as words: what files hold. The first nine are the fields up to
    /// `nodes_per_triangle`, in their order; the others hold later additions, so that zeros mean
    /// the earlier behaviour: bins, 1 for no clipping, empty bonus, bad splits. Knobs that the
    /// preset does not have are zero.
    pub const fn words(&self) -> [u32; 13] {
        let (bins, empty_bonus, bad_splits) = match self.preset {
            Preset::Fast => (0, 0, 0),
            Preset::Balanced => (self.bins, 0, 0),
            Preset::Best => (0, self.empty_bonus, self.bad_splits),
        };
        let (limit, cutoff, nodes) = match self.preset {
            Preset::Fast | Preset::Balanced => {
                (self.small_node_limit, self.empty_cutoff, self.nodes_per_triangle)
            }
            Preset::Best => (0, 0, 0),
        };
        [
            self.preset as u32,
            self.traversal_cost,
            self.intersection_cost,
            self.block_width,
            limit,
            cutoff,
            self.max_depth,
            self.references_per_triangle,
            nodes,
            bins,
            !self.clip as u32,
            empty_bonus,
            bad_splits,
        ]
    }

    /// The inverse of [`BuildConfig::words`]; `None` for an unknown preset or a value out of range.
    /// Knobs that the preset does not have get their defaults.
    pub fn from_words(words: [u32; 13]) -> Option<BuildConfig> {
        let preset = *Preset::ALL.get(words[0] as usize)?;
        let of_preset = BuildConfig::preset(preset);
        // A knob that not every preset has.
        let has = |preset_has: bool, word: usize, default| {
            if preset_has { words[word] } else { default }
        };
        let best = preset == Preset::Best;
        let config = BuildConfig {
            preset,
            traversal_cost: words[1],
            intersection_cost: words[2],
            block_width: words[3],
            small_node_limit: has(!best, 4, of_preset.small_node_limit),
            empty_cutoff: has(!best, 5, of_preset.empty_cutoff),
            max_depth: words[6],
            references_per_triangle: words[7],
            nodes_per_triangle: has(!best, 8, of_preset.nodes_per_triangle),
            bins: has(preset == Preset::Balanced, 9, of_preset.bins),
            clip: words[10] == 0,
            empty_bonus: has(best, 11, of_preset.empty_bonus),
            bad_splits: has(best, 12, of_preset.bad_splits),
        };
        let canonical = config.validate().is_ok() && config.words() == words;
        canonical.then_some(config)
    }

    /// Greatest number of references alive in the large-node stage for this many triangles.
    pub fn reference_cap(&self, triangles: u32) -> u32 {
        let cap = u64::from(triangles) * u64::from(self.references_per_triangle) + 4096;
        u32::try_from(cap).unwrap_or(u32::MAX).min(KdCaps::REFERENCES)
    }

    /// Greatest number of nodes of the large-node stage for this many triangles.
    pub fn node_cap(&self, triangles: u32) -> u32 {
        let cap = u64::from(triangles) * u64::from(self.nodes_per_triangle) + 4096;
        u32::try_from(cap).unwrap_or(u32::MAX).min(KdCaps::NODES)
    }
}

/// Hard caps that follow from the node format.
struct KdCaps;

impl KdCaps {
    /// Leaves space for what small roots add, so that addresses stay within 32 bits.
    const REFERENCES: u32 = 1 << 30;
    /// A quarter of the 30-bit child index.
    const NODES: u32 = 1 << 28;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_is_valid_and_words_round_trip() {
        let config = BuildConfig::default();
        assert_eq!(config.validate(), Ok(()));
        assert_eq!(BuildConfig::from_words(config.words()), Some(config));
        assert_eq!(config.words()[9..], [0; 4], "digests of the first preset stay what they were");
        for preset in Preset::ALL {
            let config = BuildConfig::preset(preset);
            assert_eq!((config.preset, config.validate()), (preset, Ok(())));
            assert_eq!(BuildConfig::from_words(config.words()), Some(config));
            let config = BuildConfig { clip: false, ..config };
            assert_eq!(BuildConfig::from_words(config.words()), Some(config));
            let mut words = config.words();
            words[10] = 2;
            assert_eq!(BuildConfig::from_words(words), None);
        }
    }

    #[test]
    fn each_field_is_checked() {
        let bad = [
            BuildConfig { traversal_cost: 0, ..Default::default() },
            BuildConfig { intersection_cost: 0, ..Default::default() },
            BuildConfig { block_width: 0, ..Default::default() },
            BuildConfig { small_node_limit: 65, ..Default::default() },
            BuildConfig { empty_cutoff: 256, ..Default::default() },
            BuildConfig { max_depth: 97, ..Default::default() },
            BuildConfig { references_per_triangle: 0, ..Default::default() },
            BuildConfig { nodes_per_triangle: 0, ..Default::default() },
            BuildConfig { bins: 1, ..Preset::Balanced.into() },
            BuildConfig { bins: 65, ..Preset::Balanced.into() },
            BuildConfig { empty_bonus: 256, ..Preset::Best.into() },
            BuildConfig { bad_splits: 9, ..Preset::Best.into() },
        ];
        for config in bad {
            assert!(matches!(config.validate(), Err(ConfigError::OutOfRange { .. })), "{config:?}");
            assert_eq!(BuildConfig::from_words(config.words()), None);
        }
        let heavy = BuildConfig { intersection_cost: 200, block_width: 1, ..Default::default() };
        assert!(matches!(heavy.validate(), Err(ConfigError::CostTooLarge { .. })));
        assert_eq!(BuildConfig { preset: Preset::Best, ..heavy }.validate(), Ok(()));
    }

    /// The derivation of [`BuildConfig::MAX_COST`].
    #[test]
    fn the_greatest_cost_fits_32_bits() {
        let area = 3 * 1023u64 * 1023;
        assert!(area * u64::from(BuildConfig::MAX_COST) <= u64::from(u32::MAX));
    }

    /// What a preset says is part of every digest: these words change together with
    /// [`crate::tree::DIGEST_VERSION`] only.
    #[test]
    fn presets_stay_what_they_are() {
        let words = Preset::ALL.map(|preset| BuildConfig::preset(preset).words());
        assert_eq!(
            words,
            [
                [0, 1, 4, 16, 64, 64, 64, 8, 4, 0, 0, 0, 0],
                [1, 1, 4, 16, 64, 64, 64, 8, 4, 32, 0, 0, 0],
                [2, 1, 2, 8, 0, 0, 64, 8, 0, 0, 0, 26, 0],
            ]
        );
    }
}

//! Build configuration: all settings that shape a tree.

use thiserror::Error;

/// Greatest number of triangles of a small node: a triangle set is one 64-bit mask.
pub const MAX_SMALL: u32 = 64;
/// Greatest depth any tree may have; traversal stacks have this many entries.
pub const MAX_DEPTH: u32 = 96;
/// References of a chunk, the unit of work of the large-node stage.
pub const CHUNK: u32 = 256;
/// Chunks of a span: `scatter_references` finds what the chunks of a node before a given one give to each child from the counts of whole
/// spans, then of chunks. A span has at most 2^15 references, so that two counts fit one word.
pub const SPAN: u32 = 128;
const _: () = assert!(SPAN * CHUNK <= u16::MAX as u32);
/// Most nodes one small root may emit; part of the tree format.
pub const SMALL_ROOT_NODES: u32 = 511;
/// Most references one small root may emit; part of the tree format.
pub const SMALL_ROOT_REFERENCES: u32 = 1023;

/// Most bins of an axis.
pub const MAX_BINS: u32 = 64;

/// Named configurations: builders with their knobs as tuned on real scenes, by trace time, and `narrow` by what rays
/// visit. All make the same format, and every query reads it alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Preset {
    /// [`Builder::Median`]: the fastest build.
    #[default]
    Fast,
    /// [`Builder::Median`] with the classic heuristic, W = 1: small leaves for rays that test one triangle at a time,
    /// as on a GPU. A larger tree than [`Preset::Fast`]'s.
    Narrow,
    /// [`Builder::Binned`]: a better tree for a slower build.
    Balanced,
    /// [`Builder::Sweep`]: the best tree, offline. On the CPU only.
    Best,
}

impl Preset {
    /// All presets: `fast` and its form for GPUs, then by build time.
    pub const ALL: [Preset; 4] = [Preset::Fast, Preset::Narrow, Preset::Balanced, Preset::Best];

    /// The name that [`FromStr`](core::str::FromStr) reads; also used in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Preset::Fast => "fast",
            Preset::Narrow => "narrow",
            Preset::Balanced => "balanced",
            Preset::Best => "best",
        }
    }

    /// The configuration.
    pub const fn config(self) -> BuildConfig {
        let fast = BuildConfig {
            builder: Builder::Median(Stages::DEFAULT),
            traversal_cost: 1,
            intersection_cost: 4,
            block_width: 16,
            max_depth: 64,
            references_per_triangle: 8,
            clip: true,
        };
        match self {
            Preset::Fast => fast,
            // One triangle is tested for about the price of a step.
            Preset::Narrow => BuildConfig { intersection_cost: 1, block_width: 1, ..fast },
            Preset::Balanced => {
                let builder = Builder::Binned { stages: Stages::DEFAULT, bins: 32 };
                BuildConfig { builder, ..fast }
            }
            Preset::Best => {
                let builder = Builder::Sweep(Sweep { empty_bonus: 26, bad_splits: 0 });
                BuildConfig { builder, intersection_cost: 2, block_width: 8, ..fast }
            }
        }
    }

    /// How the large-node stage finds its planes; `None` for [`Preset::Best`], which has no such
    /// stage: the schedule does not build it.
    pub const fn planes(self) -> Option<Planes> {
        match self {
            Preset::Fast | Preset::Narrow => Some(Planes::Median),
            Preset::Balanced => Some(Planes::Binned),
            Preset::Best => None,
        }
    }
}

/// A name that is not a preset's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("there is no preset of this name; the presets are fast, narrow, balanced and best")]
pub struct UnknownPreset;

impl core::str::FromStr for Preset {
    type Err = UnknownPreset;

    /// The inverse of [`Preset::name`]; upper case is not accepted.
    fn from_str(name: &str) -> Result<Preset, UnknownPreset> {
        Preset::ALL.into_iter().find(|preset| preset.name() == name).ok_or(UnknownPreset)
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

/// Which builder makes the tree, and the knobs that it alone has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Builder {
    /// The paper's builder: empty-space cutoff, else the spatial median of the longest axis
    /// (Zhou et al. 2008, Algorithm 2); masks below.
    Median(Stages),
    /// Binned SAH in the large-node stage (Shevtsov, Soupikov and Kapustin 2007; Danilewski, Popov
    /// and Slusallek 2010); masks below.
    Binned {
        /// The knobs of both stages.
        stages: Stages,
        /// Bins of each axis, whose borders are the candidates; 2 to [`MAX_BINS`].
        bins: u32,
    },
    /// The offline builder: greedy SAH over all planes, with clipped events (Wald and Havran 2006).
    /// On the CPU only.
    Sweep(Sweep),
}

impl Builder {
    /// The preset that this builder belongs to, whatever its knobs: of two that have it, the one that came first.
    pub const fn preset(&self) -> Preset {
        match self {
            Builder::Median(_) => Preset::Fast,
            Builder::Binned { .. } => Preset::Balanced,
            Builder::Sweep(_) => Preset::Best,
        }
    }
}

/// Knobs of the builders that the schedule runs, with a large-node and a small-node stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stages {
    /// T, the most triangles a small node may have; 1 to [`MAX_SMALL`].
    pub small_node_limit: u32,
    /// C_e in 256ths: empty space beyond this part of a node's extent on one side is cut off.
    /// 1 to 255; the paper's re-implementations use 25 %, which is 64.
    pub empty_cutoff: u32,
    /// The large-node stage stops splitting where it would have more nodes than this many per
    /// triangle (plus 4,096). 1 or more.
    pub nodes_per_triangle: u32,
}

impl Stages {
    const DEFAULT: Stages =
        Stages { small_node_limit: MAX_SMALL, empty_cutoff: 64, nodes_per_triangle: 4 };
}

impl Default for Stages {
    fn default() -> Stages {
        Stages::DEFAULT
    }
}

/// Knobs of [`Builder::Sweep`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// The part of its cost by which a split with an empty side is discounted, in 256ths; 0 to 255.
    pub empty_bonus: u32,
    /// How many splits in a row that cost more than a leaf are tried before the node becomes a leaf;
    /// those under which the cost did not fall are retracted. 0 to 8.
    pub bad_splits: u32,
}

/// All settings that shape a tree. Equal mesh and equal configuration give equal bytes on every
/// backend and thread count. The other way round: every field has an effect, so trees of different configurations
/// differ on some mesh, except where both costs are multiplied by one factor.
///
/// Start from a [`Preset`] and change what you need:
///
/// ```
/// use splitplane_core::config::{BuildConfig, Preset};
///
/// let config = BuildConfig { max_depth: 32, ..Preset::Balanced.config() }
///     .with_bins(16)
///     .with_stages(|stages| stages.small_node_limit = 32);
/// assert_eq!(config.validate(), Ok(()));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildConfig {
    /// The builder, with its own knobs.
    pub builder: Builder,
    /// K_T, the cost of stepping through one interior node (Eq. 1), in the unit of
    /// `intersection_cost`. 1 or more.
    pub traversal_cost: u32,
    /// K_I, the cost of testing one block of `block_width` triangles (Eq. 1). 1 or more. Only the
    /// ratio C_ts = K_T / K_I matters.
    pub intersection_cost: u32,
    /// W, how many triangles one test takes at once: a leaf of n costs K_I * ceil(n / W). 1 gives
    /// the classic heuristic.
    pub block_width: u32,
    /// Most levels below the root; 1 to [`MAX_DEPTH`]. A node at this depth becomes a leaf.
    pub max_depth: u32,
    /// Splitting stops where the references would exceed this many per triangle (plus 4,096). 1 or
    /// more. Bounds memory on inputs that no plane separates.
    pub references_per_triangle: u32,
    /// Whether references are clipped to the cells they go to: their bounds then hold only the part
    /// of the triangle inside. Without it a build is faster and the tree is larger.
    pub clip: bool,
}

impl Default for BuildConfig {
    /// Preset [`Preset::Fast`], tuned for wide triangle tests.
    fn default() -> BuildConfig {
        Preset::Fast.config()
    }
}

/// [`Preset::config`].
impl From<Preset> for BuildConfig {
    fn from(preset: Preset) -> BuildConfig {
        preset.config()
    }
}

/// Why a configuration cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A value lies outside its range.
    #[error("{field} is {value}, but must be from {least} to {most}")]
    OutOfRange {
        /// The field of [`BuildConfig`] or of its builder.
        field: &'static str,
        /// Its value.
        value: u32,
        /// Least allowed value.
        least: u32,
        /// Greatest allowed value.
        most: u32,
    },
    /// Costs of a node could exceed 32 bits. Not for [`Builder::Sweep`], whose costs are in `f64`.
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

impl BuildConfig {
    /// Greatest sum of costs for which the integer SAH fits 32 bits: a half area is at most
    /// 3 * 1023^2 = 3,139,587, and 1,367 times that is below 2^32.
    pub const MAX_COST: u32 = 1367;

    /// The preset whose configuration this is; with other knobs the preset that the builder belongs to.
    pub const fn preset(&self) -> Preset {
        let (words, narrow) = (self.words(), Preset::Narrow.config().words());
        let mut place = 0;
        while place < words.len() && words[place] == narrow[place] {
            place += 1;
        }
        if place == words.len() { Preset::Narrow } else { self.builder.preset() }
    }

    /// The knobs of the stages; `None` for [`Builder::Sweep`], which has none.
    #[inline]
    pub const fn stages(&self) -> Option<&Stages> {
        match &self.builder {
            Builder::Median(stages) | Builder::Binned { stages, .. } => Some(stages),
            Builder::Sweep(_) => None,
        }
    }

    /// The knobs of [`Builder::Sweep`]; `None` for the others.
    pub const fn sweep(&self) -> Option<&Sweep> {
        match &self.builder {
            Builder::Sweep(sweep) => Some(sweep),
            Builder::Median(_) | Builder::Binned { .. } => None,
        }
    }

    /// T; 0 for a builder without stages, for which no kernel runs.
    #[inline]
    pub const fn small_node_limit(&self) -> u32 {
        match self.stages() {
            Some(stages) => stages.small_node_limit,
            None => 0,
        }
    }

    /// C_e in 256ths; 0 for a builder without stages.
    #[inline]
    pub const fn empty_cutoff(&self) -> u32 {
        match self.stages() {
            Some(stages) => stages.empty_cutoff,
            None => 0,
        }
    }

    /// Bins of each axis; 0 for a builder without bins.
    #[inline]
    pub const fn bins(&self) -> u32 {
        match &self.builder {
            Builder::Binned { bins, .. } => *bins,
            Builder::Median(_) | Builder::Sweep(_) => 0,
        }
    }

    /// The knobs of the stages, to change them; `None` for a builder without stages.
    pub const fn stages_mut(&mut self) -> Option<&mut Stages> {
        match &mut self.builder {
            Builder::Median(stages) | Builder::Binned { stages, .. } => Some(stages),
            Builder::Sweep(_) => None,
        }
    }

    /// The number of bins, to change it; `None` for a builder without bins.
    pub const fn bins_mut(&mut self) -> Option<&mut u32> {
        match &mut self.builder {
            Builder::Binned { bins, .. } => Some(bins),
            Builder::Median(_) | Builder::Sweep(_) => None,
        }
    }

    /// The knobs of [`Builder::Sweep`], to change them; `None` for the others.
    pub const fn sweep_mut(&mut self) -> Option<&mut Sweep> {
        match &mut self.builder {
            Builder::Sweep(sweep) => Some(sweep),
            Builder::Median(_) | Builder::Binned { .. } => None,
        }
    }

    /// This configuration with other knobs of the stages.
    ///
    /// # Panics
    /// Where the builder has no stages: see [`BuildConfig::stages_mut`].
    #[must_use]
    pub fn with_stages(mut self, change: impl FnOnce(&mut Stages)) -> BuildConfig {
        change(self.stages_mut().expect("a builder with stages"));
        self
    }

    /// This configuration with another number of bins.
    ///
    /// # Panics
    /// Where the builder has no bins: see [`BuildConfig::bins_mut`].
    #[must_use]
    pub fn with_bins(mut self, bins: u32) -> BuildConfig {
        *self.bins_mut().expect("a builder with bins") = bins;
        self
    }

    /// This configuration with other knobs of [`Builder::Sweep`].
    ///
    /// # Panics
    /// Where the builder is another: see [`BuildConfig::sweep_mut`].
    #[must_use]
    pub fn with_sweep(mut self, change: impl FnOnce(&mut Sweep)) -> BuildConfig {
        change(self.sweep_mut().expect("the builder of preset best"));
        self
    }

    /// Checks every field; the builders call it first.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let check = |ranges: &[(&'static str, u32, u32, u32)]| {
            let outside = |&&(_, value, least, most): &&(_, _, _, _)| value < least || value > most;
            ranges.iter().find(outside).map_or(Ok(()), |&(field, value, least, most)| {
                Err(ConfigError::OutOfRange { field, value, least, most })
            })
        };
        check(&[
            ("traversal_cost", self.traversal_cost, 1, Self::MAX_COST),
            ("intersection_cost", self.intersection_cost, 1, Self::MAX_COST),
            ("block_width", self.block_width, 1, MAX_SMALL),
            ("max_depth", self.max_depth, 1, MAX_DEPTH),
            ("references_per_triangle", self.references_per_triangle, 1, 1 << 16),
        ])?;
        if let Builder::Binned { bins, .. } = self.builder {
            check(&[("bins", bins, 2, MAX_BINS)])?;
        }
        match &self.builder {
            Builder::Median(stages) | Builder::Binned { stages, .. } => {
                check(&[
                    ("small_node_limit", stages.small_node_limit, 1, MAX_SMALL),
                    ("empty_cutoff", stages.empty_cutoff, 1, 255),
                    ("nodes_per_triangle", stages.nodes_per_triangle, 1, 1 << 16),
                ])?;
                let blocks = u64::from(stages.small_node_limit.div_ceil(self.block_width));
                let tests = 2 * u64::from(self.intersection_cost) * blocks;
                let sum = u64::from(self.traversal_cost) + tests;
                if sum > u64::from(Self::MAX_COST) {
                    return Err(ConfigError::CostTooLarge { sum, most: Self::MAX_COST });
                }
                Ok(())
            }
            Builder::Sweep(sweep) => check(&[
                ("empty_bonus", sweep.empty_bonus, 0, 255),
                ("bad_splits", sweep.bad_splits, 0, 8),
            ]),
        }
    }

    /// C_ts = K_T / K_I.
    pub fn cost_ratio(&self) -> f64 {
        f64::from(self.traversal_cost) / f64::from(self.intersection_cost)
    }

    /// The configuration as words: what files hold. In order: builder, K_T, K_I, W, T, C_e, greatest
    /// depth, references and nodes per triangle; then later additions, so that zeros mean the earlier
    /// behaviour: bins, 1 for no clipping, empty bonus, bad splits. Knobs that the builder does not have
    /// are zero.
    pub const fn words(&self) -> [u32; 13] {
        let none = Stages { small_node_limit: 0, empty_cutoff: 0, nodes_per_triangle: 0 };
        let (number, stages, bins, sweep) = match self.builder {
            Builder::Median(stages) => (0, stages, 0, Sweep { empty_bonus: 0, bad_splits: 0 }),
            Builder::Binned { stages, bins } => {
                (1, stages, bins, Sweep { empty_bonus: 0, bad_splits: 0 })
            }
            Builder::Sweep(sweep) => (2, none, 0, sweep),
        };
        [
            number,
            self.traversal_cost,
            self.intersection_cost,
            self.block_width,
            stages.small_node_limit,
            stages.empty_cutoff,
            self.max_depth,
            self.references_per_triangle,
            stages.nodes_per_triangle,
            bins,
            !self.clip as u32,
            sweep.empty_bonus,
            sweep.bad_splits,
        ]
    }

    /// The inverse of [`BuildConfig::words`]; `None` for an unknown builder, a value out of range, or a knob that the
    /// builder does not have.
    pub fn from_words(words: [u32; 13]) -> Option<BuildConfig> {
        let stages = Stages {
            small_node_limit: words[4],
            empty_cutoff: words[5],
            nodes_per_triangle: words[8],
        };
        let builder = match words[0] {
            0 => Builder::Median(stages),
            1 => Builder::Binned { stages, bins: words[9] },
            2 => Builder::Sweep(Sweep { empty_bonus: words[11], bad_splits: words[12] }),
            _ => return None,
        };
        let config = BuildConfig {
            builder,
            traversal_cost: words[1],
            intersection_cost: words[2],
            block_width: words[3],
            max_depth: words[6],
            references_per_triangle: words[7],
            clip: words[10] == 0,
        };
        let canonical = config.validate().is_ok() && config.words() == words;
        canonical.then_some(config)
    }

    /// Greatest number of references alive in the large-node stage for this many triangles.
    pub fn reference_cap(&self, triangles: u32) -> u32 {
        let cap = u64::from(triangles) * u64::from(self.references_per_triangle) + 4096;
        u32::try_from(cap).unwrap_or(u32::MAX).min(KdCaps::REFERENCES)
    }

    /// Greatest number of nodes of the large-node stage for this many triangles; 0 for a builder without stages.
    pub fn node_cap(&self, triangles: u32) -> u32 {
        let Some(stages) = self.stages() else { return 0 };
        let cap = u64::from(triangles) * u64::from(stages.nodes_per_triangle) + 4096;
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
mod tests;

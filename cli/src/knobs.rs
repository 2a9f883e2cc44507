//! The knobs of a build on the command line: what each is called, which presets have it, and how a
//! configuration is said in a report.

use super::failure::Failure;
use clap::Args;
use serde_json::{Map, Value};
use splitplane::core::config::{Builder, Sweep};
use splitplane::{BuildConfig, ConfigError, Preset};

#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Knobs of the build, the preset's where left out")]
pub(super) struct Knobs {
    /// K_T, what a step through an interior node costs. Only its ratio to --intersection-cost
    /// matters: the dearer a step, the fewer and larger the leaves
    #[arg(long, value_name = "K_T", hide_short_help = true)]
    traversal_cost: Option<u32>,
    /// K_I, what a test of --block-width triangles costs
    #[arg(long, value_name = "K_I", hide_short_help = true)]
    intersection_cost: Option<u32>,
    /// W, 1 to 64: triangles that one test takes at once; a leaf of n costs K_I for each W begun
    #[arg(long, value_name = "W", hide_short_help = true)]
    block_width: Option<u32>,
    /// T, 1 to 64: most triangles of a small node, whose planes are found on bit masks
    #[arg(long, value_name = "T", hide_short_help = true)]
    small_node_limit: Option<u32>,
    /// C_e: empty space that is more than this part of a node's extent is cut off. Rounded to the
    /// nearest 256th: 10 is 26/256, or 10.2 %
    #[arg(long, value_name = "PERCENT", value_parser = percent, hide_short_help = true)]
    empty_cutoff: Option<u32>,
    /// Bins of an axis, 2 to 64; preset balanced
    #[arg(long, value_name = "N", hide_short_help = true)]
    bins: Option<u32>,
    /// Most levels below the root, 1 to 96
    #[arg(long, value_name = "LEVELS", hide_short_help = true)]
    max_depth: Option<u32>,
    /// Do not clip triangles to the cells they go to: a faster build of a larger tree
    #[arg(long, hide_short_help = true)]
    no_clip: bool,
    /// Stop splitting at so many references for each triangle, and 4,096
    #[arg(long, value_name = "N", hide_short_help = true)]
    reference_cap: Option<u32>,
    /// Stop splitting large nodes at so many nodes for each triangle, and 4,096
    #[arg(long, value_name = "N", hide_short_help = true)]
    node_cap: Option<u32>,
    /// What a split with an empty side is forgiven of its cost, rounded to the nearest 256th; preset
    /// best
    #[arg(long, value_name = "PERCENT", value_parser = percent, hide_short_help = true)]
    empty_bonus: Option<u32>,
    /// Splits in a row that may cost more than a leaf before the node becomes one, 0 to 8; preset
    /// best
    #[arg(long, value_name = "N", hide_short_help = true)]
    bad_splits: Option<u32>,
}

/// One knob: its option, the field of [`BuildConfig`] or of its builder that it sets, and that field; `None` where the
/// builder does not have it.
struct Knob {
    option: &'static str,
    field: &'static str,
    of: fn(&mut BuildConfig) -> Option<&mut u32>,
}

impl Knob {
    fn get(&self, config: &BuildConfig) -> Option<u32> {
        (self.of)(&mut { *config }).copied()
    }
}

macro_rules! knobs {
    ($($option:literal $field:ident $of:expr;)*) => {
        [$(Knob { option: $option, field: stringify!($field), of: $of }),*]
    };
}

/// All but --no-clip, in the order of [`Knobs::values`].
const KNOBS: [Knob; 11] = knobs! {
    "--traversal-cost" traversal_cost |config| Some(&mut config.traversal_cost);
    "--intersection-cost" intersection_cost |config| Some(&mut config.intersection_cost);
    "--block-width" block_width |config| Some(&mut config.block_width);
    "--small-node-limit" small_node_limit |config| Some(&mut config.stages_mut()?.small_node_limit);
    "--empty-cutoff" empty_cutoff |config| Some(&mut config.stages_mut()?.empty_cutoff);
    "--bins" bins BuildConfig::bins_mut;
    "--max-depth" max_depth |config| Some(&mut config.max_depth);
    "--reference-cap" references_per_triangle |config| Some(&mut config.references_per_triangle);
    "--node-cap" nodes_per_triangle |config| Some(&mut config.stages_mut()?.nodes_per_triangle);
    "--empty-bonus" empty_bonus |config| Some(&mut config.sweep_mut()?.empty_bonus);
    "--bad-splits" bad_splits |config| Some(&mut config.sweep_mut()?.bad_splits);
};

impl Knobs {
    /// The preset with these knobs.
    ///
    /// # Errors
    /// Wrong usage: a knob that the preset does not have, or a value out of range.
    pub(super) fn config(&self, preset: Preset) -> Result<BuildConfig, Failure> {
        let mut config = preset.config();
        for (knob, value) in KNOBS.iter().zip(self.values()) {
            let Some(value) = value else { continue };
            let Some(field) = (knob.of)(&mut config) else {
                let has = |preset: &Preset| knob.get(&preset.config()).is_some();
                let presets: Vec<Preset> = Preset::ALL.into_iter().filter(has).collect();
                return Err(Failure::usage(format!(
                    "{} is a knob of {} only; preset {} does not have it",
                    knob.option,
                    names(&presets),
                    preset.name()
                )));
            };
            *field = value;
        }
        config.clip &= !self.no_clip;
        config.validate().map_err(|error| Failure::usage(explain(&error)))?;
        Ok(config)
    }

    /// Whether any knob is the user's.
    pub(super) fn are_given(&self) -> bool {
        self.no_clip || self.values().iter().any(Option::is_some)
    }

    fn values(&self) -> [Option<u32>; 11] {
        [
            self.traversal_cost,
            self.intersection_cost,
            self.block_width,
            self.small_node_limit,
            self.empty_cutoff,
            self.bins,
            self.max_depth,
            self.reference_cap,
            self.node_cap,
            self.empty_bonus,
            self.bad_splits,
        ]
    }
}

/// The knobs that the configuration has, by the names of its fields.
pub(super) fn report(config: &BuildConfig) -> Map<String, Value> {
    let of = |knob: &Knob| Some((knob.field.to_owned(), knob.get(config)?.into()));
    let mut report: Map<String, Value> = KNOBS.iter().filter_map(of).collect();
    report.insert("clip".to_owned(), config.clip.into());
    report
}

/// The same in one line.
pub(super) fn describe(config: &BuildConfig) -> String {
    let mut text = format!(
        "K_T {}, K_I {}, W {}",
        config.traversal_cost, config.intersection_cost, config.block_width
    );
    let stages = config.stages();
    if let Some(stages) = stages {
        let (limit, cutoff) = (stages.small_node_limit, of_256(stages.empty_cutoff));
        text += &format!(", T {limit}, C_e {cutoff}");
    }
    if let Builder::Binned { bins, .. } = config.builder {
        text += &format!(", {bins} bins");
    }
    if let Some(&Sweep { empty_bonus, bad_splits }) = config.sweep() {
        text += &format!(", empty bonus {}, bad splits {bad_splits}", of_256(empty_bonus));
    }
    text += if config.clip { ", clipped" } else { ", not clipped" };
    text += &format!("; at most {} levels", config.max_depth);
    if let Some(stages) = stages {
        text += &format!(", {} nodes", stages.nodes_per_triangle);
    }
    text + &format!(", {} references a triangle", config.references_per_triangle)
}

/// An error of a configuration in words of the command line.
fn explain(error: &ConfigError) -> String {
    match *error {
        ConfigError::OutOfRange { field, value, least, most } => {
            let option = KNOBS.iter().find(|knob| knob.field == field).map_or(field, |k| k.option);
            let shown = |value| match field {
                "empty_cutoff" | "empty_bonus" => format!("{} ({value}/256)", of_256(value)),
                _ => value.to_string(),
            };
            format!(
                "{option} is {}, but must be from {} to {}",
                shown(value),
                shown(least),
                shown(most)
            )
        }
        ConfigError::CostTooLarge { sum, most } => format!(
            "--traversal-cost + 2 * --intersection-cost * ceil(--small-node-limit / --block-width) \
             is {sum}, but must be at most {most}; only the ratio of the two costs matters"
        ),
        error => error.to_string(),
    }
}

/// `fast, narrow and balanced`.
fn names(presets: &[Preset]) -> String {
    let names: Vec<&str> = presets.iter().map(|preset| preset.name()).collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => names.concat(),
    }
}

/// 256ths as a percentage: `25 %`, `10.2 %`.
fn of_256(parts: u32) -> String {
    let percent = format!("{:.1}", f64::from(parts) * 100.0 / 256.0);
    format!("{} %", percent.trim_end_matches(".0"))
}

/// A percentage, as the nearest 256th; halves go up.
fn percent(text: &str) -> Result<u32, String> {
    let number = text.trim_end_matches('%').trim_end().parse::<f64>().ok();
    let number = number.filter(|percent| (0.0..=100.0).contains(percent));
    number
        // A half in 256ths is a multiple of 25/128, so neither product nor quotient rounds it.
        .map(|percent| (percent * 256.0 / 100.0).round() as u32)
        .ok_or_else(|| "give a percentage from 0 to 100, such as 25 or 12.5".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_are_256ths() {
        for (text, parts) in [
            ("25", 64),
            ("10", 26),
            ("0", 0),
            ("100", 256),
            ("12.5%", 32),
            ("0.1", 0),
            ("50 %", 128),
        ] {
            assert_eq!(percent(text), Ok(parts), "{text}");
        }
        // Half a 256th is 25/128 of a percent.
        assert_eq!(percent("0.1953125"), Ok(1));
        assert_eq!(percent("0.1953124"), Ok(0));
        for bad in ["", "%", "-1", "100.1", "NaN", "inf", "ten"] {
            assert!(percent(bad).is_err(), "{bad}");
        }
        assert_eq!(
            (of_256(64), of_256(26), of_256(255)),
            ("25 %".into(), "10.2 %".into(), "99.6 %".into())
        );
    }

    /// Every knob that a preset has shapes its trees; none other can be set.
    #[test]
    fn knobs_that_count_for_nothing_are_refused() {
        for preset in Preset::ALL {
            for (index, knob) in KNOBS.iter().enumerate() {
                let mut config = preset.config();
                match (knob.of)(&mut config) {
                    Some(field) => *field += 1,
                    None => {
                        let failure = with_value(index, 1).config(preset).expect_err(knob.option);
                        assert!(format!("{failure:?}").contains(knob.option), "{failure:?}");
                        continue;
                    }
                }
                assert_ne!(config.words(), preset.config().words(), "{}", knob.option);
            }
        }
    }

    /// One knob alone, by its place in [`KNOBS`].
    fn with_value(index: usize, value: u32) -> Knobs {
        let mut values = [None; 11];
        values[index] = Some(value);
        let [a, b, c, d, e, f, g, h, i, j, k] = values;
        Knobs {
            traversal_cost: a,
            intersection_cost: b,
            block_width: c,
            small_node_limit: d,
            empty_cutoff: e,
            bins: f,
            max_depth: g,
            no_clip: false,
            reference_cap: h,
            node_cap: i,
            empty_bonus: j,
            bad_splits: k,
        }
    }

    #[test]
    fn each_knob_sets_its_own_field() {
        for (index, knob) in KNOBS.iter().enumerate() {
            let has = |preset: &Preset| knob.get(&preset.config()).is_some();
            let preset = Preset::ALL.into_iter().find(has).expect("a preset that has it");
            // Another value than the default, which may be 0.
            let value =
                knob.get(&preset.config()).and_then(|knob| knob.checked_sub(1)).unwrap_or(1);
            let knobs = with_value(index, value);
            let mut want = preset.config();
            *(knob.of)(&mut want).expect("its field") = value;
            match knobs.config(preset) {
                Ok(config) => assert_eq!(config, want, "{}", knob.option),
                // K_T is 1 by default; the error names the option.
                Err(failure) => assert!(format!("{failure:?}").contains(knob.option)),
            }
        }
    }

    #[test]
    fn without_knobs_a_preset_is_itself() {
        for preset in Preset::ALL {
            assert_eq!(Knobs::default().config(preset).ok(), Some(preset.config()));
        }
    }
}

//! A preset chosen for a mesh, the rays to come and the machine, by measured models.
//!
//! A better tree takes longer to build and answers rays sooner, so the number of rays decides. What builds and rays take was measured on
//! scenes of many kinds and sizes (`measured.csv`); [`Models`] are fitted to that table, and [`choose`] takes the preset with the least
//! expected time of one build and all rays. How often that is right, and what it loses, is in `docs/presets.md`.
//!
//! The choice may differ between machines, and with it the tree. Where trees are compared or kept, name a preset.

mod fit;
mod mesh_traits;
mod table;
#[cfg(test)]
mod tests;

use crate::InstructionSet;
use fit::Fit;
use splitplane_core::config::Preset;
use std::fmt;
use std::sync::OnceLock;
use table::Row;

pub use mesh_traits::MeshTraits;
pub use table::{COLUMNS, TableError};

/// The table that [`Models::measured`] are fitted to.
const MEASURED: &str = include_str!("auto_preset/measured.csv");

/// The part of a build that threads do not share: the longest chain of work over all work is 1.5 to 7.6 % of builds of six scenes, and two threads
/// built at 0.87 to 0.96 of twice the speed by `fast`. The same for all presets.
const SERIAL: f64 = 0.04;

/// What does the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Machine {
    /// The instruction set that builds and queries use.
    pub instruction_set: InstructionSet,
    /// Threads that share builds and rays; 0 counts as 1.
    pub threads: usize,
}

impl Machine {
    /// This one, with the threads of the pool that the caller is in.
    pub fn here() -> Machine {
        Machine { instruction_set: InstructionSet::detect(), threads: rayon::current_num_threads() }
    }
}

/// What one preset is expected to take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The preset.
    pub preset: Preset,
    /// Seconds of a build, by the clock.
    pub build: f64,
    /// Seconds a ray, by the clock: the mean of camera, shadow and bounced rays and of chords.
    pub ray: f64,
    /// Seconds of one build and all rays.
    pub total: f64,
    /// How far measured scenes are from the model of builds: the standard deviation of the logarithm of measured over modelled.
    pub build_spread: f64,
    /// The same of rays.
    pub ray_spread: f64,
}

/// A preset, and why it was chosen: `Display` says it in one line.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The preset with the least expected time; of equal ones the first of [`Preset::ALL`].
    pub preset: Preset,
    /// All presets that were measured, in the order of [`Preset::ALL`].
    pub estimates: Vec<Estimate>,
    /// The rays that were announced.
    pub rays: u64,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// The machine asked about.
    pub machine: Machine,
    /// The instruction set whose measurements decided: another one than the machine's where that was not measured.
    pub measured: InstructionSet,
    /// Whether scenes of about as many triangles were measured: not fewer than the smallest and not more than the largest.
    pub in_range: bool,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Choice { preset, rays, triangles, machine, .. } = self;
        if *triangles == 0 {
            return write!(f, "auto: {}, since there are no triangles", preset.name());
        }
        let (set, threads) = (machine.instruction_set.name(), machine.threads.max(1));
        let many = if threads == 1 { "" } else { "s" };
        write!(
            f,
            "auto: with {set} on {threads} thread{many}, a build over {triangles} triangles and {rays} rays are expected to take "
        )?;
        let mut sorted: Vec<&Estimate> = self.estimates.iter().collect();
        sorted.sort_by(|a, b| a.total.total_cmp(&b.total));
        for (place, estimate) in sorted.into_iter().enumerate() {
            let comma = if place == 0 { "" } else { ", " };
            write!(f, "{comma}{} by {}", Seconds(estimate.total), estimate.preset.name())?;
        }
        if self.measured != machine.instruction_set {
            write!(f, "; measured with {}", self.measured.name())?;
        }
        if !self.in_range {
            write!(f, "; no scene of this size was measured")?;
        }
        Ok(())
    }
}

/// A time with three digits.
struct Seconds(f64);

impl fmt::Display for Seconds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (value, unit) = match self.0 {
            seconds if seconds < 1e-3 => (seconds * 1e6, "us"),
            seconds if seconds < 1.0 => (seconds * 1e3, "ms"),
            seconds => (seconds, "s"),
        };
        match value {
            0.0 => write!(f, "0 {unit}"),
            value if value < 10.0 => write!(f, "{value:.2} {unit}"),
            value if value < 100.0 => write!(f, "{value:.1} {unit}"),
            value if value < 1e6 => write!(f, "{value:.0} {unit}"),
            value => write!(f, "{value:.2e} {unit}"),
        }
    }
}

/// Chooses by what was measured: [`Models::measured`].
///
/// `rays` are all that one build is to answer: of a still scene those of its whole life, of one that is rebuilt for every frame those of a
/// frame.
pub fn choose(mesh: &MeshTraits, rays: u64, machine: &Machine) -> Choice {
    Models::measured().choose(mesh, rays, machine)
}

/// What builds and rays take, as functions of the mesh, for each instruction set and preset.
#[derive(Clone, Debug)]
pub struct Models {
    sets: Vec<OfSet>,
}

/// The models of one instruction set.
#[derive(Clone, Debug)]
struct OfSet {
    set: InstructionSet,
    /// Triangles of the smallest and of the largest scene.
    sizes: [f64; 2],
    /// The least and the greatest skew.
    skews: [f64; 2],
    /// In the order of [`Preset::ALL`].
    presets: Vec<OfPreset>,
}

#[derive(Clone, Debug)]
struct OfPreset {
    preset: Preset,
    /// Of the logarithm of seconds of a build on one thread over triangles.
    build: Fit,
    /// Of the logarithm of seconds a ray on one thread.
    ray: Fit,
}

impl Models {
    /// Those of the table that comes with this library: its first lines say when, on which processor and by which command it was made.
    pub fn measured() -> &'static Models {
        static FITTED: OnceLock<Models> = OnceLock::new();
        FITTED.get_or_init(|| Models::parse(MEASURED).expect("a table whose form a test checks"))
    }

    /// Fits models to a table of your own machine, as `splitplane-embree --table` writes it: a line for each scene and preset, and lines of
    /// comments that begin with `#`.
    ///
    /// # Errors
    /// A line that is not of this form, or no lines.
    pub fn parse(table: &str) -> Result<Models, TableError> {
        Models::fit(&table::parse(table)?)
    }

    fn fit(rows: &[Row]) -> Result<Models, TableError> {
        let mut sets: Vec<InstructionSet> = rows.iter().map(|row| row.set).collect();
        sets.sort_by_key(|&set| set as u32);
        sets.dedup();
        if sets.is_empty() {
            return Err(TableError::Empty);
        }
        let sets = sets.into_iter().map(|set| {
            let own: Vec<&Row> = rows.iter().filter(|row| row.set == set).collect();
            OfSet::fit(set, &own)
        });
        Ok(Models { sets: sets.collect() })
    }

    /// The preset with the least expected time.
    pub fn choose(&self, mesh: &MeshTraits, rays: u64, machine: &Machine) -> Choice {
        let models = self.of(machine.instruction_set);
        let threads = machine.threads.max(1) as f64;
        let of = |model: &OfPreset| models.estimate(model, mesh, rays, threads);
        let estimates: Vec<Estimate> = models.presets.iter().map(of).collect();
        let mut preset = Preset::default();
        let mut least = f64::INFINITY;
        // Of a mesh without triangles nothing takes time, whatever its tree.
        for estimate in estimates.iter().filter(|_| mesh.triangles > 0) {
            if estimate.total < least {
                (preset, least) = (estimate.preset, estimate.total);
            }
        }
        Choice {
            preset,
            estimates,
            rays,
            triangles: mesh.triangles,
            machine: *machine,
            measured: models.set,
            in_range: (models.sizes[0]..=models.sizes[1]).contains(&(mesh.triangles as f64)),
        }
    }

    /// The models of a set, or of the best one below it; where there is none, of the worst.
    fn of(&self, set: InstructionSet) -> &OfSet {
        let known = self.sets.iter().rfind(|models| models.set as u32 <= set as u32);
        known.unwrap_or(&self.sets[0])
    }
}

impl OfSet {
    fn fit(set: InstructionSet, rows: &[&Row]) -> OfSet {
        let range = |of: fn(&Row) -> f64| {
            let start = [f64::INFINITY, f64::NEG_INFINITY];
            rows.iter().fold(start, |[least, most], row| [least.min(of(row)), most.max(of(row))])
        };
        let presets = Preset::ALL.into_iter().filter_map(|preset| {
            let own: Vec<&&Row> = rows.iter().filter(|row| row.preset == preset).collect();
            let fit = |of: fn(&Row) -> f64| {
                Fit::least_squares(
                    own.iter().map(|row| (terms(row.triangles, row.skew), of(row).ln())),
                )
            };
            let build = fit(|row| row.build / row.triangles)?;
            Some(OfPreset { preset, build, ray: fit(|row| row.ray)? })
        });
        OfSet {
            set,
            sizes: range(|row| row.triangles),
            skews: range(|row| row.skew),
            presets: presets.collect(),
        }
    }

    /// Beyond what was measured, a build takes as long for each triangle as at the nearest size that was, and a ray as long as there.
    fn estimate(&self, model: &OfPreset, mesh: &MeshTraits, rays: u64, threads: f64) -> Estimate {
        let triangles = mesh.triangles as f64;
        let [least, most] = self.skews;
        let skew = if mesh.size_skew.is_nan() { least } else { mesh.size_skew.clamp(least, most) };
        let at = terms(triangles.clamp(self.sizes[0], self.sizes[1]), skew);
        let alone = model.build.at(&at).exp() * triangles;
        let build = alone * (SERIAL + (1.0 - SERIAL) / threads);
        let ray = model.ray.at(&at).exp() / threads;
        Estimate {
            preset: model.preset,
            build,
            ray,
            total: build + rays as f64 * ray,
            build_spread: model.build.spread,
            ray_spread: model.ray.spread,
        }
    }
}

/// What logarithms of times are linear in.
fn terms(triangles: f64, skew: f64) -> [f64; 3] {
    [1.0, triangles.ln(), skew]
}

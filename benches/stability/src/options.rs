//! The command line.

use clap::Parser;
use splitplane::{Accuracy, BackendKind, Preset};
use splitplane_test_support::stability::{Place, Side, Target};
use std::path::PathBuf;

/// Counts rays that a backend misses or answers wrongly, against an exact oracle.
///
/// Exit code 0: nothing wrong; 1: rays went through a closed surface, or answers that rounding does
/// not account for (with accuracy exact: any answer that is not the oracle's); 2: usage; 5: no such
/// backend.
#[derive(Parser, Debug)]
#[command(version)]
pub(crate) struct Options {
    /// Rays of every aim at every place and from every side, shared among the scenes
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,
    /// What rays are aimed at, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "random,edges,vertices", value_parser = target)]
    pub aims: Vec<Target>,
    /// Where mesh and rays are, separated by commas: near the origin, the mesh far from it, the rays
    /// far from the mesh
    #[arg(long, value_delimiter = ',', default_value = "near,far", value_parser = place)]
    pub place: Vec<Place>,
    /// From which side rays come, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "inside,outside", value_parser = side)]
    pub from: Vec<Side>,
    /// Who answers
    #[arg(long, default_value = "cpu", value_parser = |name: &str| name.parse::<BackendKind>())]
    pub backend: BackendKind,
    /// Which triangle test
    #[arg(long, default_value = "watertight", value_parser = accuracy)]
    pub accuracy: Accuracy,
    /// Which builder
    #[arg(long, default_value = "fast", value_parser = preset)]
    pub preset: Preset,
    /// Scenes, separated by commas: `sphere[:RINGS]`, nested, seams, seams-oblique, boxes,
    /// `awkward:NAME`, `builtin:NAME[:SIZE]` or .obj files
    #[arg(long, value_delimiter = ',', default_value = "sphere,nested,seams,seams-oblique,boxes")]
    pub scene: Vec<String>,
    /// Another seed gives other rays
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Ask for closest hits only
    #[arg(long)]
    pub closest_only: bool,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

impl Options {
    /// Whether answers must be the oracle's to the bit.
    pub(crate) fn is_exact(&self) -> bool {
        self.accuracy == Accuracy::Exact
    }
}

fn target(name: &str) -> Result<Target, String> {
    by_name(Target::ALL, Target::name, name)
}

fn place(name: &str) -> Result<Place, String> {
    by_name(Place::ALL, Place::name, name)
}

fn side(name: &str) -> Result<Side, String> {
    by_name(Side::ALL, Side::name, name)
}

fn accuracy(name: &str) -> Result<Accuracy, String> {
    by_name(Accuracy::ALL, Accuracy::name, name)
}

fn preset(name: &str) -> Result<Preset, String> {
    by_name(Preset::ALL, Preset::name, name)
}

fn by_name<T: Copy, const N: usize>(
    all: [T; N],
    name_of: fn(T) -> &'static str,
    name: &str,
) -> Result<T, String> {
    let found = all.into_iter().find(|&item| name_of(item) == name);
    found.ok_or_else(|| format!("there are {}", all.map(name_of).join(", ")))
}

//! The command line.

use clap::Parser;
use std::path::PathBuf;

/// Traces rays along surfaces: in the planes of triangles, along edges, from inside closed surfaces past their own
/// faces. Counts those that are lost, and those whose answer depends on the tree, the layout, the instruction set or
/// on how they are asked.
///
/// Each ray is answered by a tree of one leaf on the CPU backend, which tests all triangles; every so many are also
/// answered by the core's reference traversal. Then it is asked of some of the 18 configurations (3 presets, 2
/// layouts, the instruction sets of this processor), in one of three ways for closest hits and one of three for any
/// hit. From surface to surface the configurations and the ways take turns; `--configurations 18` asks all of every
/// ray. With `--gpu` a device is asked instead: trees are the CPU's, and presets take turns.
///
/// Exit code 0: all answers as demanded; 1: not; 2: usage.
#[derive(Parser, Debug)]
#[command(version)]
pub(crate) struct Options {
    /// Rays in all, rounded up to whole surfaces
    #[arg(long, default_value_t = 10_000_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,
    /// Another seed gives other surfaces and rays
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Threads; what is counted does not depend on them
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: u32,
    /// Rays of each kind at a surface
    #[arg(long, default_value_t = 2048, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub each: u32,
    /// Configurations that are asked at a surface
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub configurations: u32,
    /// Ask a GPU in place of the configurations: the adapter of this number in `splitplane adapters`, or that
    /// has this in its name
    #[arg(long, value_name = "ADAPTER", conflicts_with = "configurations")]
    pub gpu: Option<String>,
    /// Of how many rays one is answered by the reference traversal too
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
    pub sample: u32,
    /// Write mesh (.obj) and ray (.rays) of the first failure of each sort into this folder
    #[arg(long, value_name = "FOLDER")]
    pub save: Option<PathBuf>,
}

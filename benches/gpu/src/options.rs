//! The command line.

use std::path::PathBuf;

use clap::Parser;
use splitplane::gpu::RayStack;
use splitplane::{BuildConfig, Preset};

/// Measures splitplane's builds and queries on a GPU beside the CPU's, and compares every bit.
///
/// Exit code 0: all equal; 1: something differs or a scene failed; 5: no GPU.
#[derive(Parser, Debug)]
#[command(version)]
pub(crate) struct Options {
    /// Part of an adapter's name, or its number in the list of `splitplane adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    pub adapter: Option<String>,
    /// .obj files or `builtin:NAME[:SIZE]`, separated by commas
    #[arg(long, value_name = "SCENES", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Presets to build by, one after the other, separated by commas
    #[arg(long, value_name = "fast|narrow|balanced", value_delimiter = ',', default_value = "fast", value_parser = preset)]
    pub preset: Vec<Preset>,
    /// Another block width W than the presets'
    #[arg(long, value_name = "W", requires = "no_predict")]
    block_width: Option<u32>,
    /// Another intersection cost K_I than the presets'
    #[arg(long, value_name = "K_I", requires = "no_predict")]
    intersection_cost: Option<u32>,
    /// Trace batches of watertight rays through compressed nodes
    #[arg(long)]
    pub compressed: bool,
    /// Where rays keep what they have yet to visit; by default what suits the adapter's vendor
    #[arg(long, value_name = "private|workgroup", value_parser = ray_stack)]
    pub ray_stack: Option<RayStack>,
    /// Repeats of every figure; medians are reported
    #[arg(long, default_value_t = 11, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub reps: u32,
    /// Rays of the set `primary` and of `chords`, about
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..=100_000_000))]
    rays: Option<u32>,
    /// Take the rays from DIR/{primary,shadow,bounce,chords}.rays: raw `ox oy oz dx dy dz tmin tmax`
    #[arg(long, value_name = "DIR")]
    pub rays_from: Option<PathBuf>,
    /// Where the figures are written
    #[arg(long, value_name = "DIR", default_value = "out/gpu")]
    pub out: PathBuf,
    /// Sizes for software adapters: fewer rays, small copies
    #[arg(long)]
    pub small: bool,
    /// Compare only: nothing is timed, every ray is traced once on each side
    #[arg(long)]
    pub check: bool,
    /// Builds only
    #[arg(long)]
    pub no_rays: bool,
    /// With --predict: rays only
    #[arg(long, requires = "predict", conflicts_with = "no_rays")]
    pub no_builds: bool,
    /// Count and predict only: nothing is measured
    #[arg(long, conflicts_with = "check")]
    pub predict: bool,
    /// Count nothing, and predict nothing
    #[arg(long, conflicts_with = "predict")]
    pub no_predict: bool,
    /// Devices to predict for, separated by commas: h200, h100, rtx-4070-ti, radeon-780m; by default the one at hand, or all
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub device: Vec<String>,
}

/// Where rays keep their stacks, by the name of WGSL's address space.
fn ray_stack(name: &str) -> Result<RayStack, String> {
    match name {
        "private" => Ok(RayStack::Private),
        "workgroup" => Ok(RayStack::Workgroup),
        _ => Err("it is private or workgroup".to_owned()),
    }
}

/// A preset that devices build, by its name.
fn preset(name: &str) -> Result<Preset, String> {
    let built = Preset::ALL.into_iter().filter(|preset| preset.planes().is_some());
    let names: Vec<_> = built.clone().map(Preset::name).collect();
    let mut found = built.filter(|preset| preset.name() == name);
    found.next().ok_or_else(|| format!("a GPU builds {}", names.join(" and ")))
}

impl Options {
    /// The scenes to measure.
    pub(crate) fn scenes(&self) -> Vec<String> {
        match (&self.scenes[..], self.small) {
            ([], false) => vec!["builtin:city:1000000".into()],
            ([], true) => vec!["builtin:city:20000".into()],
            (given, _) => given.to_vec(),
        }
    }

    /// A preset with the knobs that were asked for.
    pub(crate) fn config(&self, preset: Preset) -> BuildConfig {
        let own = preset.config();
        BuildConfig {
            block_width: self.block_width.unwrap_or(own.block_width),
            intersection_cost: self.intersection_cost.unwrap_or(own.intersection_cost),
            ..own
        }
    }

    /// Its name, with these knobs and how rays go.
    pub(crate) fn label(&self, preset: Preset) -> String {
        let mut label = preset.name().to_owned();
        for (knob, value) in [("W", self.block_width), ("K_I", self.intersection_cost)] {
            label.extend(value.map(|value| format!(", {knob} {value}")));
        }
        label + if self.compressed { ", compressed" } else { "" }
    }

    /// Width and height of the picture whose rays are `primary`, 16 to 9.
    pub(crate) fn picture(&self) -> [u32; 2] {
        let rays = self.rays.unwrap_or(if self.small { 480 * 270 } else { 1920 * 1080 });
        let height = (f64::from(rays) * 9.0 / 16.0).sqrt().round().max(1.0) as u32;
        [rays.div_ceil(height).max(1), height]
    }

    /// The most triangles of a built-in city that is counted on an adapter; what larger ones do is scaled.
    pub(crate) fn counted_triangles(&self, kind: wgpu::DeviceType) -> u64 {
        match kind {
            _ if self.small => 20_000,
            wgpu::DeviceType::Cpu => 100_000,
            _ => 20_000_000,
        }
    }

    /// Width and height of the picture whose rays are counted.
    pub(crate) fn counted_picture(&self) -> [u32; 2] {
        if self.small { [160, 90] } else { [480, 270] }
    }

    /// Bytes of the buffers that are copied to measure bandwidth.
    pub(crate) fn copied_bytes(&self) -> u64 {
        if self.small { 16 << 20 } else { 256 << 20 }
    }
}

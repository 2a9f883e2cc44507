//! Options that every verb takes, and values in the forms users write.

use super::ending::TimeLimit;
use super::failure::Failure;
use super::knobs::Knobs;
use super::output;
use clap::{Args, ValueEnum};
use splitplane::auto_preset::{self, Machine, MeshTraits};
use splitplane::backend::OpenedEngine;
use splitplane::render::Size;
use splitplane::scene::SceneOptions;
use splitplane::{
    Accuracy, BackendKind, BuildError, BuildOptions, Mesh, OpenOptions, Opened, Preset,
    QueryLayout, QueryOptions,
};

#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Common options")]
pub(super) struct Common {
    /// What does the work; a GPU asked for is never replaced by the CPU
    #[arg(long, value_name = "auto|cpu|wgpu", default_value = "auto")]
    pub(super) backend: BackendKind,
    /// The GPU, by part of its name or by its number in the list of `splitplane adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
    /// Allow --backend wgpu a GPU whose results differ from the CPU's in some bits
    #[arg(long)]
    allow_structural: bool,
    /// How the tree is built; its knobs are listed by --help
    #[arg(long, value_enum, default_value_t = AskedPreset::Fast)]
    preset: AskedPreset,
    /// Which ray/triangle test; `fast` may lose rays aimed at edges. Of closest points `exact` finds the nearest triangle
    /// of real arithmetic, the others that of the least distance in f64
    #[arg(long, value_enum, default_value_t = AccuracyName::Watertight)]
    accuracy: AccuracyName,
    /// Threads that share the work; all cores when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Most bytes a build or an answer of all hits may hold besides the mesh, and most that are held before that while a
    /// scene file is read: its text, its entries, instances that it bakes, and .obj files after the first; k, M and G
    /// stand for powers of 1024
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub(super) max_memory: Option<u64>,
    /// Most bytes of a file that is read whole: a scene, a frame of it, rays. Half of the machine's memory
    /// when left out, and 1G of rays that come from a pipe or a device
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub(super) max_file: Option<u64>,
    /// Query layout without copies of corners in leaves: about half the memory, slower rays, the same hits;
    /// on the CPU only
    #[arg(long)]
    compact: bool,
    #[command(flatten)]
    pub(super) time: TimeLimit,
    /// Report as one JSON object
    #[arg(long)]
    pub(super) json: bool,
    /// Print nothing but errors and what --json asks for
    #[arg(long, short)]
    pub(super) quiet: bool,
    #[command(flatten)]
    knobs: Knobs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum PresetName {
    /// The builder of Zhou et al. 2008: spatial medians above, SAH on masks below
    Fast,
    /// As fast, for GPUs: small leaves, as one triangle is tested at a time
    Narrow,
    /// Binned SAH above, SAH on masks below: slower to build, faster to trace
    Balanced,
    /// Offline: SAH over all planes, with clipping; on the CPU only
    Best,
}

/// What `--preset` takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum AskedPreset {
    /// The builder of Zhou et al. 2008: spatial medians above, SAH on masks below
    Fast,
    /// As fast, for GPUs: small leaves, as one triangle is tested at a time
    Narrow,
    /// Binned SAH above, SAH on masks below: slower to build, faster to trace
    Balanced,
    /// Offline: SAH over all planes, with clipping; on the CPU only
    Best,
    /// The one that is expected to take the least time for a build and the rays of one mesh, by measurements; says why.
    /// It may differ between machines. On the CPU only
    Auto,
}

/// How many rays the tree is to answer, or why a verb cannot say.
pub(super) type Announced = Result<u64, &'static str>;

/// The options of a build, and where `auto` chose the preset, why.
pub(super) struct Settled {
    pub(super) options: BuildOptions<'static>,
    pub(super) reason: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum AccuracyName {
    /// Moeller and Trumbore 1997
    Fast,
    /// Woop, Benthin and Wald 2013
    Watertight,
    /// What real arithmetic gives for the mesh and the rays as they are
    Exact,
}

impl PresetName {
    pub(super) const fn preset(self) -> Preset {
        match self {
            PresetName::Fast => Preset::Fast,
            PresetName::Narrow => Preset::Narrow,
            PresetName::Balanced => Preset::Balanced,
            PresetName::Best => Preset::Best,
        }
    }
}

impl AskedPreset {
    /// `None` for `auto`.
    const fn preset(self) -> Option<Preset> {
        match self {
            AskedPreset::Fast => Some(Preset::Fast),
            AskedPreset::Narrow => Some(Preset::Narrow),
            AskedPreset::Balanced => Some(Preset::Balanced),
            AskedPreset::Best => Some(Preset::Best),
            AskedPreset::Auto => None,
        }
    }
}

impl AccuracyName {
    pub(super) const fn accuracy(self) -> Accuracy {
        match self {
            AccuracyName::Fast => Accuracy::Fast,
            AccuracyName::Watertight => Accuracy::Watertight,
            AccuracyName::Exact => Accuracy::Exact,
        }
    }
}

impl Common {
    pub(super) fn open_options(&self) -> OpenOptions {
        super::probe::limited(OpenOptions {
            adapter: self.adapter.clone(),
            allow_structural: self.allow_structural,
            preset: self.preset.preset().unwrap_or_default(),
            ..OpenOptions::default()
        })
    }

    /// Opens the backend.
    pub(super) fn open(&self) -> Result<Opened, Failure> {
        let OpenedEngine { engine, reason } = self.open_engine()?;
        Ok(Opened { backend: engine.into_backend(), reason })
    }

    /// The same, by its own type.
    pub(super) fn open_engine(&self) -> Result<OpenedEngine, Failure> {
        let options = self.open_options();
        if self.is_auto() && self.backend == BackendKind::Auto {
            let opened = BackendKind::Cpu.open_engine(&options)?;
            let reason = "auto: the CPU, where the presets of --preset auto were measured".into();
            return Ok(OpenedEngine { reason, ..opened });
        }
        Ok(self.backend.open_engine(&options)?)
    }

    /// Whether the preset is still to be chosen.
    pub(super) fn is_auto(&self) -> bool {
        self.preset == AskedPreset::Auto
    }

    /// What is wrong with the options of a build, to be said before any work.
    ///
    /// # Errors
    /// Wrong usage, as of [`Common::build_options`].
    pub(super) fn check(&self) -> Result<(), Failure> {
        if !self.is_auto() {
            return self.build_options().map(drop);
        }
        if self.backend == BackendKind::Wgpu {
            return Err(Failure::usage(
                "--preset auto chooses by measurements of the CPU; name a preset for a GPU, or take --backend cpu",
            ));
        }
        if self.knobs.are_given() {
            return Err(Failure::usage(
                "--preset auto chooses a preset as it is; name one to change its knobs",
            ));
        }
        Ok(())
    }

    /// The same where one mesh is built, for so many rays.
    ///
    /// # Errors
    /// As [`Common::check`], and `auto` where the number of rays is not known.
    pub(super) fn check_for(&self, rays: Announced) -> Result<(), Failure> {
        self.check()?;
        match rays {
            Err(why) if self.is_auto() => Err(Failure::usage(why)),
            _ => Ok(()),
        }
    }

    /// The options of a build over one mesh: `auto` chooses the preset for so many rays. To be called inside
    /// [`in_pool`](super::prepared::in_pool), whose threads count.
    ///
    /// # Errors
    /// As [`Common::check_for`].
    pub(super) fn settle(&self, mesh: &Mesh<'_>, rays: Announced) -> Result<Settled, Failure> {
        self.check_for(rays)?;
        let (Ok(rays), true) = (rays, self.is_auto()) else {
            return Ok(Settled { options: self.build_options()?, reason: None });
        };
        let choice = auto_preset::choose(&MeshTraits::of(mesh), rays, &Machine::here());
        let options = self.options_of(choice.preset)?;
        let reason = choice.to_string();
        if !self.quiet {
            output::note(&format!("preset: {} ({reason})", choice.preset.name()));
        }
        Ok(Settled { options, reason: Some(reason) })
    }

    /// The preset with the knobs given, checked.
    ///
    /// # Errors
    /// Wrong usage: a knob that the preset does not have, or a value out of range; `auto`, which needs one mesh and its rays.
    pub(super) fn build_options(&self) -> Result<BuildOptions<'static>, Failure> {
        let preset = self.preset.preset().ok_or_else(|| {
            Failure::usage(
                "--preset auto chooses for the rays through one mesh, in build, stats, query, verify, render and \
                 animate; name a preset",
            )
        })?;
        self.options_of(preset)
    }

    fn options_of(&self, preset: Preset) -> Result<BuildOptions<'static>, Failure> {
        // Said before a device is opened.
        if self.backend == BackendKind::Wgpu && preset.planes().is_none() {
            return Err(BuildError::PresetNotOnDevice { preset }.into());
        }
        if self.compact && self.backend == BackendKind::Wgpu {
            return Err(Failure::usage("--compact is for trees on the CPU; take --backend cpu"));
        }
        let layout = if self.compact { QueryLayout::Compact } else { QueryLayout::Fast };
        let config = self.knobs.config(preset)?;
        Ok(BuildOptions { config, max_memory: self.max_memory, layout, watch: None })
    }

    /// How a scene is read that is not drawn: nobody sees its textures.
    pub(super) fn bare_scene(&self) -> SceneOptions {
        SceneOptions {
            textures: false,
            file_limit: self.max_file,
            memory_limit: self.max_memory,
            ..SceneOptions::default()
        }
    }

    pub(super) fn query_options(&self) -> QueryOptions<'static> {
        let accuracy = self.accuracy.accuracy();
        QueryOptions { accuracy, ..QueryOptions::default() }
    }

    /// The accuracy of closest points, by name.
    pub(super) fn nearness_name(&self) -> &'static str {
        match self.accuracy.accuracy() {
            Accuracy::Exact => "exact",
            _ => "f64",
        }
    }

    pub(super) fn accuracy_name(&self) -> &'static str {
        self.query_options().accuracy.name()
    }
}

/// `4096`, `64k`, `512M`, `2G`.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let shift = match text.bytes().last() {
        Some(b'k' | b'K') => 10,
        Some(b'm' | b'M') => 20,
        Some(b'g' | b'G') => 30,
        _ => 0,
    };
    let digits = if shift > 0 { &text[..text.len() - 1] } else { text };
    let number: u64 = digits
        .parse()
        .map_err(|_| "give a whole number of bytes, such as 500000000, 512M or 2G".to_owned())?;
    number.checked_mul(1 << shift).ok_or_else(|| "this is more than 64 bits can count".to_owned())
}

/// `1280x720`.
pub(super) fn size(text: &str) -> Result<Size, String> {
    let sides =
        text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let (width, height) =
        sides.ok_or_else(|| "give width and height in pixels, such as 1280x720".to_owned())?;
    Size::new(width, height).map_err(|error| error.to_string())
}

/// A distance that something may be within.
pub(super) fn distance(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(distance) if distance >= 0.0 => Ok(distance),
        Ok(_) => Err("a distance is 0 or more".into()),
        Err(error) => Err(error.to_string()),
    }
}

/// `x,y,z`.
pub(super) fn point(text: &str) -> Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let point = numbers.and_then(|numbers| <[f32; 3]>::try_from(numbers).ok());
    let point = point.filter(|point| point.iter().all(|x| x.is_finite()));
    point.ok_or_else(|| "give three finite numbers, such as 1,2.5,-3".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_with_and_without_suffix() {
        assert_eq!(bytes("123"), Ok(123));
        assert_eq!(bytes("2k"), Ok(2048));
        assert_eq!(bytes("3G"), Ok(3 << 30));
        for bad in ["", "k", "-1", "1.5M", "99999999999999999999", "99999999999G", "1µ"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_and_points() {
        assert_eq!(size("64x36").unwrap().width(), 64);
        for bad in ["64", "x", "0x5", "-1x5", "99999x99999", "4x4x4"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(point("1, 2.5,-3"), Ok([1.0, 2.5, -3.0]));
        for bad in ["1,2", "1,2,3,4", "a,b,c", "1,2,NaN", "1,2,1e39"] {
            assert!(point(bad).is_err(), "{bad}");
        }
    }
}

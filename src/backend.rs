//! Which backend does the work, chosen by name at run time.

#[cfg(feature = "wgpu")]
mod connect;
mod engine;
#[cfg(feature = "wgpu")]
mod gpu;

use splitplane_core::backend::Backend;
use splitplane_core::config::Preset;
use std::ffi::OsString;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;
use thiserror::Error;

pub use engine::{Engine, OpenedEngine};
#[cfg(feature = "wgpu")]
#[doc(hidden)]
pub use gpu::failed;
#[cfg(feature = "wgpu")]
pub use gpu::{adapters, adapters_with, open_gpu};
#[cfg(feature = "wgpu")]
pub use splitplane_wgpu::probe::{Probe, answer_probe};

/// A backend by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum BackendKind {
    /// The best one this build and this machine offer; [`Opened::reason`] says which and why.
    #[default]
    Auto,
    /// The cores of this machine, through rayon.
    Cpu,
    /// A GPU through wgpu. Never answered by another backend: where there is none, opening fails.
    Wgpu,
}

/// Which device to open, and its limits. For [`BackendKind::Cpu`] an adapter's name is an error
/// ([`OpenError::AdapterForCpu`]); it ignores the rest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// Part of a GPU adapter's name in any case, or its index in the list of adapters. When `None`,
    /// the environment variable `WGPU_ADAPTER_NAME` decides, and without it the kind of adapter.
    /// [`BackendKind::Auto`] passes over a variable that names no adapter.
    pub adapter: Option<String>,
    /// Take an adapter whose trees or hits differ from the CPU's in some bits.
    /// [`BackendKind::Auto`] never takes one.
    pub allow_structural: bool,
    /// Request no more than WebGPU's default limits, whatever the adapter offers.
    pub default_limits: bool,
    /// The preset of the builds to come. Where a GPU cannot build it, [`BackendKind::Auto`] takes the
    /// CPU; a GPU asked for by name is opened, and its builds end in an error.
    pub preset: Preset,
    /// How long to wait for a device before it counts as hanging. When `None`, a minute for hardware
    /// and half an hour for software.
    pub timeout: Option<Duration>,
    /// How long a GPU's driver may take to open the device, and for the pipelines that are made then,
    /// together; and for each one that is made later. When `None`, a minute, half an hour for
    /// Mesa's llvmpipe, and 20 seconds for drivers that `OpenOptions::probe` (feature `wgpu`) tries.
    ///
    /// A driver that takes longer ends in `OpenError::DriverLimit` (feature `wgpu`), and [`BackendKind::Auto`]
    /// passes over it. But it compiles inside the process, in a thread that nothing can end, which
    /// continues to take time and memory until it is done or the process ends. A probe avoids that.
    pub driver_time: Option<Duration>,
    /// By how many bytes the memory that this process has for itself may grow while the driver does so.
    /// When `None`, 2 GiB. What other threads allocate meanwhile counts too; `u64::MAX` is no limit. On
    /// Linux only: elsewhere there is none but that of time.
    pub driver_memory: Option<u64>,
    /// Tries adapters with unknown drivers in a child process before they are opened in this one.
    /// Hardware of the large vendors and Mesa's llvmpipe are opened at once. When `None`, all are.
    #[cfg(feature = "wgpu")]
    pub probe: Option<Probe>,
}

/// A backend, ready for work.
pub struct Opened {
    /// The backend.
    pub backend: Box<dyn Backend>,
    /// Why this backend was chosen, for reports.
    pub reason: String,
}

impl fmt::Debug for Opened {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Opened")
            .field("backend", &self.backend.describe())
            .field("reason", &self.reason)
            .finish()
    }
}

/// Why a backend could not be opened.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// A GPU was asked for, but this build has no GPU backend.
    #[error(
        "this build of splitplane has no GPU backend (Cargo feature `wgpu`); use the backend `cpu`, \
         or `auto` without an adapter's name"
    )]
    NoGpuBackend,
    /// The CPU was asked for, but this build has no CPU backend.
    #[error("this build of splitplane has no CPU backend; build it with the feature `cpu`")]
    NoCpuBackend,
    /// An adapter was named for the CPU.
    #[error("the adapter `{0}` was asked for, but the backend `cpu` uses none; ask for `wgpu`")]
    AdapterForCpu(String),
    /// A GPU was asked for, but there is none.
    #[error(
        "no GPU adapter was found{}; use the backend `cpu`, or `auto` to take what there is",
        in_environment()
    )]
    NoAdapter,
    /// A GPU adapter was asked for by a name or an index that none has.
    #[error("no GPU adapter is called `{asked}`; there are {}", listed(.seen))]
    WrongAdapter {
        /// What was asked for.
        asked: String,
        /// The names of the adapters, in the order of their indices.
        seen: Vec<String>,
    },
    /// The GPU adapter lacks something that is needed, or would not open.
    #[error("the GPU adapter `{adapter}` cannot be used: {reason}")]
    Unusable {
        /// The adapter's name.
        adapter: String,
        /// What it lacks.
        reason: String,
    },
    /// The GPU adapter's answers are not those of the CPU bit for bit, and that was not allowed.
    #[error(
        "the GPU adapter `{adapter}` differs from the CPU in some bits ({difference}), which was not \
         allowed"
    )]
    Structural {
        /// The adapter's name.
        adapter: String,
        /// What differs.
        difference: String,
    },
    /// The GPU adapter's driver took more than it may: see [`OpenOptions::driver_time`].
    #[cfg(feature = "wgpu")]
    #[error(
        "the driver of the GPU adapter `{adapter}` ({driver}) did not finish {doing} within {limit}"
    )]
    DriverLimit {
        /// The adapter's name.
        adapter: String,
        /// The driver's name.
        driver: String,
        /// What it was doing.
        doing: String,
        /// The limit.
        limit: splitplane_wgpu::DriverLimit,
    },
    /// The device was lost or did not finish in time while it was opened.
    #[error("the GPU adapter `{adapter}` failed when it was opened: {reason}")]
    DeviceFailed {
        /// The adapter's name.
        adapter: String,
        /// What happened.
        reason: String,
    },
}

/// The environment variables that restrict which adapters are found or taken, for a message; empty
/// where none is set.
fn in_environment() -> String {
    let set = ["WGPU_BACKEND", "WGPU_ADAPTER_NAME"].map(|name| (name, std::env::var_os(name)));
    environment_text(&set)
}

/// As [`in_environment`], of these values.
fn environment_text(variables: &[(&str, Option<OsString>)]) -> String {
    let set = variables.iter().filter_map(|(name, value)| {
        let value = value.as_ref().filter(|value| !value.is_empty())?;
        Some(format!("{name}={}", value.to_string_lossy()))
    });
    let set: Vec<String> = set.collect();
    match set.is_empty() {
        true => String::new(),
        false => format!(" (the environment has {})", set.join(" and ")),
    }
}

/// Names with their indices, for a message.
fn listed(names: &[String]) -> String {
    let named = names.iter().enumerate().map(|(index, name)| format!("{index} `{name}`"));
    named.collect::<Vec<_>>().join(", ")
}

impl BackendKind {
    /// All names, in the order a help text lists them.
    pub const ALL: [BackendKind; 3] = [BackendKind::Auto, BackendKind::Cpu, BackendKind::Wgpu];

    /// The name that [`FromStr`] reads; also used in reports.
    pub const fn name(self) -> &'static str {
        match self {
            BackendKind::Auto => "auto",
            BackendKind::Cpu => "cpu",
            BackendKind::Wgpu => "wgpu",
        }
    }

    /// Opens the backend of this name, whatever device is best.
    ///
    /// # Errors
    /// As for [`BackendKind::open_with`].
    pub fn open(self) -> Result<Opened, OpenError> {
        self.open_with(&OpenOptions::default())
    }

    /// Opens the backend of this name.
    ///
    /// `Auto` takes a GPU that is hardware and gives the CPU's answers bit for bit, else the CPU.
    ///
    /// # Errors
    /// The backend is not part of this build, there is no such device, or it may not be used. A GPU
    /// that was asked for is never replaced by the CPU, nor an adapter that was named by another.
    pub fn open_with(self, options: &OpenOptions) -> Result<Opened, OpenError> {
        let OpenedEngine { engine, reason } = self.open_engine(options)?;
        Ok(Opened { backend: engine.into_backend(), reason })
    }

    /// As [`BackendKind::open_with`], the backend by its own type.
    ///
    /// # Errors
    /// As for [`BackendKind::open_with`].
    pub fn open_engine(self, options: &OpenOptions) -> Result<OpenedEngine, OpenError> {
        let on_device = options.preset.planes().is_some();
        match (self, &options.adapter) {
            (BackendKind::Cpu, Some(adapter)) => Err(OpenError::AdapterForCpu(adapter.clone())),
            (BackendKind::Cpu, None) => open_cpu("asked for"),
            (BackendKind::Auto, None) if !on_device => open_cpu(&format!(
                "auto: the CPU, since preset {} is built on the CPU only",
                options.preset.name()
            )),
            (BackendKind::Auto, _) => open_auto(options),
            (BackendKind::Wgpu, _) => open_wgpu(options),
        }
    }
}

#[cfg(feature = "wgpu")]
fn open_auto(options: &OpenOptions) -> Result<OpenedEngine, OpenError> {
    match gpu::open_hardware(options)? {
        Ok(opened) => Ok(opened),
        Err(why) => open_cpu(&format!("auto: the CPU, since {why}")),
    }
}

#[cfg(not(feature = "wgpu"))]
fn open_auto(options: &OpenOptions) -> Result<OpenedEngine, OpenError> {
    match options.adapter {
        Some(_) => Err(OpenError::NoGpuBackend),
        None => open_cpu("auto: no GPU backend is compiled in, so the CPU"),
    }
}

#[cfg(feature = "wgpu")]
fn open_wgpu(options: &OpenOptions) -> Result<OpenedEngine, OpenError> {
    gpu::open(options)
}

#[cfg(not(feature = "wgpu"))]
fn open_wgpu(_: &OpenOptions) -> Result<OpenedEngine, OpenError> {
    Err(OpenError::NoGpuBackend)
}

/// True while this thread waits for a GPU: a panic now is caught and becomes an error if the device
/// is lost, so a panic hook that ends the process should do nothing.
pub fn panic_is_caught() -> bool {
    #[cfg(feature = "wgpu")]
    return splitplane_wgpu::panic_is_caught();
    #[cfg(not(feature = "wgpu"))]
    return false;
}

#[cfg(feature = "cpu")]
fn open_cpu(reason: &str) -> Result<OpenedEngine, OpenError> {
    let engine = Engine::Cpu(splitplane_cpu::CpuBackend::new());
    Ok(OpenedEngine { engine, reason: reason.to_owned() })
}

#[cfg(not(feature = "cpu"))]
fn open_cpu(_: &str) -> Result<OpenedEngine, OpenError> {
    Err(OpenError::NoCpuBackend)
}

impl fmt::Display for BackendKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A name that is not a backend's.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("`{0}` is not a backend; the backends are auto, cpu and wgpu")]
pub struct UnknownBackend(String);

impl FromStr for BackendKind {
    type Err = UnknownBackend;

    /// The inverse of [`BackendKind::name`]; upper case is not accepted.
    fn from_str(name: &str) -> Result<BackendKind, UnknownBackend> {
        BackendKind::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| UnknownBackend(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_others_are_refused() {
        for kind in BackendKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        assert!("CPU".parse::<BackendKind>().unwrap_err().to_string().contains("`CPU`"));
    }

    #[cfg(not(feature = "wgpu"))]
    #[test]
    fn a_gpu_asked_for_is_never_the_cpu() {
        assert_eq!(BackendKind::Wgpu.open().unwrap_err(), OpenError::NoGpuBackend);
        let named = OpenOptions { adapter: Some("0".into()), ..OpenOptions::default() };
        assert_eq!(BackendKind::Auto.open_with(&named).unwrap_err(), OpenError::NoGpuBackend);
    }

    #[test]
    fn variables_that_are_set_are_named() {
        let text = |backend: Option<&str>, name: Option<&str>| {
            environment_text(&[
                ("WGPU_BACKEND", backend.map(OsString::from)),
                ("WGPU_ADAPTER_NAME", name.map(OsString::from)),
            ])
        };
        assert_eq!(text(None, None), "");
        assert_eq!(text(Some(""), None), "");
        assert_eq!(text(None, Some("radeon")), " (the environment has WGPU_ADAPTER_NAME=radeon)");
        assert_eq!(
            text(Some("dx12"), Some("radeon")),
            " (the environment has WGPU_BACKEND=dx12 and WGPU_ADAPTER_NAME=radeon)"
        );
    }

    #[test]
    fn the_cpu_takes_no_adapter() {
        let named = OpenOptions { adapter: Some("0".into()), ..OpenOptions::default() };
        let error = BackendKind::Cpu.open_with(&named).unwrap_err();
        assert_eq!(error, OpenError::AdapterForCpu("0".into()));
    }

    #[cfg(feature = "cpu")]
    #[test]
    fn auto_takes_the_cpu_for_what_only_it_can_build() {
        let options = OpenOptions { preset: Preset::Best, ..OpenOptions::default() };
        let opened = BackendKind::Auto.open_with(&options).unwrap();
        assert_eq!(opened.backend.describe().name, "cpu");
        assert_eq!(opened.reason, "auto: the CPU, since preset best is built on the CPU only");
    }

    #[cfg(feature = "cpu")]
    #[test]
    fn auto_says_what_it_took_and_why() {
        let opened = BackendKind::Auto.open().unwrap();
        assert!(opened.reason.starts_with("auto: "), "{}", opened.reason);
        #[cfg(not(feature = "wgpu"))]
        assert_eq!(opened.backend.describe().name, "cpu");
    }
}

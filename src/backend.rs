//! Which backend does the work, chosen by name at run time.

use splitplane_core::backend::Backend;
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// A backend by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BackendKind {
    /// The best one this build and this machine offer; [`Opened::reason`] says which and why.
    #[default]
    Auto,
    /// The cores of this machine, through rayon.
    Cpu,
    /// A GPU through wgpu. Never answered by another backend: where there is none, opening fails.
    Wgpu,
}

/// A backend, ready for work.
pub struct Opened {
    /// The backend.
    pub backend: Box<dyn Backend>,
    /// Why it is this one, in words fit for a report.
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
        "this build of splitplane has no GPU backend; use the backend `cpu`, or `auto` to take \
         what there is"
    )]
    NoGpuBackend,
    /// The CPU was asked for, but this build has no CPU backend.
    #[error("this build of splitplane has no CPU backend; build it with the feature `cpu`")]
    NoCpuBackend,
}

impl BackendKind {
    /// All names, in the order a help text lists them.
    pub const ALL: [BackendKind; 3] = [BackendKind::Auto, BackendKind::Cpu, BackendKind::Wgpu];

    /// The name on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            BackendKind::Auto => "auto",
            BackendKind::Cpu => "cpu",
            BackendKind::Wgpu => "wgpu",
        }
    }

    /// Opens the backend of this name.
    ///
    /// # Errors
    /// The backend is not part of this build. A GPU that was asked for is never replaced by the
    /// CPU.
    pub fn open(self) -> Result<Opened, OpenError> {
        match self {
            BackendKind::Auto => open_cpu("auto: no GPU backend is compiled in, so the CPU"),
            BackendKind::Cpu => open_cpu("asked for"),
            BackendKind::Wgpu => Err(OpenError::NoGpuBackend),
        }
    }
}

#[cfg(feature = "cpu")]
fn open_cpu(reason: &str) -> Result<Opened, OpenError> {
    Ok(Opened { backend: Box::new(splitplane_cpu::CpuBackend::new()), reason: reason.to_owned() })
}

#[cfg(not(feature = "cpu"))]
fn open_cpu(_: &str) -> Result<Opened, OpenError> {
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

    #[test]
    fn a_gpu_asked_for_is_never_the_cpu() {
        assert_eq!(BackendKind::Wgpu.open().unwrap_err(), OpenError::NoGpuBackend);
    }

    #[cfg(feature = "cpu")]
    #[test]
    fn auto_says_what_it_took_and_why() {
        let opened = BackendKind::Auto.open().unwrap();
        assert_eq!(opened.backend.describe().name, "cpu");
        assert!(opened.reason.contains("no GPU backend"), "{}", opened.reason);
    }
}

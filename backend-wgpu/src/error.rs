//! What can go wrong on a device.

use std::fmt;
use std::time::Duration;

use splitplane_core::error::{BuildError, DeviceError, QueryError};
use splitplane_core::points::build::PointBuildError;
use thiserror::Error;

/// Why no device was opened.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// No adapter was found.
    #[error("no GPU adapter was found")]
    NoAdapter,
    /// No adapter has the requested name or index.
    #[error("no GPU adapter is called `{asked}`; there are {}", listed(.seen))]
    WrongAdapter {
        /// What was requested.
        asked: String,
        /// The names of the adapters, in the order of their indices.
        seen: Vec<String>,
    },
    /// The adapter lacks something that is needed, or would not open.
    #[error("the GPU adapter `{adapter}` cannot be used: {reason}")]
    Unusable {
        /// The adapter's name.
        adapter: String,
        /// What it lacks, or what wgpu says.
        reason: String,
    },
    /// The adapter's driver exceeded a limit.
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
        limit: DriverLimit,
    },
}

/// The limit that a driver exceeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum DriverLimit {
    /// The limit of time.
    Time(Duration),
    /// The number of bytes by which memory may grow meanwhile.
    Memory(u64),
}

impl fmt::Display for DriverLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DriverLimit::Time(time) => write!(f, "{} seconds", time.as_secs_f64()),
            DriverLimit::Memory(bytes) => write!(f, "{bytes} bytes of memory"),
        }
    }
}

/// Names with their indices, for a message.
fn listed(names: &[String]) -> String {
    let named = names.iter().enumerate().map(|(index, name)| format!("{index} `{name}`"));
    named.collect::<Vec<_>>().join(", ")
}

/// Errors of work on a device.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The device is gone; nothing can be done with it any more.
    #[error("the device was lost: {reason}")]
    Lost {
        /// What the driver says.
        reason: String,
    },
    /// The device did not finish in time.
    #[error("the device did not finish within {seconds} seconds")]
    TimedOut {
        /// How long was waited, in whole seconds.
        seconds: u64,
    },
    /// A limit of the device is too low for what was asked.
    #[error("{what} needs {needed}, but the device's limit {limit} is {allowed}")]
    Limit {
        /// What was asked.
        what: String,
        /// The limit's name in wgpu.
        limit: &'static str,
        /// What is needed.
        needed: u64,
        /// What the device allows.
        allowed: u64,
    },
    /// The device has no memory left.
    #[error("the device is out of memory: {what} needs {needed} bytes")]
    OutOfMemory {
        /// What was asked.
        what: String,
        /// Bytes requested; 0 where wgpu does not say.
        needed: u64,
    },
    /// The system has no memory left.
    #[error("the system has no memory for {what}: {needed} bytes")]
    HostMemory {
        /// What was asked.
        what: String,
        /// Bytes requested.
        needed: u64,
    },
    /// A shader does not compile for this device: a bug here, in wgpu or in the driver.
    #[error("the shader `{shader}` does not compile: {reason}")]
    Shader {
        /// The shader's label.
        shader: String,
        /// What the compiler says.
        reason: String,
    },
    /// The driver exceeded a limit: see
    /// [`OpenOptions::driver_time`](crate::OpenOptions::driver_time).
    #[error("the device's driver did not finish {doing} within {limit}")]
    DriverLimit {
        /// What it was doing.
        doing: String,
        /// The limit.
        limit: DriverLimit,
    },
    /// The driver ended a loop before its end, as Mesa's llvmpipe does after 65,535 rounds.
    #[error("the device's driver ended a loop before its end: {what} is too large for it")]
    Unfinished {
        /// What was asked.
        what: String,
    },
    /// A page in a browser cannot wait for a device; the asynchronous calls do not need to.
    #[error("nothing can wait for a device here: use the asynchronous calls")]
    CannotBlock,
    /// A scene that the device does not hold, which the CPU answers in its place: why.
    #[error("the scene is not on the device: {0}")]
    NotHeld(String),
    /// wgpu or the driver refused something that should be right: a bug here or there.
    #[error("the device refused a command: {0}")]
    Refused(String),
}

impl GpuError {
    /// wgpu's error, when nothing else is known.
    pub(crate) fn from_wgpu(error: wgpu::Error) -> GpuError {
        match error {
            wgpu::Error::OutOfMemory { .. } => {
                GpuError::OutOfMemory { what: "a command".into(), needed: 0 }
            }
            wgpu::Error::Validation { description, .. }
            | wgpu::Error::Internal { description, .. } => {
                GpuError::Refused(description.trim().to_owned())
            }
        }
    }
}

impl GpuError {
    /// The error of a build or a query, except for lack of system memory, for which those have
    /// errors of their own: then `Err` with the bytes requested.
    fn into_device_error(self) -> Result<DeviceError, u64> {
        Ok(match self {
            GpuError::Lost { reason } => DeviceError::Lost { reason },
            GpuError::Limit { what, limit, needed, allowed } => {
                DeviceError::Limit { what, limit: limit.to_owned(), needed, allowed }
            }
            GpuError::OutOfMemory { what, needed } => DeviceError::OutOfMemory { what, needed },
            GpuError::HostMemory { needed, .. } => return Err(needed),
            GpuError::TimedOut { seconds } => DeviceError::TimedOut { seconds },
            GpuError::Shader { .. }
            | GpuError::DriverLimit { .. }
            | GpuError::Unfinished { .. }
            | GpuError::CannotBlock
            | GpuError::NotHeld(_)
            | GpuError::Refused(_) => DeviceError::Failed(self.to_string()),
        })
    }
}

impl From<GpuError> for BuildError {
    fn from(error: GpuError) -> BuildError {
        match error.into_device_error() {
            Ok(error) => BuildError::Device(error),
            Err(needed) => BuildError::OutOfMemory { needed, limit: needed },
        }
    }
}

impl From<GpuError> for PointBuildError {
    fn from(error: GpuError) -> PointBuildError {
        match error.into_device_error() {
            Ok(error) => PointBuildError::Device(error),
            Err(needed) => PointBuildError::OutOfMemory { needed, limit: needed },
        }
    }
}

impl From<GpuError> for QueryError {
    fn from(error: GpuError) -> QueryError {
        match error.into_device_error() {
            Ok(error) => QueryError::Device(error),
            Err(needed) => QueryError::OutOfMemory { needed, limit: needed },
        }
    }
}

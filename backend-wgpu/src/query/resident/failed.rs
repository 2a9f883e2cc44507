//! Errors of a device as those of a scene that is built.

use splitplane_core::error::{BuildError, DeviceError};
use splitplane_core::scene::SceneBuildError;

use crate::error::GpuError;

pub(super) fn failed(error: GpuError) -> SceneBuildError {
    match BuildError::from(error) {
        BuildError::Device(error) => SceneBuildError::Device(error),
        BuildError::OutOfMemory { needed, limit } => SceneBuildError::OutOfMemory { needed, limit },
        error => SceneBuildError::Device(DeviceError::Failed(error.to_string())),
    }
}

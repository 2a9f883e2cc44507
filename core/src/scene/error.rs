//! Errors of scenes: of edits, and of builds.

use thiserror::Error;

use super::hit::MAX_INSTANCES;
use crate::error::{BuildError, DeviceError};
use crate::watch::Progress;

/// Why an edit of a scene was refused. The scene is then what it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// There is no such instance: it was removed, or never added.
    #[error("there is no instance {instance}; it was removed, or is of another scene")]
    UnknownInstance {
        /// The instance.
        instance: u32,
    },
    /// There is no such geometry: it was removed, or never added.
    #[error("there is no geometry {geometry}; it was removed, or is of another scene")]
    UnknownGeometry {
        /// The geometry.
        geometry: u32,
    },
    /// A geometry that is to be removed has instances.
    #[error(
        "geometry {geometry} has {instances} instances, of which {instance} is one; remove them first"
    )]
    GeometryInUse {
        /// The geometry.
        geometry: u32,
        /// How many instances it has.
        instances: u32,
        /// The first of them.
        instance: u32,
    },
    /// A number of a transform is not finite.
    #[error("the transform of instance {instance} is not finite in row {row}, column {column}")]
    NonFiniteTransform {
        /// The instance; for a new one the name it would get.
        instance: u32,
        /// The row, from 0.
        row: usize,
        /// The column, from 0.
        column: usize,
    },
    /// A transform that has no inverse, or none that `f32` can hold well enough: times the transform it differs from
    /// the identity by more than 1/8.
    #[error(
        "the transform of instance {instance} has no inverse that single precision can hold: it flattens its object"
    )]
    SingularTransform {
        /// The instance; for a new one the name it would get.
        instance: u32,
    },
    /// More instances than a scene can name.
    #[error("a scene has {MAX_INSTANCES} instances at most")]
    TooManyInstances,
    /// More geometries than a scene can name.
    #[error("a scene has {MAX_INSTANCES} geometries at most")]
    TooManyGeometries,
    /// The system has no memory for it.
    #[error("the system has no memory for {bytes} bytes more of the scene")]
    OutOfMemory {
        /// Bytes that were asked for.
        bytes: u64,
    },
}

/// Why a scene was not built, or not brought up to date. What was there before is as it was.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneBuildError {
    /// A geometry's tree was not built.
    #[error("geometry {geometry}: {error}")]
    Geometry {
        /// The geometry.
        geometry: u32,
        /// Why.
        error: BuildError,
    },
    /// The scene would hold more memory than allowed, or than the system has.
    #[error("the scene needs {needed} bytes, and {limit} are allowed or there; raise the limit")]
    OutOfMemory {
        /// Bytes needed at the point where it stopped.
        needed: u64,
        /// The limit; where the system refused more, as many as are `needed`.
        limit: u64,
    },
    /// A description that is not one of a scene.
    #[error(transparent)]
    Description(SceneError),
    /// A device that has no memory for the scene, or that fails.
    #[error("the scene on the device: {0}")]
    Device(DeviceError),
    /// The watch cancelled the work between geometries.
    #[error("cancelled after {} of {} geometries", progress.done, progress.total)]
    Cancelled {
        /// How far it had come.
        progress: Progress,
    },
}

/// What a description refuses before anything is built.
impl From<SceneError> for SceneBuildError {
    fn from(error: SceneError) -> SceneBuildError {
        match error {
            SceneError::OutOfMemory { bytes } => {
                SceneBuildError::OutOfMemory { needed: bytes, limit: bytes }
            }
            error => SceneBuildError::Description(error),
        }
    }
}

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
    /// A mesh was given to a geometry of shapes, or shapes to one of triangles.
    #[error("geometry {geometry} consists of {has}; add another geometry for {given}")]
    OtherKind {
        /// The geometry.
        geometry: u32,
        /// What it consists of.
        has: &'static str,
        /// What was given.
        given: &'static str,
    },
    /// More primitives than a set of shapes can name.
    #[error("a geometry has fewer than {MAX_INSTANCES} shapes, not {primitives}")]
    TooManyPrimitives {
        /// How many there are.
        primitives: u64,
    },
    /// An opacity mask with a level that is too great.
    #[error("an opacity mask has level {} at most, not {level}", super::hit::MAX_OPACITY_LEVEL)]
    OpacityLevel {
        /// The level.
        level: u32,
    },
    /// An opacity mask with other words than it needs.
    #[error(
        "the opacity mask has {words} words, where {expected} are needed, or bits after its last cell"
    )]
    OpacityWords {
        /// How many words there are.
        words: u64,
        /// How many are needed.
        expected: u64,
    },
    /// An opacity mask of another number of triangles than the geometry has.
    #[error(
        "the opacity mask is for {mask} triangles, and geometry {geometry} has {triangles} of them"
    )]
    OpacityTriangles {
        /// The geometry.
        geometry: u32,
        /// Its triangles; 0 for shapes, which have no masks.
        triangles: u32,
        /// Those of the mask.
        mask: u32,
    },
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
    /// A geometry of the user's own shapes, which the backend cannot answer: the CPU backend can.
    #[error(
        "geometry {geometry} consists of own shapes, whose functions backend {backend} cannot call; take backend cpu"
    )]
    OwnShapes {
        /// The geometry.
        geometry: u32,
        /// The backend's name.
        backend: alloc::string::String,
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

impl SceneBuildError {
    /// Restates the error of work that ran with a reduced limit, since so many bytes were held besides, by the caller's own limit.
    pub(crate) fn beside(self, held: u64, whole: Option<u64>) -> SceneBuildError {
        match (self, whole) {
            (SceneBuildError::Geometry { geometry, error }, _) => {
                SceneBuildError::Geometry { geometry, error: error.beside(held, whole) }
            }
            (SceneBuildError::OutOfMemory { needed, limit }, Some(whole)) if needed > limit => {
                SceneBuildError::OutOfMemory { needed: needed.saturating_add(held), limit: whole }
            }
            (error, _) => error,
        }
    }
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

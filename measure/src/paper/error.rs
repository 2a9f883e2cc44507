//! Why there is no report.

use splitplane::backend::OpenError;
use splitplane::picture::PictureError;
use splitplane::scene::{AnimationError, SceneError};
use splitplane::tracer::TracerError;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::MeshError;
use splitplane_core::points::build::PointBuildError;
use splitplane_scene::from_file::quoted;
use thiserror::Error;

/// Why there is no report.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A scene that cannot be opened.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene with nothing to build a tree over.
    #[error("`{name}` has no triangle that can be hit; leave it out", name = quoted(.0))]
    Empty(String),
    /// A backend that cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A tree or a frame that cannot be made.
    #[error(transparent)]
    Tracer(#[from] TracerError),
    /// A scene whose arrays are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Rays that cannot be traced.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// A picture that cannot be drawn.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// Threads that cannot be started.
    #[error("cannot start {threads} threads: {reason}; try fewer")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// Why, in the system's words.
        reason: String,
    },
    /// A tree of points that cannot be built.
    #[error(transparent)]
    Points(#[from] PointBuildError),
    /// Frames of a scene that cannot be had.
    #[error(transparent)]
    Animation(#[from] AnimationError),
}

impl From<BuildError> for ReportError {
    fn from(error: BuildError) -> ReportError {
        ReportError::Tracer(error.into())
    }
}

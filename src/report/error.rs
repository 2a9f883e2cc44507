//! Why there is no report.

use crate::backend::OpenError;
use crate::from_file::{quoted, quoted_path};
use crate::picture::PictureError;
use crate::scene::SceneError;
use crate::tracer::TracerError;
use splitplane_core::backend::{BuildError, QueryError};
use splitplane_core::mesh::MeshError;
use std::path::PathBuf;
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
    /// A file of other builders' times that is none, or belongs to other rays.
    #[error("`{path}`: {reason}", path = quoted_path(.path))]
    Others {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl From<BuildError> for ReportError {
    fn from(error: BuildError) -> ReportError {
        ReportError::Tracer(error.into())
    }
}

impl From<MeshError> for ReportError {
    fn from(error: MeshError) -> ReportError {
        ReportError::Tracer(error.into())
    }
}

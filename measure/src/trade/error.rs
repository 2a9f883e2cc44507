//! Why there is nothing to compare settings by.

use crate::paper::ReportError;
use splitplane::picture::PictureError;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::mesh::MeshError;
use splitplane_scene::from_file::quoted_path;
use std::path::PathBuf;
use thiserror::Error;

/// Why settings could not be measured or compared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TradeError {
    /// A scene that cannot be opened, or threads that cannot be started.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// The scene's arrays are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A tree that cannot be built.
    #[error("{setting}: {error}")]
    Build {
        /// The setting, as its row is named.
        setting: String,
        /// Why.
        error: BuildError,
    },
    /// Rays that cannot be traced.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// A plot that cannot be drawn.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A file of earlier figures that cannot be read, is damaged, or belongs to something else.
    #[error("`{path}`: {reason}", path = quoted_path(.path))]
    Old {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

//! Errors of a tracer: no frame, or no tree to render it from.

use super::Output;
use crate::error::RenderError;
use crate::plan::PlanError;
use crate::scene_data::AppearanceError;
use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::scene::SceneBuildError;
use thiserror::Error;

/// Why there is no frame, or no tree to render it from.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TracerError {
    /// The tree cannot be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The scene of instances cannot be built.
    #[error(transparent)]
    Scene(#[from] SceneBuildError),
    /// The frame cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The frame has no such output.
    #[error("the frame was not asked for {output}")]
    NotRequested {
        /// The requested output.
        output: Output,
    },
    /// A picture was requested in a GPU buffer, but it is rendered on the CPU.
    #[error("the frame is made on the CPU and cannot go to a buffer of a GPU")]
    NotOnGpu,
    /// A frame was asked for before any was submitted, or twice.
    #[error("no frame was submitted")]
    NothingSubmitted,
    /// A device's driver did not follow some rays to their end.
    #[error(
        "the device's driver ended the work on {pixels} pixels before it was done; use the backend \
         `cpu`, or another device"
    )]
    Unfinished {
        /// Pixels whose light is not complete.
        pixels: usize,
    },
}

impl From<PlanError> for TracerError {
    fn from(error: PlanError) -> TracerError {
        TracerError::Render(error.into())
    }
}

impl From<AppearanceError> for TracerError {
    fn from(error: AppearanceError) -> TracerError {
        TracerError::Render(error.into())
    }
}

impl From<QueryError> for TracerError {
    fn from(error: QueryError) -> TracerError {
        TracerError::Render(error.into())
    }
}

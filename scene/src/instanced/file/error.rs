//! What can be wrong with a scene file.

use crate::budget::Full;
use crate::from_file::quoted_path;
use crate::obj::ObjError;
use crate::{CameraError, instanced::InstancedError};
use splitplane_core::mesh::MeshError;
use splitplane_core::scene::{BakeError, SceneError};
use std::fmt;
use std::path::PathBuf;
use thiserror::Error;

/// A scene file that cannot be read: where, and why.
#[derive(Clone, Debug, PartialEq, Error)]
pub struct SceneFileError {
    /// The file.
    pub file: PathBuf,
    /// Line and column, counted from 1; `None` when the file as a whole is meant.
    pub place: Option<(usize, usize)>,
    /// The field, such as `instances[3].geometry`; empty when the file as a whole is meant.
    pub field: String,
    /// What is wrong.
    pub problem: Box<SceneFileProblem>,
}

impl fmt::Display for SceneFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot read `{}`", quoted_path(&self.file))?;
        if let Some((line, column)) = self.place {
            write!(f, ", line {line}, column {column}")?;
        }
        if !self.field.is_empty() {
            write!(f, ", {}", crate::from_file::quoted(&self.field))?;
        }
        write!(f, ": {}", self.problem)
    }
}

/// What is wrong with a scene file.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SceneFileProblem {
    /// The system refuses, or it is no file.
    #[error("{0}")]
    Unreadable(String),
    /// The file has more bytes than are read, or they do not fit into memory.
    #[error("{0}")]
    Limit(String),
    /// The bytes are not UTF-8.
    #[error("it is not UTF-8 text")]
    NotUtf8,
    /// Not a file of a built scene, though its name says so.
    #[error(transparent)]
    Saved(#[from] splitplane_core::scene::file::SceneFileError),
    /// Not JSON, or not a scene: a field that is unknown, missing or of another kind.
    #[error("{0}")]
    Json(String),
    /// Another format or version.
    #[error(
        "the file is of format `{format}`, version {version}; `splitplane-scene`, version 1, is read"
    )]
    Version {
        /// The format that it names.
        format: String,
        /// The version that it names.
        version: u32,
    },
    /// A name that nothing has.
    #[error("there is no {what} `{name}`")]
    Unknown {
        /// What is named.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A name that something else has.
    #[error("another {what} is called `{name}`")]
    Twice {
        /// What is named.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// More of something than is allowed.
    #[error("there are more than {most} {what}")]
    TooMany {
        /// What.
        what: &'static str,
        /// The most that are allowed.
        most: usize,
    },
    /// The text, its entries, what they become, and .obj files after the first take more memory than is allowed: see
    /// [`SceneOptions::memory_limit`](crate::SceneOptions::memory_limit).
    #[error(
        "the scene file's text, its entries up to here and further .obj files take {needed} bytes, more than the limit of {limit}"
    )]
    Memory {
        /// Bytes of all up to here, this entry among them.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// Fields that do not go together, or a value out of range.
    #[error("{0}")]
    Wrong(&'static str),
    /// A transform that is not finite or has no inverse.
    #[error(
        "the transform has no inverse that can be held, or is not finite; scales must not be 0"
    )]
    Singular,
    /// A geometry's file.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// An environment map.
    #[cfg(feature = "environment")]
    #[error(transparent)]
    Environment(#[from] crate::environment::EnvironmentError),
    /// A geometry's arrays.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// An instance that cannot be baked.
    #[error(transparent)]
    Bake(#[from] BakeError),
    /// What cannot be described all the same.
    #[error(transparent)]
    Scene(#[from] InstancedError),
}

impl SceneFileProblem {
    /// Whether a limit binds, not the file.
    pub fn is_limit(&self) -> bool {
        #[cfg(feature = "environment")]
        if let SceneFileProblem::Environment(error) = self {
            return error.problem.is_limit();
        }
        matches!(
            self,
            SceneFileProblem::Limit(_)
                | SceneFileProblem::TooMany { .. }
                | SceneFileProblem::Memory { .. }
                | SceneFileProblem::Bake(
                    BakeError::TooMany { .. }
                        | BakeError::OutOfMemory { .. }
                        | BakeError::Scene(SceneError::OutOfMemory { .. })
                )
        )
    }
}

impl From<Full> for SceneFileProblem {
    fn from(full: Full) -> SceneFileProblem {
        match full {
            Full::Limit { needed, limit } => SceneFileProblem::Memory { needed, limit },
            Full::System => {
                SceneFileProblem::Limit("there is not memory enough for what it says".to_owned())
            }
        }
    }
}

//! Errors of the library as exceptions of `splitplane.errors`, with the library's texts.

use pyo3::prelude::*;
use splitplane::core::tree::file::FileError;
use splitplane::objects::file::SceneFileError;
use splitplane::objects::{SceneBuildError, SceneError, SceneWriteError};
use splitplane::points::PointBuildError;
use splitplane::{BuildError, MeshError, OpenError, QueryError};

/// Why a call failed, without anything of Python, so that it can be made while others hold the GIL.
#[derive(Debug)]
pub(crate) struct Failure {
    /// The class in `splitplane.errors`.
    pub class: &'static str,
    /// Its text.
    pub text: String,
}

impl Failure {
    pub(crate) fn new(class: &'static str, text: impl Into<String>) -> Failure {
        Failure { class, text: text.into() }
    }

    /// Of an update: what it was to change answers as before.
    pub(crate) fn of_update(self) -> Failure {
        let text = format!("{}; the scene answers as before the update", self.text);
        Failure { text, ..self }
    }

    /// Memory for this many things was refused.
    pub(crate) fn memory(bytes: usize) -> Failure {
        Failure::new("OutOfMemoryError", format!("the system has no memory for {bytes} bytes"))
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        Python::attach(|py| {
            let made = py
                .import("splitplane.errors")
                .and_then(|module| module.getattr(failure.class))
                .and_then(|class| class.call1((failure.text,)));
            match made {
                Ok(error) => PyErr::from_value(error),
                Err(error) => error,
            }
        })
    }
}

fn build_class(error: &BuildError) -> &'static str {
    match error {
        BuildError::Config(_) | BuildError::PresetNotOnDevice { .. } => "ConfigError",
        BuildError::OutOfMemory { .. } => "OutOfMemoryError",
        BuildError::Cancelled { .. } => "CancelledError",
        BuildError::WrongMesh { .. } => "WrongMeshError",
        BuildError::Device(_) => "DeviceError",
        _ => "BuildError",
    }
}

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Failure {
        Failure::new(build_class(&error), error.to_string())
    }
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Failure {
        let class = match error {
            QueryError::LengthMismatch { .. } => "ShapeError",
            QueryError::OutOfMemory { .. } => "OutOfMemoryError",
            QueryError::Cancelled { .. } => "CancelledError",
            QueryError::Unsupported { .. } => "UnsupportedError",
            QueryError::Device(_) => "DeviceError",
            _ => "QueryError",
        };
        Failure::new(class, error.to_string())
    }
}

impl From<MeshError> for Failure {
    fn from(error: MeshError) -> Failure {
        Failure::new("MeshError", error.to_string())
    }
}

fn scene_class(error: &SceneError) -> &'static str {
    match error {
        SceneError::UnknownInstance { .. } | SceneError::UnknownGeometry { .. } => {
            "UnknownNameError"
        }
        SceneError::OutOfMemory { .. } => "OutOfMemoryError",
        _ => "SceneError",
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        Failure::new(scene_class(&error), error.to_string())
    }
}

impl From<SceneWriteError> for Failure {
    fn from(error: SceneWriteError) -> Failure {
        let class = match &error {
            SceneWriteError::Build(error) => build_class(error),
            _ => "UnsupportedError",
        };
        Failure::new(class, error.to_string())
    }
}

impl From<SceneBuildError> for Failure {
    fn from(error: SceneBuildError) -> Failure {
        let class = match &error {
            SceneBuildError::Geometry { error, .. } => build_class(error),
            SceneBuildError::OutOfMemory { .. } => "OutOfMemoryError",
            SceneBuildError::Cancelled { .. } => "CancelledError",
            SceneBuildError::Device(_) => "DeviceError",
            SceneBuildError::OwnShapes { .. } => "UnsupportedError",
            SceneBuildError::Description(error) => scene_class(error),
            _ => "SceneError",
        };
        Failure::new(class, error.to_string())
    }
}

impl From<PointBuildError> for Failure {
    fn from(error: PointBuildError) -> Failure {
        let class = match error {
            PointBuildError::Dimensions { .. } => "ShapeError",
            PointBuildError::OutOfMemory { .. } => "OutOfMemoryError",
            PointBuildError::Cancelled { .. } => "CancelledError",
            PointBuildError::Device(_) | PointBuildError::NotBitwise { .. } => "DeviceError",
            _ => "BuildError",
        };
        Failure::new(class, error.to_string())
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Failure {
        Failure::new("FileError", error.to_string())
    }
}

impl From<SceneFileError> for Failure {
    fn from(error: SceneFileError) -> Failure {
        Failure::new("FileError", error.to_string())
    }
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Failure {
        Failure::new("OpenError", error.to_string())
    }
}

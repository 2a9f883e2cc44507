//! Errors of the library as exceptions with a code, and the library's texts.

use splitplane::core::error::DeviceError;
use splitplane::core::tree::file::FileError;
use splitplane::objects::{SceneBuildError, SceneError};
use splitplane::{BuildError, MeshError, QueryError};
use wasm_bindgen::prelude::*;

/// Why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    /// One of those that `js/error.js` lists.
    code: &'static str,
    text: String,
}

impl Failure {
    pub(crate) fn new(code: &'static str, text: impl Into<String>) -> Failure {
        Failure { code, text: text.into() }
    }

    /// Of an update: what it was to change answers as before.
    pub(crate) fn of_update(self) -> Failure {
        let text = format!("{}; the scene answers as before the update", self.text);
        Failure { text, ..self }
    }

    /// Memory for this many bytes was refused.
    pub(crate) fn memory(bytes: usize) -> Failure {
        Failure::new("out-of-memory", format!("there is no memory for {bytes} bytes"))
    }

    pub(crate) fn length(what: &str, words: usize, each: usize) -> Failure {
        let text = format!("{what}: the length is {words}, but must be a multiple of {each}");
        Failure::new("shape", text)
    }

    pub(crate) fn range(what: &str, first: u32, count: u32, length: usize) -> Failure {
        let text = format!("{what}: {count} from number {first} on are more than its {length}");
        Failure::new("shape", text)
    }
}

impl From<Failure> for JsValue {
    fn from(failure: Failure) -> JsValue {
        let error = js_sys::Error::new(&failure.text);
        // Fails for frozen objects only.
        let _ = js_sys::Reflect::set(&error, &"code".into(), &failure.code.into());
        error.into()
    }
}

fn device_code(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Lost { .. } => "device-lost",
        DeviceError::OutOfMemory { .. } => "out-of-memory",
        DeviceError::TimedOut { .. } => "timed-out",
        _ => "device",
    }
}

fn build_code(error: &BuildError) -> &'static str {
    match error {
        BuildError::Device(error) => device_code(error),
        BuildError::Config(_) | BuildError::PresetNotOnDevice { .. } => "config",
        BuildError::OutOfMemory { .. } => "out-of-memory",
        BuildError::Cancelled { .. } => "cancelled",
        BuildError::WrongMesh { .. } => "wrong-mesh",
        _ => "build",
    }
}

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Failure {
        Failure::new(build_code(&error), error.to_string())
    }
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Failure {
        let code = match &error {
            QueryError::Device(error) => device_code(error),
            QueryError::LengthMismatch { .. } => "shape",
            QueryError::OutOfMemory { .. } => "out-of-memory",
            QueryError::Cancelled { .. } => "cancelled",
            _ => "query",
        };
        Failure::new(code, error.to_string())
    }
}

impl From<MeshError> for Failure {
    fn from(error: MeshError) -> Failure {
        Failure::new("mesh", error.to_string())
    }
}

impl From<FileError> for Failure {
    fn from(error: FileError) -> Failure {
        Failure::new("file", error.to_string())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        let code = match &error {
            SceneError::UnknownInstance { .. } | SceneError::UnknownGeometry { .. } => "unknown",
            SceneError::OutOfMemory { .. } => "out-of-memory",
            _ => "scene",
        };
        Failure::new(code, error.to_string())
    }
}

impl From<SceneBuildError> for Failure {
    fn from(error: SceneBuildError) -> Failure {
        let code = match &error {
            SceneBuildError::Geometry { error, .. } => build_code(error),
            SceneBuildError::Device(error) => device_code(error),
            SceneBuildError::OutOfMemory { .. } => "out-of-memory",
            SceneBuildError::Cancelled { .. } => "cancelled",
            _ => "scene",
        };
        Failure::new(code, error.to_string())
    }
}

#[cfg(feature = "gpu")]
mod of_devices {
    use splitplane_wgpu::{GpuError, OpenError};

    use super::Failure;

    impl From<OpenError> for Failure {
        fn from(error: OpenError) -> Failure {
            match error {
                OpenError::NoAdapter => {
                    let text = "this browser has no WebGPU, or no adapter for it";
                    Failure::new("no-webgpu", text)
                }
                OpenError::DriverLimit { .. } => Failure::new("timed-out", error.to_string()),
                error => Failure::new("device", error.to_string()),
            }
        }
    }

    impl From<GpuError> for Failure {
        fn from(error: GpuError) -> Failure {
            let code = match &error {
                GpuError::Lost { .. } => "device-lost",
                GpuError::OutOfMemory { .. } | GpuError::HostMemory { .. } => "out-of-memory",
                GpuError::TimedOut { .. } | GpuError::DriverLimit { .. } => "timed-out",
                _ => "device",
            };
            Failure::new(code, error.to_string())
        }
    }
}

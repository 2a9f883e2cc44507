//! What calls return, and why they failed.

use library::core::tree::file::FileError;
use library::objects::file::SceneFileError;
use library::objects::{SceneBuildError, SceneError, SceneWriteError};
use library::points::PointBuildError;
use library::{BuildError, ConfigError, MeshError, OpenError, QueryError};

/// What every call returns. After anything but `SPLITPLANE_STATUS_OK`, `splitplane_last_message` says more. Numbers keep their meaning; more may come.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// It is done.
    Ok = 0,
    /// A pointer is NULL that must not be.
    NullPointer = 1,
    /// A pointer is not a multiple of what its type needs: 4 for `float` and `uint32_t`, 8 for records with `double`.
    Misaligned = 2,
    /// A stride is less than the size of an item, or not a multiple of its alignment.
    Stride = 3,
    /// A count for which no array can have room, or that is too great for this call.
    Count = 4,
    /// An array that is written shares bytes with one that is read.
    Overlap = 5,
    /// A setting that does not exist, is out of range, or means nothing for this call.
    Option = 6,
    /// A handle that was never given, that is freed, or of something else.
    Handle = 7,
    /// Another call is changing the object, or is asking it while this one would change it.
    Busy = 8,
    /// The scene was edited, and no update was tried since.
    Stale = 9,
    /// There is less room than the answer needs.
    Capacity = 10,
    /// Arrays that are not a mesh: an index out of range, or too many triangles.
    Mesh = 11,
    /// A scene has no geometry or instance of this number.
    UnknownId = 12,
    /// A scene cannot have this: a transform that is not finite or has no inverse, a geometry that is removed while it has instances, a mesh or a mask where there are shapes.
    Scene = 13,
    /// A tree would be too large for its format.
    Build = 14,
    /// More memory than is allowed, or than there is.
    OutOfMemory = 15,
    /// The progress function ended the call.
    Cancelled = 16,
    /// A tree and a mesh that do not belong together.
    WrongMesh = 17,
    /// The backend does not do this.
    Unsupported = 18,
    /// Bytes that are not a file of this kind, or a damaged one.
    File = 19,
    /// The system could not read or write a file.
    Io = 20,
    /// A text that is not UTF-8, or has no end within 4096 bytes.
    Text = 21,
    /// A backend could not be opened.
    Open = 22,
    /// A device failed.
    Device = 23,
    /// A fault of the library. Objects that the call was changing should be freed.
    Internal = 70,
}

/// Why a call failed.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: Status,
    pub(crate) text: String,
}

impl Failure {
    pub(crate) fn new(status: Status, text: impl Into<String>) -> Failure {
        Failure { status, text: text.into() }
    }

    /// Of an update: what it was to change answers as before.
    pub(crate) fn of_update(self) -> Failure {
        let text = format!("{}; the scene answers as before the update", self.text);
        Failure { text, ..self }
    }

    /// Memory for so many bytes was refused.
    pub(crate) fn memory(bytes: usize) -> Failure {
        Failure::new(Status::OutOfMemory, format!("the system has no memory for {bytes} bytes"))
    }
}

fn build_status(error: &BuildError) -> Status {
    match error {
        BuildError::Config(_) | BuildError::PresetNotOnDevice { .. } => Status::Option,
        BuildError::OutOfMemory { .. } => Status::OutOfMemory,
        BuildError::Cancelled { .. } => Status::Cancelled,
        BuildError::WrongMesh { .. } => Status::WrongMesh,
        BuildError::Device(_) => Status::Device,
        _ => Status::Build,
    }
}

fn scene_status(error: &SceneError) -> Status {
    match error {
        SceneError::UnknownInstance { .. } | SceneError::UnknownGeometry { .. } => {
            Status::UnknownId
        }
        SceneError::OutOfMemory { .. } => Status::OutOfMemory,
        SceneError::OpacityLevel { .. } => Status::Option,
        SceneError::OpacityWords { .. } => Status::Count,
        _ => Status::Scene,
    }
}

/// Failures with the library's own texts.
macro_rules! failures {
    ($($error:ty: |$name:ident| $status:expr;)*) => {
        $(
            impl From<$error> for Failure {
                fn from($name: $error) -> Failure {
                    Failure::new($status, $name.to_string())
                }
            }
        )*
    };
}

failures! {
    BuildError: |error| build_status(&error);
    ConfigError: |error| Status::Option;
    MeshError: |error| Status::Mesh;
    SceneError: |error| scene_status(&error);
    FileError: |error| Status::File;
    SceneFileError: |error| Status::File;
    OpenError: |error| Status::Open;
    QueryError: |error| match error {
        QueryError::LengthMismatch { .. } => Status::Count,
        QueryError::OutOfMemory { .. } => Status::OutOfMemory,
        QueryError::Cancelled { .. } => Status::Cancelled,
        QueryError::Device(_) => Status::Device,
        _ => Status::Unsupported,
    };
    SceneBuildError: |error| match &error {
        SceneBuildError::Geometry { error, .. } => build_status(error),
        SceneBuildError::OutOfMemory { .. } => Status::OutOfMemory,
        SceneBuildError::Cancelled { .. } => Status::Cancelled,
        SceneBuildError::Device(_) => Status::Device,
        SceneBuildError::OwnShapes { .. } => Status::Unsupported,
        SceneBuildError::Description(error) => scene_status(error),
        _ => Status::Scene,
    };
    SceneWriteError: |error| match &error {
        SceneWriteError::Build(error) => build_status(error),
        _ => Status::Unsupported,
    };
    PointBuildError: |error| match error {
        PointBuildError::OutOfMemory { .. } => Status::OutOfMemory,
        PointBuildError::Cancelled { .. } => Status::Cancelled,
        PointBuildError::Device(_) | PointBuildError::NotBitwise { .. } => Status::Device,
        _ => Status::Count,
    };
}

//! What can be wrong with frames.

use crate::builtin::BuiltinError;
use crate::from_file::{ReadError, quoted_path};
use crate::npy::NpyError;
use crate::obj::ObjError;
use crate::{CameraError, SceneError};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why there is no animation, or no such frame.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AnimationError {
    /// The scene cannot be opened.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The scene does not move by itself.
    #[error(
        "`{path}` does not move by itself; name its frames, a folder of .obj files, a .frames.bin or a .npy, or use builtin:carousel",
        path = quoted_path(.0)
    )]
    NoFrames(String),
    /// A frame past the last one.
    #[error("there is no frame {frame}; there are {frames}, counted from 0")]
    NoSuchFrame {
        /// The frame that was asked for.
        frame: usize,
        /// How many there are.
        frames: usize,
    },
    /// The file is not of a kind that holds frames.
    #[error(
        "`{path}` holds no frames; name a folder of .obj files, a .frames.bin or its .frames.json, or a .npy",
        path = quoted_path(.0)
    )]
    NotFrames(PathBuf),
    /// The system refuses to read it.
    #[error("cannot read the frames in `{path}`: {why}", path = quoted_path(.file))]
    Unreadable {
        /// The file or folder.
        file: PathBuf,
        /// What the system says.
        why: String,
    },
    /// A folder without .obj files.
    #[error("there are no .obj files in the folder `{path}`", path = quoted_path(.0))]
    EmptyFolder(PathBuf),
    /// An .obj file that cannot be read.
    #[error("frame {frame}: {error}")]
    Frame {
        /// The frame, counted from 0.
        frame: usize,
        /// What is wrong with its file, by name.
        error: ObjError,
    },
    /// A description that is not one.
    #[error("`{path}` does not describe frames: {why}", path = quoted_path(.file))]
    BadDescription {
        /// The .json file.
        file: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// The camera of a frame is none.
    #[error("`{path}`, frame {frame}: {error}", path = quoted_path(.file))]
    Camera {
        /// The .json file.
        file: PathBuf,
        /// The frame, counted from 0.
        frame: usize,
        /// What is wrong with it.
        error: CameraError,
    },
    /// The raw frames are of another size than described.
    #[error(
        "`{path}` has {found} bytes, but {frames} frames of {vertices} vertices take {expected}; it may be cut short, or its description may be of another file",
        path = quoted_path(.file)
    )]
    WrongSize {
        /// The .bin file.
        file: PathBuf,
        /// Frames, as described.
        frames: u64,
        /// Vertices of a frame, as described.
        vertices: u64,
        /// Bytes that they take.
        expected: u64,
        /// Bytes of the file.
        found: u64,
    },
    /// An .npy file that holds no frames.
    #[error("cannot read the frames in `{path}`: {error}", path = quoted_path(.file))]
    Array {
        /// The .npy file.
        file: PathBuf,
        /// What is wrong with it.
        error: NpyError,
    },
    /// The frames are not of this scene.
    #[error(
        "`{path}` has frames of {frame} vertices, but the scene `{name}` has {scene}",
        path = quoted_path(.file)
    )]
    VertexCount {
        /// The .json or .npy file.
        file: PathBuf,
        /// Vertices of a frame.
        frame: u64,
        /// The scene's name.
        name: String,
        /// Vertices of the scene.
        scene: usize,
    },
    /// The scene to be moved is not the one that was opened.
    #[error("the scene has {found} vertices, but the animation was opened for one of {expected}")]
    AnotherScene {
        /// Vertices of the scene that was opened.
        expected: usize,
        /// Vertices of this one.
        found: usize,
    },
}

impl From<BuiltinError> for AnimationError {
    fn from(error: BuiltinError) -> AnimationError {
        AnimationError::Scene(error.into())
    }
}

impl AnimationError {
    pub(super) fn unreadable(file: &Path, error: &io::Error) -> AnimationError {
        let why = match error.kind() {
            io::ErrorKind::NotFound => "there is no such file".to_owned(),
            _ => error.to_string(),
        };
        AnimationError::Unreadable { file: file.to_owned(), why }
    }

    pub(super) fn unread(file: &Path, error: ReadError) -> AnimationError {
        match error {
            ReadError::System(error) => AnimationError::unreadable(file, &error),
            error => AnimationError::Unreadable { file: file.to_owned(), why: error.to_string() },
        }
    }
}

//! What can be wrong with a file of a mesh or a scene, and where; read within limits.

use crate::SceneOptions;
use crate::from_file::{self, ReadError, quoted, quoted_path};
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A file of a mesh that cannot be read: where, and why.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct MeshFileError {
    /// The file.
    pub file: PathBuf,
    /// The place in it; `None` when the file as a whole is meant.
    pub place: Option<Place>,
    /// What is wrong.
    pub problem: MeshFileProblem,
}

/// A place in a file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// A line of text, counted from 1.
    Line(u64),
    /// A byte, counted from 0.
    Byte(u64),
    /// A field of JSON, such as `meshes[0].primitives[1].indices`.
    Field(String),
}

/// What is wrong with a file of a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MeshFileProblem {
    /// Nothing has this path.
    #[error("there is no such file; check the path")]
    Missing,
    /// The path is a folder.
    #[error("it is a folder; name a file in it")]
    Folder,
    /// The path is a pipe, a device or the like.
    #[error("it is not a regular file; copy it to one")]
    NotAFile,
    /// The system refuses to read it.
    #[error("the system says: {0}")]
    Unreadable(String),
    /// More bytes than are read.
    #[error("it has more than {limit} bytes, the most that are read")]
    TooLong {
        /// The most that are read.
        limit: u64,
    },
    /// What it says does not fit into memory.
    #[error("there is not memory enough for what it says")]
    Memory,
    /// A count that the bytes of the file cannot hold.
    #[error("it announces {count} {what}, but what follows has room for {most} at most")]
    Count {
        /// What is counted.
        what: String,
        /// How many the file says there are.
        count: u64,
        /// How many there can be.
        most: u64,
    },
    /// The file ends too early.
    #[error("the file ends within {0}; it may be cut short")]
    CutShort(String),
    /// An index past the end.
    #[error("{what} {index} is named, but there are {count}, counted from 0")]
    PastEnd {
        /// What is named.
        what: &'static str,
        /// The index.
        index: i64,
        /// How many there are.
        count: u64,
    },
    /// Something else that the format does not allow, or that is not read.
    #[error("{0}")]
    Wrong(String),
    /// Nothing to hit.
    #[error("it has no triangles, so there is nothing for a ray to hit")]
    NoTriangles,
    /// A mesh where points were asked for.
    #[error("it has no points")]
    NoPoints,
    /// More of something than can be numbered.
    #[error("it has more than {most} {what}, the most that there can be; split it")]
    TooMany {
        /// What.
        what: &'static str,
        /// The most.
        most: u64,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
            Place::Field(field) => f.write_str(&quoted(field)),
        }
    }
}

impl fmt::Display for MeshFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot read `{}`", quoted_path(&self.file))?;
        if let Some(place) = &self.place {
            write!(f, ", {place}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

impl MeshFileProblem {
    /// Whether a limit of size or memory binds, not the file.
    pub fn is_limit(&self) -> bool {
        use MeshFileProblem::{Memory, TooLong, TooMany};
        matches!(self, TooLong { .. } | Memory | TooMany { .. })
    }

    pub(crate) fn of_read(error: &ReadError, path: &Path) -> MeshFileProblem {
        match error {
            // A pipe or a device may never end.
            ReadError::NotAFile if path.is_dir() => MeshFileProblem::Folder,
            ReadError::NotAFile => MeshFileProblem::NotAFile,
            ReadError::TooLong { limit } => MeshFileProblem::TooLong { limit: *limit },
            ReadError::Memory => MeshFileProblem::Memory,
            ReadError::System(error) => match error.kind() {
                io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => MeshFileProblem::Missing,
                io::ErrorKind::IsADirectory => MeshFileProblem::Folder,
                _ => MeshFileProblem::Unreadable(error.to_string()),
            },
        }
    }
}

/// A problem and its place.
pub(crate) type Located = (Option<Place>, MeshFileProblem);

/// Names the file of a problem.
pub(crate) fn in_file(path: &Path) -> impl Fn(Located) -> MeshFileError + '_ {
    |(place, problem)| MeshFileError { file: path.to_owned(), place, problem }
}

/// All bytes of a regular file within the limit of the options.
pub(crate) fn bytes_of(path: &Path, options: &SceneOptions) -> Result<Vec<u8>, MeshFileError> {
    let limit = options.file_limit.unwrap_or_else(from_file::usual_limit);
    from_file::read(path, limit)
        .map_err(|error| in_file(path)((None, MeshFileProblem::of_read(&error, path))))
}

/// The file's name without its folder.
pub(crate) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Makes space in a list: a lack of memory is an error, not the end of the program.
pub(crate) fn room<T>(list: &mut Vec<T>, more: usize) -> Result<(), MeshFileProblem> {
    list.try_reserve(more).map_err(|_| MeshFileProblem::Memory)
}

//! What can be wrong with an OBJ file.

use crate::budget::Full;
use crate::from_file::quoted_path;
use std::fmt;
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// An OBJ file that cannot be read, where, and why.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub struct ObjError {
    /// The file.
    pub file: PathBuf,
    /// The line, counted from 1; `None` when the file as a whole is meant.
    pub line: Option<u64>,
    /// What is wrong.
    pub problem: ObjProblem,
}

impl fmt::Display for ObjError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot read `{}`", quoted_path(&self.file))?;
        if let Some(line) = self.line {
            write!(f, ", line {line}")?;
        }
        write!(f, ": {}", self.problem)
    }
}

/// What is wrong with an OBJ file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ObjProblem {
    /// Nothing has this path.
    #[error("there is no such file; check the path")]
    Missing,
    /// The path is a folder.
    #[error("it is a folder; name the .obj file in it")]
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
    /// Bytes that are not text.
    #[error("it is not UTF-8 text; save it as UTF-8, or check that it is an OBJ file at all")]
    NotUtf8,
    /// Nothing to hit.
    #[error("it has no faces of three or more corners, so there is nothing for a ray to hit")]
    NoTriangles,
    /// A coordinate that is not a number.
    #[error("`{0}` is not a number")]
    BadNumber(String),
    /// A vertex, normal or texture coordinate of too few numbers.
    #[error("a {of} needs {} numbers, this one has {found}", of.numbers())]
    FewNumbers {
        /// What the line gives.
        of: Element,
        /// How many numbers it has.
        found: usize,
    },
    /// A corner that is not an index.
    #[error("`{0}` is not a face corner; it should look like 7, 7/1, 7//3 or 7/1/3")]
    BadCorner(String),
    /// Index 0.
    #[error(
        "a face names {0} 0, but OBJ counts from 1; the file may have been written counting from 0"
    )]
    ZeroIndex(Element),
    /// An index past the end.
    #[error("a face names {of} {index}, but the file has {count}; it may be cut short")]
    PastEnd {
        /// What is named.
        of: Element,
        /// The index, counted from 1.
        index: u64,
        /// How many the file has.
        count: u64,
    },
    /// A relative index before the first one.
    #[error("a face names {of} {index}, counted back from here, but there are only {count} so far")]
    PastStart {
        /// What is named.
        of: Element,
        /// The index as written.
        index: i64,
        /// How many come before the line.
        count: u64,
    },
    /// More than 32-bit indices can name.
    #[error(
        "it has more than the {most} of one kind ({0}) that 32-bit indices can name; split it",
        most = u32::MAX
    )]
    TooMany(Element),
    /// More materials than a scene can have.
    #[error("it names more than {0} materials; merge some")]
    TooManyMaterials(usize),
    /// More triangles than one tree can hold.
    #[error(
        "it has more than the {} triangles that one tree can hold; split it",
        splitplane_core::mesh::MAX_TRIANGLES
    )]
    TooManyTriangles,
}

/// What the corners of a face name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Element {
    /// A position, `v`.
    Vertex,
    /// A texture coordinate, `vt`.
    TextureCoordinate,
    /// A normal, `vn`.
    Normal,
}

impl Element {
    /// The least count of numbers that make one.
    const fn numbers(self) -> usize {
        match self {
            Element::Vertex | Element::Normal => 3,
            Element::TextureCoordinate => 1,
        }
    }
}

impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Element::Vertex => "vertex",
            Element::TextureCoordinate => "texture coordinate",
            Element::Normal => "normal",
        })
    }
}

impl ObjProblem {
    /// Whether a limit of size or memory binds.
    pub fn is_limit(&self) -> bool {
        matches!(self, ObjProblem::TooLong { .. } | ObjProblem::Memory)
    }

    pub(super) fn unreadable(error: &io::Error) -> ObjProblem {
        match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => ObjProblem::Missing,
            io::ErrorKind::IsADirectory => ObjProblem::Folder,
            _ => ObjProblem::Unreadable(error.to_string()),
        }
    }
}

impl From<Full> for ObjProblem {
    /// Who sets a limit knows it, and says it.
    fn from(_: Full) -> ObjProblem {
        ObjProblem::Memory
    }
}

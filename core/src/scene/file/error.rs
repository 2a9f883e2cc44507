//! Why bytes are not a scene file.

use thiserror::Error;

use crate::mesh::MeshError;
use crate::scene::SceneError;
use crate::tree::file::FileError;

use super::VERSION;

/// Why bytes are not a scene file.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SceneFileError {
    /// Another kind of file.
    #[error("this is not a splitplane scene file: it does not start with the magic bytes")]
    Magic,
    /// A version that this library does not read.
    #[error("the file has format version {found}; this library reads version {VERSION}")]
    Version {
        /// The version it claims.
        found: u32,
    },
    /// Fewer or more bytes than the head says.
    #[error("the file has {found} bytes, but its head says {expected}; it was cut or extended")]
    Length {
        /// Actual number of bytes.
        found: u64,
        /// Expected number of bytes.
        expected: u64,
    },
    /// The bytes are not those that were written.
    #[error("the file's checksum does not match its content; it was altered or damaged")]
    Checksum,
    /// The bytes do not start at an address divisible by four, as reading without copying needs.
    #[error("the bytes must start at an address that is a multiple of 4")]
    Alignment,
    /// This machine is big-endian, so the bytes cannot be read without copying.
    #[error("scene files are read in place on little-endian machines only")]
    Endianness,
    /// The head and the records of geometries do not add up to the file, though the checksum matches.
    #[error("the records of the file do not describe its bytes")]
    Records,
    /// A geometry that is not valid, though the checksum matches.
    #[error("geometry {geometry}: {fault}")]
    Geometry {
        /// The geometry.
        geometry: u32,
        /// What is wrong with it.
        fault: GeometryFault,
    },
    /// A record of an instance that is none.
    #[error("the record of instance {instance} is out of range")]
    Instance {
        /// The instance.
        instance: u32,
    },
    /// An instance of a geometry that is not in the file.
    #[error("instance {instance} is one of geometry {geometry}, which is not in the file")]
    UnknownGeometry {
        /// The instance.
        instance: u32,
        /// The geometry that it names.
        geometry: u32,
    },
    /// A transform that no instance can have.
    #[error(transparent)]
    Transform(SceneError),
    /// Shapes or an opacity mask that no geometry can have, or no memory to look at them.
    #[error(transparent)]
    Content(SceneError),
    /// The digest in the head is not that of the scene.
    #[error("the file's digest is not that of its scene")]
    Digest,
}

/// What is wrong with a geometry of a scene file.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum GeometryFault {
    /// Its record is that of no geometry.
    #[error("its record is out of range")]
    Record,
    /// Its arrays are not a mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Its tree is not one.
    #[error("its tree: {0}")]
    Tree(#[from] FileError),
    /// Its tree was built over another mesh.
    #[error("its tree was built over another mesh")]
    OtherMesh,
}

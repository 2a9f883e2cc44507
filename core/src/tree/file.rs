//! The tree file: a tree as bytes that can be read back without copying, from untrusted sources.
//!
//! Little-endian throughout. A header of 128 bytes, then the nodes (8 bytes each), then the
//! references (4 bytes each):
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | magic `"splitkd\n"`: a text-mode transfer would alter it |
//! | 8..12 | version of the format, [`VERSION`] |
//! | 12..16 | size of the head, 128 |
//! | 16..52 | configuration: the first 9 of [`BuildConfig::words`] |
//! | 52..56 | triangles of the mesh |
//! | 56..80 | bounds: lower corner, upper corner |
//! | 80..84 | number of nodes |
//! | 84..88 | number of references |
//! | 88..96 | digest of the tree |
//! | 96..104 | digest of the mesh, see [`mesh_digest`] |
//! | 104..120 | configuration: the other 4 words |
//! | 120..128 | XXH64 of all other bytes of the file, with seed [`VERSION`] |
//!
//! Nodes and references are as [`KdTreeView`] has them, which [`validate`] checks: preorder, leaves
//! that name consecutive ranges of the references, and in each leaf the triangles in ascending
//! order, none twice. A triangle in a split plane is named completely on one side of it. Whether a
//! tree belongs to a mesh can only be checked with both: [`tree::validate::validate_mesh`](crate::tree::validate::validate_mesh), which
//! every backend calls when it loads a tree, refuses each tree that loses something.

use crate::aabb::Aabb;
use crate::config::BuildConfig;
use crate::mesh::Mesh;
use crate::tree::KdTreeView;
use crate::tree::digest::{Digest, Xxh64};
use crate::tree::validate::{Violation, validate};
use thiserror::Error;

/// The first eight bytes.
pub const MAGIC: [u8; 8] = *b"splitkd\n";
/// Version of the format that this library writes and reads.
pub const VERSION: u32 = 1;
const HEAD: usize = 128;
const CHECKSUM: usize = 120;

/// Why bytes are not a tree file.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FileError {
    /// Another kind of file.
    #[error("this is not a splitplane tree file: it does not start with the magic bytes")]
    Magic,
    /// A version that this library does not read.
    #[error("the file has format version {found}; this library reads version {VERSION}")]
    Version {
        /// The version it claims.
        found: u32,
    },
    /// Fewer or more bytes than the header says.
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
    /// The configuration is out of range.
    #[error("the file's configuration is out of range")]
    Config,
    /// The content is not a valid tree, though the checksum matches.
    #[error("the file does not hold a valid tree: {0}")]
    Tree(Violation),
    /// The bytes do not start at an address divisible by four, as reading without copying needs.
    #[error("the bytes must start at an address that is a multiple of 4")]
    Alignment,
    /// This machine is big-endian, so the bytes cannot be read without copying.
    #[error("tree files are read in place on little-endian machines only")]
    Endianness,
    /// The digest in the header is not that of the tree.
    #[error("the file's digest is not that of its tree")]
    Digest,
}

/// A tree file, read in place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeFile<'a> {
    /// The tree.
    pub tree: KdTreeView<'a>,
    /// The mesh that it was built over, see [`mesh_digest`].
    pub mesh: Digest,
}

impl<'a> TreeFile<'a> {
    /// Reads a file. Nothing is copied and nothing is trusted: lengths, checksum, digest and the
    /// structure of the tree are checked.
    ///
    /// # Errors
    /// The first thing wrong.
    pub fn parse(bytes: &'a [u8]) -> Result<TreeFile<'a>, FileError> {
        TreeFile::read(bytes, false)
    }

    /// [`TreeFile::parse`], without the checks that look at every byte where that has been done before.
    pub(crate) fn read(bytes: &'a [u8], was_checked: bool) -> Result<TreeFile<'a>, FileError> {
        if cfg!(target_endian = "big") {
            return Err(FileError::Endianness);
        }
        if bytes.len() < MAGIC.len() || bytes[..8] != MAGIC {
            return Err(FileError::Magic);
        }
        let found = bytes.len() as u64;
        if bytes.len() < HEAD {
            return Err(FileError::Length { found, expected: HEAD as u64 });
        }
        let word = |at: usize| {
            let mut word = [0; 4];
            word.copy_from_slice(&bytes[at..at + 4]);
            u32::from_le_bytes(word)
        };
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if word(8) != VERSION {
            return Err(FileError::Version { found: word(8) });
        }
        let (nodes, references) = (word(80) as usize, word(84) as usize);
        let expected = HEAD as u64 + 8 * nodes as u64 + 4 * references as u64;
        if found != expected || word(12) as usize != HEAD {
            return Err(FileError::Length { found, expected });
        }
        if !was_checked && checksum(bytes) != long(CHECKSUM) {
            return Err(FileError::Checksum);
        }
        let config_word = |i| word(if i < 9 { 16 + 4 * i } else { 104 + 4 * (i - 9) });
        let config =
            BuildConfig::from_words(core::array::from_fn(config_word)).ok_or(FileError::Config)?;
        let corner = |at: usize| [0, 1, 2].map(|axis| f32::from_bits(word(at + 4 * axis)));
        let (node_bytes, reference_bytes) = bytes[HEAD..].split_at(8 * nodes);
        let tree = KdTreeView {
            nodes: bytemuck::try_cast_slice(node_bytes).map_err(|_| FileError::Alignment)?,
            references: bytemuck::try_cast_slice(reference_bytes)
                .map_err(|_| FileError::Alignment)?,
            bounds: Aabb { lo: corner(56), hi: corner(68) },
            triangles: word(52),
            config,
        };
        if !was_checked {
            validate(&tree).map_err(FileError::Tree)?;
            if tree.digest() != Digest(long(88)) {
                return Err(FileError::Digest);
            }
        }
        Ok(TreeFile { tree, mesh: Digest(long(96)) })
    }
}

/// The bytes of a tree file.
///
/// # Errors
/// [`BuildError::OutOfMemory`](crate::error::BuildError::OutOfMemory) where the system has no memory for them.
#[cfg(feature = "alloc")]
pub fn write(
    tree: &KdTreeView<'_>,
    mesh: &Mesh<'_>,
) -> Result<alloc::vec::Vec<u8>, crate::error::BuildError> {
    let length = length(tree);
    let mut bytes = alloc::vec::Vec::new();
    bytes.try_reserve_exact(length).map_err(|_| crate::error::BuildError::OutOfMemory {
        needed: length as u64,
        limit: length as u64,
    })?;
    bytes.extend_from_slice(&MAGIC);
    let mut words = |words: &[u32]| {
        for word in words {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
    };
    words(&[VERSION, HEAD as u32]);
    let config = tree.config.words();
    words(&config[..9]);
    words(&[tree.triangles]);
    words(&tree.bounds.lo.map(f32::to_bits));
    words(&tree.bounds.hi.map(f32::to_bits));
    words(&[tree.nodes.len() as u32, tree.references.len() as u32]);
    for digest in [tree.digest().0, mesh_digest(mesh).0] {
        words(&[digest as u32, (digest >> 32) as u32]);
    }
    words(&config[9..]);
    // The checksum, below.
    words(&[0; 2]);
    for node in tree.nodes {
        words(&node.words());
    }
    words(tree.references);
    let sum = checksum(&bytes);
    bytes[CHECKSUM..HEAD].copy_from_slice(&sum.to_le_bytes());
    Ok(bytes)
}

/// Bytes of the tree's file.
#[cfg(feature = "alloc")]
pub(crate) const fn length(tree: &KdTreeView<'_>) -> usize {
    HEAD + size_of_val(tree.nodes) + size_of_val(tree.references)
}

/// The name of a mesh: XXH64 with seed 1 over the corners of all triangles as given, in order.
pub fn mesh_digest(mesh: &Mesh<'_>) -> Digest {
    let mut state = Xxh64::new(1);
    for triangle in 0..mesh.len() {
        let words: [[u32; 3]; 3] = mesh.triangle(triangle).map(|corner| corner.map(f32::to_bits));
        state.write_words(words.as_flattened());
    }
    Digest(state.finish())
}

/// XXH64 of all bytes except those that hold it.
fn checksum(bytes: &[u8]) -> u64 {
    let mut state = Xxh64::new(u64::from(VERSION));
    state.write(&bytes[..CHECKSUM]);
    state.write(&bytes[HEAD..]);
    state.finish()
}

#[cfg(all(test, feature = "alloc"))]
mod tests;

//! The scene file: a built scene as bytes, with its meshes, trees and instances, that can be read from untrusted sources.
//!
//! Little-endian throughout; all parts begin at multiples of four. A head of 64 bytes:
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | magic `"splitsc\n"`: a text-mode transfer would alter it |
//! | 8..12 | version of the format, [`VERSION`] |
//! | 12..16 | size of the head, 64 |
//! | 16..20 | number of names of geometries |
//! | 20..24 | number of names of instances |
//! | 24..32 | digest of the scene: [`BuiltScene::digest`](crate::backend::scene::BuiltScene::digest) |
//! | 32..40 | bytes of the file |
//! | 40..56 | zero |
//! | 56..64 | XXH64 of all other bytes of the file, with seed [`VERSION`] |
//!
//! Then a record of 32 bytes for each name of a geometry: its kind (0 none, 1 a mesh without indices, 2 one with
//! indices, 3 spheres, 4 capsules), the level of its opacity mask and one more (0 without), and as 64-bit numbers the positions or shapes, the triangles
//! with indices, and the bytes of its tree, which shapes do not have. Then one
//! of 64 bytes for each name of an instance: geometry, mask, number, culling (0 none, 1 back, 2 front) and
//! transform; where there is none, the geometry is `u32::MAX` and all else is zero. Then for each geometry its positions (12 bytes each), or
//! spheres (16) or capsules (28), indices (12 bytes for a triangle), the words of its mask, and its tree as a [tree file](crate::tree::file).
//!
//! Shapes of the user's own have no place in files. The trees over instances and over shapes are not kept: hits do not depend on them, and they are soon made.

mod error;

use alloc::vec::Vec;

use bytemuck::try_cast_slice;

pub use error::{GeometryFault, SceneFileError};

use super::description::{Checked, Instance, Scene, check};
use super::digest::SceneDigest;
use super::error::SceneError;
use super::hit::{GeometryId, InstanceId, MAX_INSTANCES};
use super::opacity::OpacityMask;
use super::shape::{Capsule, Shapes, Sphere};
use super::transform::{ObjectSpace, Transform};
use crate::mesh::Mesh;
use crate::ray::Culling;
use crate::tree::digest::{Digest, Xxh64};
use crate::tree::file::{TreeFile, mesh_digest};

/// The first eight bytes.
pub const MAGIC: [u8; 8] = *b"splitsc\n";
/// Version of the format that this library writes and reads.
pub const VERSION: u32 = 1;
pub(crate) const HEAD: usize = 64;
pub(crate) const CHECKSUM: usize = 56;
/// Bytes of the record of a geometry.
pub(crate) const GEOMETRY: usize = 32;
/// Bytes of the record of an instance.
pub(crate) const INSTANCE: usize = 64;
/// Kinds of geometries.
const NONE: u32 = 0;
pub(crate) const SOUP: u32 = 1;
pub(crate) const INDEXED: u32 = 2;
const SPHERES: u32 = 3;
const CAPSULES: u32 = 4;

/// A scene file, read in place. Everything in it has been checked, except whether each tree names what of its mesh it has to:
/// [`Backend::load_scene`](crate::backend::Backend::load_scene) does that.
#[derive(Clone, Copy, Debug)]
pub struct SceneFile<'a> {
    bytes: &'a [u8],
}

/// A geometry in a scene file.
#[derive(Clone, Copy, Debug)]
pub struct GeometryInFile<'a> {
    /// What it consists of.
    pub content: ContentInFile<'a>,
    /// The level and the words of its opacity mask.
    opacity: Option<(u32, &'a [u32])>,
}

/// What a geometry in a scene file consists of.
#[derive(Clone, Copy, Debug)]
pub enum ContentInFile<'a> {
    /// A mesh, and the tree over it.
    Mesh(Mesh<'a>, TreeFile<'a>),
    /// Spheres.
    Spheres(&'a [Sphere]),
    /// Capsules.
    Capsules(&'a [Capsule]),
}

impl GeometryInFile<'_> {
    /// The tree over its mesh; `None` for shapes.
    pub fn tree(&self) -> Option<&TreeFile<'_>> {
        match &self.content {
            ContentInFile::Mesh(_, tree) => Some(tree),
            _ => None,
        }
    }

    /// Its opacity mask, a copy.
    ///
    /// # Errors
    /// No memory, or words that are none of such a mask.
    pub fn opacity(&self) -> Result<Option<OpacityMask>, SceneError> {
        let triangles = match &self.content {
            ContentInFile::Mesh(mesh, _) => mesh.len(),
            _ => 0,
        };
        self.opacity
            .map(|(level, words)| OpacityMask::of_words(triangles, level, words))
            .transpose()
    }

    fn shapes(&self) -> Result<Option<Shapes>, SceneError> {
        Ok(match self.content {
            ContentInFile::Mesh(..) => None,
            ContentInFile::Spheres(all) => Some(Shapes::Spheres(copied(all)?)),
            ContentInFile::Capsules(all) => Some(Shapes::Capsules(copied(all)?)),
        })
    }
}

/// Where the parts of a geometry are.
#[derive(Clone, Copy)]
struct Extent {
    kind: u32,
    /// One more than the level of the opacity mask; 0 without.
    opacity: u32,
    positions: u64,
    triangles: u64,
    tree: u64,
}

impl Extent {
    /// Bytes of a position, or of a shape.
    const fn each(&self) -> u64 {
        match self.kind {
            SPHERES => size_of::<Sphere>() as u64,
            CAPSULES => size_of::<Capsule>() as u64,
            _ => 12,
        }
    }

    /// Words of the opacity mask; `None` where it can have none.
    fn opacity_words(&self) -> Option<u64> {
        let triangles = match (self.opacity, self.kind) {
            (0, _) => return Some(0),
            (_, SOUP) => self.positions / 3,
            (_, INDEXED) => self.triangles,
            _ => return None,
        };
        OpacityMask::words_of(triangles, self.opacity - 1)
    }

    /// Bytes of all parts; `None` where no file could have so many.
    fn bytes(&self) -> Option<u64> {
        let positions = self.positions.checked_mul(self.each())?;
        let indices = self.triangles.checked_mul(12)?;
        let opacity = self.opacity_words()?.checked_mul(4)?;
        positions.checked_add(indices)?.checked_add(opacity)?.checked_add(self.tree)
    }
}

impl<'a> SceneFile<'a> {
    /// Reads a file. Nothing is copied and nothing is trusted: lengths, checksum, all meshes, trees and instances, and
    /// the digests are checked.
    ///
    /// # Errors
    /// The first thing wrong.
    pub fn parse(bytes: &'a [u8]) -> Result<SceneFile<'a>, SceneFileError> {
        if cfg!(target_endian = "big") {
            return Err(SceneFileError::Endianness);
        }
        if bytes.len() < MAGIC.len() || bytes[..8] != MAGIC {
            return Err(SceneFileError::Magic);
        }
        let file = SceneFile { bytes };
        let found = bytes.len() as u64;
        if bytes.len() < HEAD {
            return Err(SceneFileError::Length { found, expected: HEAD as u64 });
        }
        if file.word(8) != VERSION {
            return Err(SceneFileError::Version { found: file.word(8) });
        }
        let expected = file.long(32);
        if found != expected || file.word(12) as usize != HEAD {
            return Err(SceneFileError::Length { found, expected });
        }
        if bytes.as_ptr().align_offset(4) != 0 {
            return Err(SceneFileError::Alignment);
        }
        if checksum(bytes) != file.long(CHECKSUM) {
            return Err(SceneFileError::Checksum);
        }
        // From here on only a forger is at work, or a program that writes such files and has a fault.
        if file.geometry_names().max(file.instance_names()) > MAX_INSTANCES {
            return Err(SceneFileError::Records);
        }
        let geometries = GEOMETRY as u64 * file.geometry_names() as u64;
        let records = HEAD as u64 + geometries + INSTANCE as u64 * file.instance_names() as u64;
        if records > found || bytes[40..CHECKSUM].iter().any(|&byte| byte != 0) {
            return Err(SceneFileError::Records);
        }
        let mut end = records;
        for name in 0..file.geometry_names() {
            let own = file.extent(name).bytes().and_then(|own| end.checked_add(own));
            end = own.filter(|&end| end <= found).ok_or(SceneFileError::Records)?;
        }
        if end != found {
            return Err(SceneFileError::Records);
        }
        file.check_content()?;
        Ok(file)
    }

    /// Checks every geometry and every instance, and the digest.
    fn check_content(&self) -> Result<(), SceneFileError> {
        let mut digest = SceneDigest::new();
        let mut at = self.instances_end();
        for name in 0..self.geometry_names() as u32 {
            let geometry = self.read_geometry(name, &mut at, false);
            let wrong = |fault| SceneFileError::Geometry { geometry: name, fault };
            if let Some(geometry) = geometry.map_err(wrong)? {
                // One geometry's shapes and mask at a time, for their names.
                let refused = SceneFileError::Content;
                let opacity = geometry.opacity().map_err(refused)?;
                let own = match (geometry.tree(), geometry.shapes().map_err(refused)?) {
                    (_, Some(shapes)) => shapes.digest(),
                    (Some(tree), None) => tree.tree.digest(),
                    (None, None) => continue,
                };
                digest.geometry(GeometryId(name), own, opacity.as_ref());
            }
        }
        for name in 0..self.instance_names() as u32 {
            let Some(instance) = self.read_instance(name)? else { continue };
            let kind = match instance.geometry.0 as usize {
                geometry if geometry < self.geometry_names() => self.extent(geometry).kind,
                _ => NONE,
            };
            if kind == NONE {
                let geometry = instance.geometry.0;
                return Err(SceneFileError::UnknownGeometry { instance: name, geometry });
            }
            check(name, &instance.transform).map_err(SceneFileError::Transform)?;
            let space = ObjectSpace::new(&instance.transform)
                .ok_or(SceneFileError::Instance { instance: name })?;
            digest.instance(InstanceId(name), &instance, &space.inverse);
        }
        if digest.finish() == self.digest() { Ok(()) } else { Err(SceneFileError::Digest) }
    }

    /// The digest of the scene.
    pub fn digest(&self) -> Digest {
        Digest(self.long(24))
    }

    /// One more than the greatest name of a geometry.
    pub fn geometry_names(&self) -> usize {
        self.word(16) as usize
    }

    /// One more than the greatest name of an instance.
    pub fn instance_names(&self) -> usize {
        self.word(20) as usize
    }

    /// All geometries, by their names; `None` where there is none.
    fn geometry_places(&self) -> impl ExactSizeIterator<Item = Option<GeometryInFile<'a>>> {
        let (file, mut at) = (*self, self.instances_end());
        // Checked when the file was parsed.
        (0..self.geometry_names() as u32)
            .map(move |name| file.read_geometry(name, &mut at, true).ok()?)
    }

    /// All geometries, in the order of their names.
    pub fn geometries(&self) -> impl Iterator<Item = (GeometryId, GeometryInFile<'a>)> {
        let named = self.geometry_places().enumerate();
        named.filter_map(|(name, at)| Some((GeometryId(name as u32), at?)))
    }

    /// All instances, in the order of their names.
    pub fn instances(&self) -> impl Iterator<Item = (InstanceId, Instance)> {
        let named = self.instance_places().enumerate();
        named.filter_map(|(name, at)| Some((InstanceId(name as u32), at?)))
    }

    fn instance_places(&self) -> impl ExactSizeIterator<Item = Option<Instance>> {
        let file = *self;
        (0..self.instance_names() as u32).map(move |name| file.read_instance(name).ok()?)
    }

    /// The description of the scene, which can then be edited. It has copies of the meshes. Names are what they were; of
    /// those that are free the least is given first.
    ///
    /// # Errors
    /// No memory.
    pub fn to_scene(&self) -> Result<Scene, SceneError> {
        let geometries = self.geometry_places().map(|geometry| {
            let Some(geometry) = geometry else { return Ok(None) };
            let mesh = match geometry.content {
                ContentInFile::Mesh(mesh, _) => mesh,
                _ => Mesh::of_checked(&[], None),
            };
            let (shapes, opacity) = (geometry.shapes()?, geometry.opacity()?);
            Ok(Some(Checked { mesh, shapes, opacity }))
        });
        Scene::of_checked(geometries, self.instance_places())
    }

    /// A geometry whose parts begin at `at`, which then is where the next one's begin. All parts are within the file. What looks at
    /// every byte of the tree or the mesh is done once, when the file is parsed.
    fn read_geometry(
        &self,
        name: u32,
        at: &mut usize,
        was_checked: bool,
    ) -> Result<Option<GeometryInFile<'a>>, GeometryFault> {
        let extent = self.extent(name as usize);
        if extent.kind == NONE {
            return match self.bytes[self.record(name as usize)..][..GEOMETRY] {
                [0, 0, 0, 0, ref rest @ ..] if rest.iter().all(|&byte| byte == 0) => Ok(None),
                _ => Err(GeometryFault::Record),
            };
        }
        let begin = *at;
        *at += extent.bytes().ok_or(GeometryFault::Record)? as usize;
        let shapes_end = begin + (extent.each() * extent.positions) as usize;
        let words = extent.opacity_words().ok_or(GeometryFault::Record)? as usize;
        let masked = shapes_end + 12 * extent.triangles as usize;
        let opacity = match extent.opacity {
            0 => None,
            level => Some((level - 1, cast(&self.bytes[masked..masked + 4 * words])?)),
        };
        let own = &self.bytes[begin..shapes_end];
        let content = match (extent.kind, extent.triangles, extent.tree) {
            (SPHERES, 0, 0) => ContentInFile::Spheres(cast(own)?),
            (CAPSULES, 0, 0) => ContentInFile::Capsules(cast(own)?),
            (SOUP | INDEXED, ..) => {
                let mesh = self.read_mesh(&extent, begin)?;
                let tree =
                    TreeFile::read(&self.bytes[*at - extent.tree as usize..*at], was_checked)?;
                if !was_checked && tree.mesh != mesh_digest(&mesh) {
                    return Err(GeometryFault::OtherMesh);
                }
                ContentInFile::Mesh(mesh, tree)
            }
            _ => return Err(GeometryFault::Record),
        };
        Ok(Some(GeometryInFile { content, opacity }))
    }

    fn read_mesh(&self, extent: &Extent, begin: usize) -> Result<Mesh<'a>, GeometryFault> {
        let between = begin + 12 * extent.positions as usize;
        let end = between + 12 * extent.triangles as usize;
        let positions = &self.bytes[begin..between];
        Ok(match (extent.kind, extent.triangles) {
            (SOUP, 0) => Mesh::soup(cast(positions)?)?,
            (INDEXED, _) => Mesh::indexed(cast(positions)?, cast(&self.bytes[between..end])?)?,
            _ => return Err(GeometryFault::Record),
        })
    }

    /// An instance; `None` where there is none of this name.
    fn read_instance(&self, name: u32) -> Result<Option<Instance>, SceneFileError> {
        let at = self.geometries_end() + INSTANCE * name as usize;
        let word = |place: usize| self.word(at + 4 * place);
        let wrong = SceneFileError::Instance { instance: name };
        if word(0) == u32::MAX {
            return if (1..16).all(|place| word(place) == 0) { Ok(None) } else { Err(wrong) };
        }
        let culling = match word(3) {
            0 => Culling::None,
            1 => Culling::Back,
            2 => Culling::Front,
            _ => return Err(wrong),
        };
        let number = |place: usize| f32::from_bits(word(4 + place));
        let transform: Transform =
            core::array::from_fn(|row| core::array::from_fn(|column| number(4 * row + column)));
        let [geometry, mask, id] = [word(0), word(1), word(2)];
        Ok(Some(Instance { geometry: GeometryId(geometry), transform, mask, id, culling }))
    }

    fn extent(&self, geometry: usize) -> Extent {
        let at = self.record(geometry);
        Extent {
            kind: self.word(at),
            opacity: self.word(at + 4),
            positions: self.long(at + 8),
            triangles: self.long(at + 16),
            tree: self.long(at + 24),
        }
    }

    const fn record(&self, geometry: usize) -> usize {
        HEAD + GEOMETRY * geometry
    }

    fn geometries_end(&self) -> usize {
        self.record(self.geometry_names())
    }

    fn instances_end(&self) -> usize {
        self.geometries_end() + INSTANCE * self.instance_names()
    }

    fn word(&self, at: usize) -> u32 {
        let mut word = [0; 4];
        word.copy_from_slice(&self.bytes[at..at + 4]);
        u32::from_le_bytes(word)
    }

    fn long(&self, at: usize) -> u64 {
        u64::from(self.word(at)) | u64::from(self.word(at + 4)) << 32
    }
}

fn copied<T: Copy>(all: &[T]) -> Result<Vec<T>, SceneError> {
    let mut own = Vec::new();
    let bytes = size_of_val(all) as u64;
    own.try_reserve_exact(all.len()).map_err(|_| SceneError::OutOfMemory { bytes })?;
    own.extend_from_slice(all);
    Ok(own)
}

/// Bytes as numbers.
fn cast<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Result<&[T], GeometryFault> {
    try_cast_slice(bytes).map_err(|_| GeometryFault::Record)
}

/// XXH64 of all bytes except those that hold it.
pub(crate) fn checksum(bytes: &[u8]) -> u64 {
    let mut state = Xxh64::new(u64::from(VERSION));
    state.write(&bytes[..CHECKSUM]);
    state.write(&bytes[HEAD..]);
    state.finish()
}

//! Writing scene files.

use alloc::vec::Vec;
use thiserror::Error;

use super::built::BuiltScene;
use crate::error::BuildError;
use crate::scene::ShapeTree;
use crate::scene::file::{
    CHECKSUM, GEOMETRY, HEAD, INDEXED, INSTANCE, MAGIC, SOUP, VERSION, checksum,
};
use crate::scene::shape::Shapes;
use crate::scene::{GeometryId, Instance, InstanceId, OpacityMask};
use crate::tree::file;

/// Why a scene was not written.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SceneWriteError {
    /// A geometry of the user's own shapes, whose functions no file can hold.
    #[error("geometry {geometry} consists of own shapes, which cannot be saved")]
    OwnShapes {
        /// The geometry.
        geometry: u32,
    },
    /// No memory for the bytes.
    #[error(transparent)]
    Build(#[from] BuildError),
}

/// The bytes of a scene file: everything that is built, with the meshes it was built over.
///
/// # Errors
/// A geometry of the user's own shapes, and no memory for the bytes. The trees of geometries are written one after another, each
/// into memory of its own.
pub fn write_file(built: &BuiltScene) -> Result<Vec<u8>, SceneWriteError> {
    let geometry_names = built.geometries().last().map_or(0, |(name, _)| name.0 as usize + 1);
    let instance_names = built.placements().last().map_or(0, |(name, _)| name.0 as usize + 1);
    let records = HEAD + GEOMETRY * geometry_names + INSTANCE * instance_names;
    let mut length = records;
    for (name, geometry) in built.geometries() {
        length += geometry.opacity().map_or(0, |mask| size_of_val(mask.words()));
        length += match geometry.shapes().map(ShapeTree::shapes) {
            Some(Shapes::Spheres(all)) => size_of_val(&all[..]),
            Some(Shapes::Capsules(all)) => size_of_val(&all[..]),
            Some(Shapes::Own(_)) => return Err(SceneWriteError::OwnShapes { geometry: name.0 }),
            None => {
                let (positions, indices) = geometry.mesh().mesh().arrays();
                size_of_val(positions)
                    + indices.map_or(0, size_of_val)
                    + file::length(&geometry.accelerator().tree().view())
            }
        };
    }
    let mut bytes = Vec::new();
    let needed = length as u64;
    bytes
        .try_reserve_exact(length)
        .map_err(|_| BuildError::OutOfMemory { needed, limit: needed })?;
    bytes.resize(records, 0);

    bytes[..8].copy_from_slice(&MAGIC);
    put(&mut bytes, 8, &[VERSION, HEAD as u32, geometry_names as u32, instance_names as u32]);
    put_longs(&mut bytes, 24, &[built.digest().0, needed]);
    for (name, geometry) in built.geometries() {
        let at = HEAD + GEOMETRY * name.0 as usize;
        let kind = geometry.shapes().map(|shapes| u64::from(shapes.shapes().kind()));
        match geometry.shapes().map(ShapeTree::shapes) {
            Some(Shapes::Spheres(all)) => {
                put_longs(&mut bytes, at, &[kind.unwrap_or(0), all.len() as u64]);
                extend(&mut bytes, bytemuck::cast_slice(all));
                continue;
            }
            Some(Shapes::Capsules(all)) => {
                put_longs(&mut bytes, at, &[kind.unwrap_or(0), all.len() as u64]);
                extend(&mut bytes, bytemuck::cast_slice(all));
                continue;
            }
            Some(Shapes::Own(_)) | None => {}
        }
        let mesh = geometry.mesh().mesh();
        let (positions, indices) = mesh.arrays();
        let tree = file::write(&geometry.accelerator().tree().view(), &mesh)?;
        let kind = if indices.is_some() { INDEXED } else { SOUP };
        let triangles = indices.map_or(0, <[_]>::len) as u64;
        let level = geometry.opacity().map_or(0, |mask| u64::from(mask.level()) + 1);
        let kind = u64::from(kind) | level << 32;
        let record = [kind, positions.len() as u64, triangles, tree.len() as u64];
        put_longs(&mut bytes, at, &record);
        extend(&mut bytes, bytemuck::cast_slice(positions));
        extend(&mut bytes, bytemuck::cast_slice(indices.unwrap_or_default()));
        extend(&mut bytes, geometry.opacity().map_or(&[], OpacityMask::words));
        bytes.extend_from_slice(&tree);
    }
    for name in 0..instance_names {
        let at = HEAD + GEOMETRY * geometry_names + INSTANCE * name;
        let Some(placement) = built.placement(InstanceId(name as u32)) else {
            put(&mut bytes, at, &[u32::MAX]);
            continue;
        };
        let Instance { geometry: GeometryId(geometry), transform, mask, id, culling } =
            placement.instance;
        put(&mut bytes, at, &[geometry, mask, id, culling as u32]);
        put(&mut bytes, at + 16, transform.map(|row| row.map(f32::to_bits)).as_flattened());
    }
    let sum = checksum(&bytes);
    put_longs(&mut bytes, CHECKSUM, &[sum]);
    Ok(bytes)
}

fn put(bytes: &mut [u8], at: usize, words: &[u32]) {
    for (place, word) in bytes[at..].chunks_exact_mut(4).zip(words) {
        place.copy_from_slice(&word.to_le_bytes());
    }
}

fn put_longs(bytes: &mut [u8], at: usize, longs: &[u64]) {
    for (place, long) in bytes[at..].chunks_exact_mut(8).zip(longs) {
        place.copy_from_slice(&long.to_le_bytes());
    }
}

fn extend(bytes: &mut Vec<u8>, words: &[u32]) {
    words.iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
}

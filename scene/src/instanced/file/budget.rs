//! The memory that a scene file may ask for beside what its files hold.

use super::SceneFileProblem;
use crate::Scene;
use std::ops::Range;

/// Bytes that a file asks for by naming things again: a part of an .obj file once more, with another material or as another group; .obj files after the first, which may be links to one; opacity masks, which are
/// finer than what they are made from; and baked instances. A small file may ask for more than a machine has. All are counted before they are taken, but for
/// further .obj files, whose size is known once they are read.
pub(super) struct Budget {
    taken: u64,
    limit: u64,
}

impl Budget {
    pub(super) fn new(limit: u64) -> Budget {
        Budget { taken: 0, limit }
    }

    /// Counts bytes; an error where there are too many.
    pub(super) fn take(&mut self, bytes: u64) -> Result<(), SceneFileProblem> {
        self.taken = self.taken.saturating_add(bytes);
        let (needed, limit) = (self.taken, self.limit);
        if needed > limit {
            return Err(SceneFileProblem::Memory { needed, limit });
        }
        Ok(())
    }
}

/// Bytes of a corner's coordinates, and of three numbers of corners.
pub(super) const THREE: u64 = 12;
/// Bytes of a place in a picture.
const TWO: u64 = 8;

/// Most bytes that a triangle takes beside its corners' coordinates: their numbers, its material, and three normals and places in pictures of its own where a scene has any.
pub(super) fn bytes_of_triangle(scene: &Scene) -> u64 {
    let mut bytes = THREE + size_of::<u32>() as u64;
    if !scene.normal_indices.is_empty() {
        bytes += THREE + 3 * THREE;
    }
    if !scene.texcoord_indices.is_empty() {
        bytes += THREE + 3 * TWO;
    }
    bytes
}

/// Most bytes of a copy of these triangles of a scene.
pub(super) fn bytes_of_copy(scene: &Scene, runs: &[Range<u32>]) -> u64 {
    let triangles: u64 = runs.iter().map(|run| run.len() as u64).sum();
    let corners = (3 * triangles).min(scene.positions.len() as u64);
    triangles.saturating_mul(bytes_of_triangle(scene)) + corners * THREE
}

/// Bytes of the arrays of an .obj file that was read, those of vertices that no triangle has among them.
pub(super) fn bytes_of_file(scene: &Scene) -> u64 {
    let threes = scene.positions.len() + scene.normals.len();
    let triangles = scene.indices.len() as u64;
    let arrays = threes as u64 * THREE + scene.texcoords.len() as u64 * TWO;
    let numbers = scene.normal_indices.len() + scene.texcoord_indices.len();
    arrays + numbers as u64 * THREE + triangles * (THREE + size_of::<u32>() as u64)
}

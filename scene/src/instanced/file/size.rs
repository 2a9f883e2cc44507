//! What parts of a scene take, before they are made.

use super::SceneFileProblem;
use crate::Scene;
use crate::budget::{Budget, Full, bytes_of, bytes_of_map};
use crate::instanced::{Geometry, InstancedScene};
use splitplane_core::scene::shape::Capsule;
use splitplane_core::scene::{GeometryMesh, Instance};
use std::ops::Range;
use std::path::Path;

/// Bytes of a corner's coordinates, and of three numbers of corners.
const THREE: u64 = 12;
/// Bytes of a place in a picture.
const TWO: u64 = 8;
/// How often a path is there until the file it names is read or refused: in its folder, as the system takes it, and in errors.
const PATHS: u64 = 8;

/// Most bytes that a triangle takes beside its corners' coordinates: their numbers, its material, and three normals and places in pictures of its own where a scene has any.
fn bytes_of_triangle(scene: &Scene) -> u64 {
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
pub(super) fn bytes_of_copy(scene: &Scene, triangles: usize) -> u64 {
    let corners = triangles.saturating_mul(3).min(scene.positions.len()) as u64;
    (triangles as u64).saturating_mul(bytes_of_triangle(scene)) + corners * THREE
}

/// Bytes that are taken while a copy is made: values are found by their old numbers.
pub(super) fn bytes_while_copied(scene: &Scene, triangles: usize) -> u64 {
    let values = scene.positions.len().max(scene.normals.len()).max(scene.texcoords.len());
    bytes_of_map::<u32, u32>(triangles.saturating_mul(3).min(values))
}

/// Bytes that are taken while the file of a path in a folder is looked for.
pub(super) fn bytes_of_path(folder: &Path, path: &str) -> u64 {
    PATHS * (folder.as_os_str().len() as u64 + path.len() as u64 + 1)
}

/// Most bytes of the table of a scene's groups and objects, and what is taken besides while it is made.
pub(super) fn bytes_of_groups(scene: &Scene) -> (u64, u64) {
    let (mut names, mut letters) = (0, 0);
    for group in &scene.groups {
        let words = group.name.split_ascii_whitespace().filter(|_| !group.is_object);
        names += 1 + words.count();
        letters += 2 * group.name.len() as u64;
    }
    type Runs = Vec<Range<u32>>;
    // A list of runs has room for four at first, and grows by doubling.
    let runs = bytes_of::<Range<u32>>(names.saturating_mul(4 + 3));
    let kept = bytes_of_map::<(bool, String), Runs>(names) + letters + runs;
    let first = bytes_of_map::<(bool, &str), Runs>(names);
    // A table that grows is there with its former one, of half the size.
    (kept, first + first / 2 + bytes_of::<&str>(3 * scene.groups.len()))
}

/// Makes room for a geometry in a scene: a copy of so many triangles of another.
pub(super) fn room_for_copy(
    scene: &mut InstancedScene,
    from: &Scene,
    triangles: usize,
    budget: &Budget,
) -> Result<(), SceneFileProblem> {
    let Scene {
        positions,
        indices,
        material_of,
        normals,
        normal_indices,
        texcoords,
        texcoord_indices,
        ..
    } = &mut scene.parts;
    let of = |values: usize| triangles.saturating_mul(3).min(values);
    // Lists by triangle have an entry for each once they begin.
    let all = indices.len() + triangles;
    budget.grow(positions, of(from.positions.len()))?;
    budget.grow(indices, triangles)?;
    budget.grow(material_of, triangles)?;
    if !from.normal_indices.is_empty() {
        budget.grow(normals, of(from.normals.len()))?;
        budget.grow(normal_indices, all.saturating_sub(normal_indices.len()))?;
    }
    if !from.texcoord_indices.is_empty() {
        budget.grow(texcoords, of(from.texcoords.len()))?;
        budget.grow(texcoord_indices, all.saturating_sub(texcoord_indices.len()))?;
    }
    Ok(())
}

/// Makes room for one geometry more with this name.
pub(super) fn room_for_geometry(
    scene: &mut InstancedScene,
    name: &str,
    budget: &Budget,
) -> Result<(), SceneFileProblem> {
    budget.grow(&mut scene.geometries, 1)?;
    Ok(budget.take(name.len() as u64)?)
}

/// Makes room for an entry of every triangle in lists by triangle that have begun.
pub(super) fn room_to_finish(
    scene: &mut InstancedScene,
    budget: &Budget,
) -> Result<(), SceneFileProblem> {
    let triangles = scene.parts.indices.len();
    let Scene { normal_indices, texcoord_indices, .. } = &mut scene.parts;
    for corners in [normal_indices, texcoord_indices] {
        if !corners.is_empty() {
            budget.grow(corners, triangles.saturating_sub(corners.len()))?;
        }
    }
    Ok(())
}

/// Bytes of the mesh in the world that an instance of a geometry becomes a part of.
pub(super) fn bytes_in_world(own: &Geometry) -> u64 {
    (own.vertices.len() as u64 + own.triangles.len() as u64) * THREE
}

/// Most bytes that the scene itself gets more for it: the same corners, and what its triangles look like.
pub(super) fn bytes_when_baked(scene: &Scene, own: &Geometry) -> u64 {
    own.vertices.len() as u64 * THREE + own.triangles.len() as u64 * bytes_of_triangle(scene)
}

/// Makes room for triangles that are baked. Lists are as long then as they will be.
pub(super) fn room_for_baked(
    scene: &mut Scene,
    (vertices, triangles): (usize, usize),
    budget: &Budget,
) -> Result<(), Full> {
    budget.grow_exact(&mut scene.positions, vertices)?;
    budget.grow_exact(&mut scene.indices, triangles)?;
    budget.grow_exact(&mut scene.material_of, triangles)?;
    if !scene.normal_indices.is_empty() {
        budget.grow_exact(&mut scene.normals, triangles.saturating_mul(3))?;
        budget.grow_exact(&mut scene.normal_indices, triangles)?;
    }
    if !scene.texcoord_indices.is_empty() {
        budget.grow_exact(&mut scene.texcoords, triangles.saturating_mul(3))?;
        budget.grow_exact(&mut scene.texcoord_indices, triangles)?;
    }
    Ok(())
}

/// Most bytes that are taken while normals, or places in pictures, of an instance are copied.
pub(super) fn bytes_while_baked(scene: &Scene, triangles: usize) -> u64 {
    let of = |corners: &[[u32; 3]], values: usize| {
        if corners.is_empty() {
            return 0;
        }
        let most = triangles.saturating_mul(3);
        bytes_of_map::<u32, u32>(most.min(values)) + bytes_of::<[u32; 3]>(4 * triangles)
    };
    of(&scene.normal_indices, scene.normals.len())
        .max(of(&scene.texcoord_indices, scene.texcoords.len()))
}

/// Most bytes of the descriptions of a scene before and after instances of it are baked, without the meshes that they become, and of lists on the way. Both descriptions share the meshes
/// of the first.
pub(super) fn bytes_of_descriptions(scene: &InstancedScene, baked: usize, groups: usize) -> u64 {
    /// A list that grows has room for up to twice its entries, and is there twice while it moves.
    const GROWN: usize = 3;
    const NAME: usize = size_of::<u32>();
    // With what says that it is there, and in the log of edits.
    const INSTANCE: usize = GROWN * (size_of::<Instance>() + 8 + NAME);
    // With the counts of who shares it; twice, and among the free.
    const GEOMETRY: usize = size_of::<GeometryMesh>() + 16 + GROWN * (2 * 48 + NAME);
    // Among those that are chosen, twice, in its group, in the log, among the free, and in two tables.
    const BAKED: usize = GROWN * 6 * NAME + (1 + GROWN) * 12;
    const GROUP: usize = 16 + GROWN * (40 + 8 + 8);
    let parts = &scene.parts;
    // The indices of one geometry are made anew before they are copied.
    let meshes = bytes_of::<[f32; 3]>(parts.positions.len() + 2 * parts.indices.len());
    let solids = scene.solids() as u64 * size_of::<Capsule>() as u64;
    let geometries = scene.geometries.len() + groups + 1;
    let counted = [
        (scene.instances.len(), INSTANCE),
        (geometries, GEOMETRY),
        (baked, BAKED),
        (groups, GROUP),
    ];
    let lists = counted.iter().map(|(count, bytes)| *count as u64 * *bytes as u64).sum::<u64>();
    meshes + solids + lists
}

//! Instances that a scene file bakes: those of one name become one geometry in the world.

use super::format::File;
use super::locate::Step;
use super::size::{
    bytes_in_world, bytes_of_descriptions, bytes_when_baked, bytes_while_baked, room_for_baked,
    room_for_geometry,
};
use super::{At, SceneFileProblem};
use crate::budget::{Budget, Full};
use crate::instanced::part::copied;
use crate::instanced::{Baked, Geometry, InstancedScene, Placed, Pose};
use crate::{Scene, normals};
use glam::{DMat3, DVec3};
use splitplane_core::mesh::MAX_TRIANGLES;
use splitplane_core::scene::{BakeError, GeometryId, InstanceId, Transform};
use std::collections::HashMap;

/// More vertices than so many triangles can name are of no use, and instances may repeat them many times.
const MOST_VERTICES: usize = 3 * MAX_TRIANGLES;

/// Bakes what the file says, within a limit of memory. Geometries and instances keep their places.
pub(super) fn read(file: &File<'_>, scene: &mut InstancedScene, budget: &Budget) -> Result<(), At> {
    // In the order of their least instances.
    let mut groups: Vec<(&str, Vec<InstanceId>)> = Vec::new();
    let mut places: HashMap<&str, usize> = HashMap::new();
    for (index, own) in file.instances.iter().enumerate() {
        let Some(name) = own.bake.as_deref() else { continue };
        let full = |full: Full| (field(index), full.into());
        let place = match places.get(name) {
            Some(&place) => place,
            None => {
                budget.grow_map(&mut places).map_err(full)?;
                budget.push(&mut groups, (name, Vec::new())).map_err(full)?;
                places.insert(name, groups.len() - 1);
                groups.len() - 1
            }
        };
        budget.push(&mut groups[place].1, InstanceId(index as u32)).map_err(full)?;
    }
    if groups.is_empty() {
        return Ok(());
    }
    let whole = || vec![Step::Field("instances")];
    let baked = groups.iter().map(|(_, names)| names.len()).sum();
    let lists = bytes_of_descriptions(scene, baked, groups.len());
    budget.take(lists).map_err(|full| (whole(), full.into()))?;
    let world_bytes =
        check_size(scene, &groups, budget).map_err(|(index, problem)| (field(index), problem))?;
    let mut chosen: Vec<usize> =
        groups.iter().flat_map(|(_, names)| names).map(|name| name.0 as usize).collect();
    chosen.sort_unstable();
    for index in chosen {
        if let Some(why) = refusal(scene, index) {
            return Err((field(index), SceneFileProblem::Wrong(why)));
        }
    }
    let described = scene.describe().map_err(|error| (whole(), error.into()))?;
    let chosen: Vec<&[InstanceId]> = groups.iter().map(|(_, names)| &names[..]).collect();
    let (world, table) = described.bake(&chosen).map_err(|error| {
        let instance = of(&error).filter(|index| *index < file.instances.len());
        (instance.map_or_else(whole, field), SceneFileProblem::Bake(error))
    })?;
    let mut baked = Baked { table, ..Baked::default() };
    let gone = |index: &u32| world.geometry(GeometryId(*index)).is_err();
    baked.geometries.extend((0..scene.geometries.len() as u32).filter(gone));
    let merged: Vec<(InstanceId, GeometryId)> = baked.table.groups().collect();
    for ((_, names), (first, geometry)) in groups.iter().zip(merged) {
        let mesh = world.geometry(geometry).map_err(|error| (whole(), failed(error)))?.mesh();
        // What is baked has indices.
        let (positions, indices) = mesh.arrays();
        let indices = indices.unwrap_or_default();
        let name = file.instances[first.0 as usize].bake.as_deref().unwrap_or_default();
        let number = add(scene, name, names, (positions, indices), budget)
            .map_err(|problem| (field(first.0 as usize), problem))?;
        let own = &mut scene.instances[first.0 as usize];
        let place = Placed::new(number, Pose::IDENTITY.transform());
        *own = Placed { mask: own.mask, id: own.id, culling: own.culling, ..place };
        baked.instances.extend(names[1..].iter().map(|name| name.0));
    }
    baked.instances.sort_unstable();
    budget.give(lists.saturating_add(world_bytes));
    if !baked.instances.is_empty() {
        // One geometry without triangles for all that is gone.
        let number = scene.geometries.len() as u32;
        let (vertex, triangle) =
            (scene.parts.positions.len() as u32, scene.parts.indices.len() as u32);
        let (vertices, triangles) = (vertex..vertex, triangle..triangle);
        room_for_geometry(scene, "", budget).map_err(|problem| (whole(), problem))?;
        scene.geometries.push(Geometry { vertices, triangles, ..Geometry::default() });
        for &instance in &baked.instances {
            scene.instances[instance as usize].geometry = number;
        }
        baked.geometries.push(number);
    }
    scene.baked = baked;
    Ok(())
}

/// Refuses what would be too large, before any memory is taken for it, and makes room in the scene for what is not. The error has the instance with which it becomes too large. Gives the
/// bytes of what is baked outside of the scene.
fn check_size(
    scene: &mut InstancedScene,
    groups: &[(&str, Vec<InstanceId>)],
    budget: &Budget,
) -> Result<u64, (usize, SceneFileProblem)> {
    let (mut world_bytes, mut scene_bytes, mut last) = (0, 0, 0);
    let (mut triangles, mut vertices) = (scene.parts.indices.len(), scene.parts.positions.len());
    for InstanceId(instance) in groups.iter().flat_map(|(_, names)| names) {
        let index = *instance as usize;
        let own = &scene.geometries[scene.instances[index].geometry as usize];
        triangles = triangles.saturating_add(own.triangles.len());
        vertices = vertices.saturating_add(own.vertices.len());
        for (count, what, most) in [
            (triangles, "triangles in all geometries and baked instances together", MAX_TRIANGLES),
            (vertices, "vertices in all geometries and baked instances together", MOST_VERTICES),
        ] {
            if count > most {
                return Err((index, SceneFileProblem::TooMany { what, most }));
            }
        }
        let (world, more) = (bytes_in_world(own), bytes_when_baked(&scene.parts, own));
        budget.take(world.saturating_add(more)).map_err(|full| (index, full.into()))?;
        (world_bytes, scene_bytes, last) = (world_bytes + world, scene_bytes + more, index);
    }
    budget.give(scene_bytes);
    let parts = &mut scene.parts;
    let more = (vertices - parts.positions.len(), triangles - parts.indices.len());
    room_for_baked(parts, more, budget).map_err(|full| (last, full.into()))?;
    Ok(world_bytes)
}

fn field(index: usize) -> Vec<Step> {
    vec![Step::Field("instances"), Step::Element(index), Step::Field("bake")]
}

fn failed(error: splitplane_core::scene::SceneError) -> SceneFileProblem {
    SceneFileProblem::Bake(error.into())
}

/// The instance that an error names.
fn of(error: &BakeError) -> Option<usize> {
    let instance = match error {
        BakeError::Twice { instance }
        | BakeError::Shapes { instance }
        | BakeError::Opacity { instance }
        | BakeError::Differs { instance, .. }
        | BakeError::TooFar { instance, .. }
        | BakeError::TooMany { instance } => *instance,
        _ => return None,
    };
    Some(instance as usize)
}

/// Why an instance cannot be baked, where the description of the scene does not know it.
fn refusal(scene: &InstancedScene, index: usize) -> Option<&'static str> {
    let placed = &scene.instances[index];
    if !placed.keys.is_empty() {
        return Some("an instance that keys move cannot be baked");
    }
    // Pictures tell the inside of a clear body by the winding of its triangles, and of an instance by its reflection too.
    let (_, mirrored) = matrix(&placed.transform);
    let clear = |material: u32| {
        let own = scene.parts.materials.get(material as usize);
        own.is_some_and(|own| own.dielectric.is_some())
    };
    let own = &scene.geometries[placed.geometry as usize].triangles;
    let own = &scene.parts.material_of[own.start as usize..own.end as usize];
    let is_clear = || match placed.material {
        Some(material) => clear(material),
        None => own.iter().any(|material| clear(*material)),
    };
    (mirrored && is_clear())
        .then_some("a reflected body of glass cannot be baked: its inside would be outside")
}

/// The linear part of a transform, and whether it reflects.
fn matrix(transform: &Transform) -> (DMat3, bool) {
    let [x, y, z] = transform.map(|row| row.map(f64::from));
    let matrix = DMat3::from_cols_array_2d(&std::array::from_fn(|k| [x[k], y[k], z[k]]));
    (matrix, matrix.determinant() < 0.0)
}

/// Adds the geometry of a group: its corners in the world, and what its instances' triangles look like.
fn add(
    scene: &mut InstancedScene,
    name: &str,
    group: &[InstanceId],
    (positions, indices): (&[[f32; 3]], &[[u32; 3]]),
    budget: &Budget,
) -> Result<u32, SceneFileProblem> {
    room_for_geometry(scene, name, budget)?;
    let parts = &mut scene.parts;
    let (vertex, triangle) = (parts.positions.len() as u32, parts.indices.len() as u32);
    parts.positions.extend_from_slice(positions);
    parts.indices.extend(indices.iter().map(|corners| corners.map(|corner| corner + vertex)));
    for instance in group {
        let placed = &scene.instances[instance.0 as usize];
        let own = &scene.geometries[placed.geometry as usize].triangles;
        let own = own.start as usize..own.end as usize;
        for triangle in own.clone() {
            parts.material_of.push(placed.material.unwrap_or(parts.material_of[triangle]));
        }
        // Directions across surfaces go by the inverse transposed.
        let across = matrix(&placed.transform).0.inverse().transpose();
        let map = |normal: [f32; 3]| {
            normals::unit((across * DVec3::from_array(normal.map(f64::from))).to_array())
        };
        let meanwhile = bytes_while_baked(parts, own.len());
        budget.take(meanwhile)?;
        let Scene { normals, normal_indices, texcoords, texcoord_indices, .. } = parts;
        copied(normals, normal_indices, own.clone(), map);
        copied(texcoords, texcoord_indices, own, |texcoord| texcoord);
        budget.give(meanwhile);
    }
    let (vertices, triangles) =
        (vertex..parts.positions.len() as u32, triangle..parts.indices.len() as u32);
    scene.geometries.push(Geometry {
        name: name.to_owned(),
        vertices,
        triangles,
        ..Geometry::default()
    });
    Ok(scene.geometries.len() as u32 - 1)
}

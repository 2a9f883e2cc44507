//! Puts triangles of a scene behind those that are there, as a geometry with vertices of its own.

#[cfg(feature = "json")]
use super::Solids;
use super::{Geometry, InstancedScene};
use crate::Scene;
use std::collections::HashMap;
use std::ops::Range;

impl InstancedScene {
    /// Adds materials and textures of a scene; gives the numbers that the first of each has now.
    #[cfg(feature = "json")]
    pub(crate) fn add_materials(&mut self, from: &Scene) -> u32 {
        let (material, texture) =
            (self.parts.materials.len() as u32, self.parts.textures.len() as u32);
        self.parts.textures.extend_from_slice(&from.textures);
        self.parts.materials.extend(from.materials.iter().cloned().map(|mut own| {
            own.texture = own.texture.map(|named| named + texture);
            own
        }));
        material
    }

    /// Adds a geometry: runs of triangles of a scene whose materials begin at `first_material`. Unused vertices stay out.
    pub(crate) fn add_geometry(
        &mut self,
        name: &str,
        from: &Scene,
        runs: &[Range<u32>],
        first_material: u32,
    ) -> u32 {
        let parts = &mut self.parts;
        let (vertex, triangle) = (parts.positions.len() as u32, parts.indices.len() as u32);
        let triangles = || runs.iter().cloned().flatten().map(|triangle| triangle as usize);
        let corners = runs.iter().map(|run| run.len()).sum::<usize>().saturating_mul(3);
        copy(
            (&from.positions, &from.indices),
            (triangles(), corners),
            (&mut parts.positions, &mut parts.indices),
        );
        let material = |triangle: usize| from.material_of[triangle] + first_material;
        parts.material_of.extend(triangles().map(material));
        if !from.normal_indices.is_empty() {
            parts.normal_indices.resize(triangle as usize, [Scene::NONE; 3]);
            let to = (&mut parts.normals, &mut parts.normal_indices);
            copy((&from.normals, &from.normal_indices), (triangles(), corners), to);
        }
        if !from.texcoord_indices.is_empty() {
            parts.texcoord_indices.resize(triangle as usize, [Scene::NONE; 3]);
            let to = (&mut parts.texcoords, &mut parts.texcoord_indices);
            copy((&from.texcoords, &from.texcoord_indices), (triangles(), corners), to);
        }
        self.geometries.push(Geometry {
            name: name.to_owned(),
            vertices: vertex..self.parts.positions.len() as u32,
            triangles: triangle..self.parts.indices.len() as u32,
            solids: None,
            opacity: None,
        });
        self.geometries.len() as u32 - 1
    }

    /// Adds a geometry of spheres or capsules.
    #[cfg(feature = "json")]
    pub(crate) fn add_solids(&mut self, name: &str, solids: Solids) -> u32 {
        let (vertex, triangle) =
            (self.parts.positions.len() as u32, self.parts.indices.len() as u32);
        self.geometries.push(Geometry {
            name: name.to_owned(),
            vertices: vertex..vertex,
            triangles: triangle..triangle,
            solids: Some(solids),
            opacity: None,
        });
        self.geometries.len() as u32 - 1
    }

    /// Gives all triangles of a geometry a material.
    #[cfg(feature = "json")]
    pub(crate) fn paint_geometry(&mut self, geometry: u32, material: u32) {
        let triangles = self.geometries[geometry as usize].triangles.clone();
        self.parts.material_of[triangles.start as usize..triangles.end as usize].fill(material);
    }

    /// Brings lists by triangle to one entry for each.
    pub(crate) fn finish_parts(&mut self) {
        let triangles = self.parts.indices.len();
        let Scene { normal_indices, texcoord_indices, .. } = &mut self.parts;
        for corners in [normal_indices, texcoord_indices] {
            if !corners.is_empty() {
                corners.resize(triangles, [Scene::NONE; 3]);
            }
        }
    }
}

/// Copies what triangles with so many corners name, each value once, in the order in which they name them.
fn copy<T: Copy>(
    (values, corners): (&[T], &[[u32; 3]]),
    (triangles, count): (impl Iterator<Item = usize>, usize),
    (to_values, to_corners): (&mut Vec<T>, &mut Vec<[u32; 3]>),
) {
    let mut places: HashMap<u32, u32> = HashMap::with_capacity(count.min(values.len()));
    for triangle in triangles {
        to_corners.push(corners[triangle].map(|named| {
            let Some(value) = values.get(named as usize) else { return Scene::NONE };
            *places.entry(named).or_insert_with(|| {
                to_values.push(*value);
                to_values.len() as u32 - 1
            })
        }));
    }
}

/// Copies what a run of triangles names behind what is there, each value once and mapped. Nothing where no triangle names a value.
#[cfg(feature = "json")]
pub(super) fn copied<T: Copy>(
    values: &mut Vec<T>,
    corners: &mut Vec<[u32; 3]>,
    triangles: Range<usize>,
    map: impl Fn(T) -> T,
) {
    if corners.is_empty() {
        return;
    }
    let (mut own, mut named) = (Vec::new(), Vec::new());
    // At once, so that no list is there twice.
    own.reserve_exact(triangles.len() * 3);
    named.reserve_exact(triangles.len());
    let count = triangles.len().saturating_mul(3);
    copy((values, corners), (triangles, count), (&mut own, &mut named));
    let shift = values.len() as u32;
    values.extend(own.into_iter().map(map));
    let moved = |named: u32| if named == Scene::NONE { named } else { named + shift };
    corners.extend(named.into_iter().map(|three| three.map(moved)));
}

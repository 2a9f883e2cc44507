//! All instances of a scene as one mesh.

use super::InstancedScene;
use crate::mesh_file::{MeshFileProblem, room};
use crate::{Scene, normals};
use glam::{DMat3, DVec3};
use splitplane_core::mesh::MAX_TRIANGLES;
use splitplane_float_state::Standard;

impl InstancedScene {
    /// The triangles of all instances, one after the other, in the world, in at most `limit` bytes. Places are computed in `f64` and
    /// rounded once; where an instance is reflected, the corners of its triangles run the other way around. Spheres, capsules and opacity masks are left out.
    ///
    /// # Errors
    /// They have more triangles than one tree can hold, or take more bytes.
    pub fn flatten(mut self, limit: u64) -> Result<Scene, MeshFileProblem> {
        let _state = Standard::set();
        let [triangles, vertices] = self.counts();
        if triangles > MAX_TRIANGLES as u64 {
            let (what, most) = ("triangles in all instances together", MAX_TRIANGLES as u64);
            return Err(MeshFileProblem::TooMany { what, most });
        }
        // Positions, normals and texture coordinates of a vertex, and what a triangle names.
        let bytes = triangles * (3 * 12 + 4) + vertices * (12 + 12 + 8);
        if bytes > limit || vertices > u64::from(u32::MAX) {
            let what = "bytes in all instances together";
            return Err(MeshFileProblem::TooMany { what, most: limit });
        }
        let from = std::mem::take(&mut self.parts);
        let mut to = Scene { name: self.name.clone(), ..Scene::default() };
        (to.camera, to.notes) = (from.camera, from.notes.clone());
        let (triangles, vertices) = (triangles as usize, vertices as usize);
        room(&mut to.positions, vertices)?;
        room(&mut to.indices, triangles)?;
        room(&mut to.material_of, triangles)?;
        let has = |corners: &[[u32; 3]]| !corners.is_empty();
        for (instance, geometry) in self.placed() {
            let placed = &self.instances[instance];
            let [x, y, z] = placed.transform.map(|row| row.map(f64::from));
            let matrix = DMat3::from_cols_array_2d(&std::array::from_fn(|k| [x[k], y[k], z[k]]));
            let origin = DVec3::new(x[3], y[3], z[3]);
            let own = &self.geometries[geometry];
            let shift = to.positions.len() as u32;
            let range = own.vertices.start as usize..own.vertices.end as usize;
            to.positions.extend(from.positions[range].iter().map(|point| {
                (matrix * DVec3::from_array(point.map(f64::from)) + origin).as_vec3().to_array()
            }));
            let first = own.vertices.start;
            let range = own.triangles.start as usize..own.triangles.end as usize;
            let is_turned = matrix.determinant() < 0.0;
            let turned = |[a, b, c]: [u32; 3]| if is_turned { [a, c, b] } else { [a, b, c] };
            let moved = |corner: u32| corner - first + shift;
            let corners = from.indices[range.clone()].iter();
            to.indices.extend(corners.map(|corners| turned(*corners).map(moved)));
            let materials = &from.material_of[range.clone()];
            let named = |own: &u32| placed.material.unwrap_or(*own);
            to.material_of.extend(materials.iter().map(named));
            let before = to.indices.len() - range.len();
            if has(&from.normal_indices) {
                // Directions across surfaces go by the inverse transposed.
                let across = matrix.inverse().transpose();
                let map = |normal: &[f32; 3]| {
                    let turned = across * DVec3::from_array(normal.map(f64::from));
                    normals::unit(turned.to_array())
                };
                let lists = (&from.normals[..], &from.normal_indices[range.clone()]);
                to.normal_indices.resize(before, [Scene::NONE; 3]);
                add(lists, (&mut to.normals, &mut to.normal_indices), map, turned)?;
            }
            if has(&from.texcoord_indices) {
                let lists = (&from.texcoords[..], &from.texcoord_indices[range]);
                to.texcoord_indices.resize(before, [Scene::NONE; 3]);
                add(lists, (&mut to.texcoords, &mut to.texcoord_indices), |own| *own, turned)?;
            }
        }
        (to.materials, to.textures, to.lights) = (from.materials, from.textures, from.lights);
        Ok(to)
    }

    /// Instances with their geometries, where those exist.
    fn placed(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let all = self.instances.iter().enumerate();
        let all = all.map(|(instance, placed)| (instance, placed.geometry as usize));
        all.filter(|(_, geometry)| *geometry < self.geometries.len())
    }

    /// Triangles and vertices of all instances together.
    fn counts(&self) -> [u64; 2] {
        self.placed().fold([0, 0], |[triangles, vertices], (_, geometry)| {
            let own = &self.geometries[geometry];
            [triangles + own.triangles.len() as u64, vertices + own.vertices.len() as u64]
        })
    }
}

/// Adds what triangles of an instance name. A geometry names a run of values of its own, in the order of their numbers.
fn add<T: Copy>(
    (values, corners): (&[T], &[[u32; 3]]),
    (to_values, to_corners): (&mut Vec<T>, &mut Vec<[u32; 3]>),
    map: impl Fn(&T) -> T,
    turned: impl Fn([u32; 3]) -> [u32; 3],
) -> Result<(), MeshFileProblem> {
    let named = || corners.as_flattened().iter().copied().filter(|named| *named != Scene::NONE);
    let (Some(first), Some(last)) = (named().min(), named().max()) else {
        to_corners.extend(corners.iter().copied().map(turned));
        return Ok(());
    };
    let shift = to_values.len() as u32;
    room(to_values, (last - first) as usize + 1)?;
    to_values.extend(values[first as usize..=last as usize].iter().map(map));
    let moved = |corner: u32| if corner == Scene::NONE { corner } else { corner - first + shift };
    room(to_corners, corners.len())?;
    to_corners.extend(corners.iter().map(|corners| turned(*corners).map(moved)));
    Ok(())
}

//! Chosen instances as one mesh: for what stands still beside what moves.

mod table;

use alloc::vec::Vec;
use thiserror::Error;

use super::description::{Instance, Scene, reserve};
use super::error::SceneError;
use super::hit::InstanceId;
use super::transform::{IDENTITY, in_f64};
use crate::mesh::{MAX_TRIANGLES, Mesh};

pub use table::BakedTable;
use table::Part;

/// Why instances were not baked. The description is what it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BakeError {
    /// There is no such instance, or no memory.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An instance was chosen twice.
    #[error("instance {instance} was chosen twice")]
    Twice {
        /// The instance.
        instance: u32,
    },
    /// An instance of shapes, which are no triangles.
    #[error("instance {instance} is of shapes, which cannot be baked into a mesh")]
    Shapes {
        /// The instance.
        instance: u32,
    },
    /// An instance of a geometry with an opacity mask, which the new mesh has not.
    #[error("the geometry of instance {instance} has an opacity mask, which cannot be baked")]
    Opacity {
        /// The instance.
        instance: u32,
    },
    /// An instance with another mask, number or culling than the first of its group.
    #[error(
        "instance {instance} has another {what} than instance {first}; put it into another group"
    )]
    Differs {
        /// The instance.
        instance: u32,
        /// The first of its group.
        first: u32,
        /// What differs.
        what: &'static str,
    },
    /// A corner that is beyond the greatest `f32` in the world.
    #[error("triangle {triangle} of instance {instance} reaches beyond the greatest number")]
    TooFar {
        /// The instance.
        instance: u32,
        /// The triangle.
        triangle: u32,
    },
    /// The new meshes and the table would hold more memory than allowed.
    #[error("the baked meshes take {needed} bytes, more than the limit of {limit}")]
    OutOfMemory {
        /// Bytes that they take.
        needed: u64,
        /// The limit.
        limit: u64,
    },
    /// More triangles or vertices than one mesh can have.
    #[error(
        "with instance {instance} a group has more than {MAX_TRIANGLES} triangles or 2^32 vertices"
    )]
    TooMany {
        /// The instance with which there are too many.
        instance: u32,
    },
}

impl Scene {
    /// Bakes instances of meshes: each group of them becomes one mesh in the world, which is a geometry of its own with one instance that leaves it in place. So
    /// rays pass one tree, not one for each instance, which is faster where instances overlap; it takes the memory of all their triangles.
    ///
    /// The new description shares the arrays of all other geometries with this one. The instance of a group has the name of the group's least; the others' names
    /// are free, and geometries that lost their last instance are too. The table says what the group's triangles were. Groups without instances
    /// are passed over.
    ///
    /// Corners are computed in `f64` and rounded to `f32` once. Roundings may take a triangle's area, so that no ray hits it; and they may give an area to one that had none in its object,
    /// whose corners were on one line there: rays can hit that one afterwards, and could not before. Sides stay, also of mirrored instances: they are
    /// those of the triangle in the world, as [`Culling`](crate::ray::Culling) of an instance sees them. At equal `t` the least (instance, triangle) wins, so within a group the same triangle as
    /// before; against other instances the group counts as its least. Surfaces that coincide in several instances belong into one group: a corner that is rounded may lie before one that is not.
    ///
    /// It takes as much memory as it needs: [`Scene::bake_within`] has a limit.
    ///
    /// # Errors
    /// See [`BakeError`].
    ///
    /// ```
    /// use splitplane_core::mesh::Mesh;
    /// use splitplane_core::scene::{Instance, InstanceId, Scene, translation};
    ///
    /// let triangle = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    /// let mut scene = Scene::new();
    /// let geometry = scene.add_mesh(&Mesh::soup(&triangle).unwrap()).unwrap();
    /// let place = |x| Instance::new(geometry, translation([x, 0.0, 0.0]));
    /// let names = [0.0, 2.0, 4.0].map(|x| scene.add_instance(place(x)).unwrap());
    /// let (baked, table) = scene.bake(&[&names[1..]]).unwrap();
    /// assert_eq!(baked.len(), 2);
    /// // The second triangle of the group was the only one of the last instance.
    /// assert_eq!(table.original(names[1], 1), Some((names[2], geometry, 0)));
    /// assert_eq!(table.original(names[0], 0), None);
    /// ```
    pub fn bake(&self, groups: &[&[InstanceId]]) -> Result<(Scene, BakedTable), BakeError> {
        self.bake_within(groups, u64::MAX)
    }

    /// As [`Scene::bake`], within a limit of memory: a few small meshes with very many instances become large ones, which are refused before anything is taken for them.
    ///
    /// # Errors
    /// As there, and [`BakeError::OutOfMemory`] where [`Scene::baked_bytes`] is more than `max_bytes`.
    pub fn bake_within(
        &self,
        groups: &[&[InstanceId]],
        max_bytes: u64,
    ) -> Result<(Scene, BakedTable), BakeError> {
        let mut chosen: Vec<InstanceId> = Vec::new();
        for group in groups {
            reserve(&mut chosen, group.len())?;
            chosen.extend_from_slice(group);
        }
        chosen.sort_unstable();
        if let Some(twice) = chosen.windows(2).find(|two| two[0] == two[1]) {
            return Err(BakeError::Twice { instance: twice[0].0 });
        }
        let needed = self.baked_bytes(groups)?;
        if needed > max_bytes {
            return Err(BakeError::OutOfMemory { needed, limit: max_bytes });
        }
        let (mut scene, mut table) = (self.shared_copy()?, BakedTable::default());
        for group in groups {
            let mut names: Vec<InstanceId> = Vec::new();
            reserve(&mut names, group.len())?;
            names.extend_from_slice(group);
            // Ties within the group are decided as before.
            names.sort_unstable();
            let Some(&first) = names.first() else { continue };
            let (mesh, parts) = self.bake_group(&names)?;
            let (geometry, triangles) = (mesh.positions, mesh.indices.len() as u32);
            let geometry = scene.add_arrays(geometry, mesh.indices)?;
            let becomes = Instance { geometry, transform: IDENTITY, ..*self.instance(first)? };
            scene.set_instance(first, becomes)?;
            for name in &names[1..] {
                scene.remove_instance(*name)?;
            }
            table.add(first, (geometry, triangles), parts)?;
        }
        for name in chosen {
            let geometry = self.instance(name)?.geometry;
            // Else it has other instances, or is gone already. To let it be refused would take as many steps as there are instances, for each of these.
            if scene.is_unused(geometry) {
                scene.remove_geometry(geometry)?;
            }
        }
        table.sort()?;
        Ok((scene, table))
    }

    /// Bytes of the new meshes and of the table that [`Scene::bake`] makes of these groups, without lists of the whole scene. Nothing is baked, so an error of what
    /// instances are is not found.
    ///
    /// # Errors
    /// [`BakeError::Scene`] for an unknown instance, [`BakeError::TooMany`].
    pub fn baked_bytes(&self, groups: &[&[InstanceId]]) -> Result<u64, BakeError> {
        let mut bytes = 0;
        for group in groups {
            let mut size = BakedSize::default();
            for name in *group {
                let mesh = self.geometry(self.instance(*name)?.geometry)?;
                size = size.and(*name, &mesh.mesh())?;
            }
            if !group.is_empty() {
                bytes += size.bytes() + table::bytes_of_group(group.len());
            }
        }
        Ok(bytes)
    }

    /// The triangles of these instances in the world, one instance after the other, and where each begins.
    fn bake_group(&self, names: &[InstanceId]) -> Result<(BakedMesh, Vec<Part>), BakeError> {
        let (mut mesh, mut parts) = (BakedMesh::default(), Vec::new());
        reserve(&mut parts, names.len())?;
        // In one piece, so that lists do not grow beside their old ones.
        let mut size = BakedSize::default();
        for &name in names {
            let geometry = self.geometry(self.instance(name)?.geometry)?;
            size = size.and(name, &geometry.mesh())?;
        }
        reserve_exact(&mut mesh.positions, size.vertices)?;
        reserve_exact(&mut mesh.indices, size.triangles)?;
        let first = names.first().map(|name| self.instance(*name)).transpose()?;
        for &name in names {
            let (own, instance) = (self.instance(name)?, name.0);
            let geometry = self.geometry(own.geometry)?;
            if geometry.shapes().is_some() {
                return Err(BakeError::Shapes { instance });
            }
            if self.opacity(own.geometry)?.is_some() {
                return Err(BakeError::Opacity { instance });
            }
            let same = first.into_iter().flat_map(|first| {
                [
                    ("mask", first.mask == own.mask),
                    ("number", first.id == own.id),
                    ("culling", first.culling == own.culling),
                ]
            });
            if let Some((what, _)) = same.into_iter().find(|(_, same)| !same) {
                let first = names.first().map_or(instance, |name| name.0);
                return Err(BakeError::Differs { instance, first, what });
            }
            parts.push(Part {
                first_triangle: mesh.indices.len() as u32,
                instance: name,
                geometry: own.geometry,
            });
            mesh.add(name, own, &geometry.mesh())?;
        }
        Ok((mesh, parts))
    }
}

/// How large the mesh of a group is.
#[derive(Clone, Copy, Default)]
struct BakedSize {
    vertices: usize,
    triangles: usize,
}

impl BakedSize {
    /// With one instance more, of this mesh.
    fn and(self, name: InstanceId, mesh: &Mesh<'_>) -> Result<BakedSize, BakeError> {
        // Either is less than 2^32, so that only a sum on a machine of 32 bits may wrap.
        let vertices = self.vertices.saturating_add(mesh.arrays().0.len());
        let triangles = self.triangles.saturating_add(mesh.len());
        if triangles > MAX_TRIANGLES || vertices > u32::MAX as usize {
            return Err(BakeError::TooMany { instance: name.0 });
        }
        Ok(BakedSize { vertices, triangles })
    }

    fn bytes(self) -> u64 {
        (self.vertices as u64) * size_of::<[f32; 3]>() as u64
            + (self.triangles as u64) * size_of::<[u32; 3]>() as u64
    }
}

fn reserve_exact<T>(list: &mut Vec<T>, more: usize) -> Result<(), SceneError> {
    let bytes = more.saturating_mul(size_of::<T>()) as u64;
    list.try_reserve_exact(more).map_err(|_| SceneError::OutOfMemory { bytes })
}

/// The mesh of a group.
#[derive(Default)]
struct BakedMesh {
    positions: Vec<[f32; 3]>,
    indices: Vec<[u32; 3]>,
}

impl BakedMesh {
    /// Adds an instance, for which there is room.
    fn add(&mut self, name: InstanceId, own: &Instance, mesh: &Mesh<'_>) -> Result<(), BakeError> {
        let (positions, _) = mesh.arrays();
        let shift = self.positions.len() as u32;
        let rows = in_f64(&own.transform);
        self.positions.extend(positions.iter().map(|point| {
            let [x, y, z] = point.map(f64::from);
            rows.map(|[a, b, c, d]| (((a * x + b * y) + c * z) + d) as f32)
        }));
        for triangle in 0..mesh.len() {
            let corners = match mesh.arrays().1 {
                Some(indices) => indices[triangle],
                None => [0, 1, 2].map(|corner| (3 * triangle + corner) as u32),
            };
            let is_finite = |positions: &[[f32; 3]], corner: u32| {
                positions[corner as usize].iter().all(|x| x.is_finite())
            };
            let moved = corners.map(|corner| corner + shift);
            // What was not finite before is no triangle, here or there.
            let beyond = (0..3).any(|corner| {
                is_finite(positions, corners[corner]) && !is_finite(&self.positions, moved[corner])
            });
            if beyond {
                return Err(BakeError::TooFar { instance: name.0, triangle: triangle as u32 });
            }
            self.indices.push(moved);
        }
        Ok(())
    }
}

//! What baked triangles were before.

use alloc::vec::Vec;

use super::reserve;
use crate::scene::error::SceneError;
use crate::scene::hit::{GeometryId, InstanceId, SceneHit};

/// An instance of a group: its triangles lie one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Part {
    pub(super) first_triangle: u32,
    pub(super) instance: InstanceId,
    pub(super) geometry: GeometryId,
}

/// A group: where its parts are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Group {
    instance: InstanceId,
    geometry: GeometryId,
    /// Triangles of the geometry.
    triangles: u32,
    first_part: usize,
    parts: usize,
}

/// Bytes that a group of so many instances takes in the table.
pub(super) fn bytes_of_group(instances: usize) -> u64 {
    let group = size_of::<Group>() + size_of::<(GeometryId, u32)>();
    (group + instances * size_of::<Part>()) as u64
}

/// Tells of triangles of a scene that [`Scene::bake`](crate::scene::Scene::bake) made what they were in the scene before. It takes 12 bytes for each baked instance and 40 for each group, and
/// looks up in the logarithm of their number. It tells nothing of edits made since.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BakedTable {
    /// By name of the instance.
    groups: Vec<Group>,
    /// Places among the groups, by name of the geometry.
    by_geometry: Vec<(GeometryId, u32)>,
    /// Group by group, in the order in which they were added.
    parts: Vec<Part>,
}

impl BakedTable {
    pub(super) fn add(
        &mut self,
        instance: InstanceId,
        (geometry, triangles): (GeometryId, u32),
        parts: Vec<Part>,
    ) -> Result<(), SceneError> {
        reserve(&mut self.groups, 1)?;
        reserve(&mut self.parts, parts.len())?;
        let (first_part, parts_of) = (self.parts.len(), parts.len());
        self.groups.push(Group { instance, geometry, triangles, first_part, parts: parts_of });
        self.parts.extend(parts);
        Ok(())
    }

    /// Makes groups be found, once all are there.
    pub(super) fn sort(&mut self) -> Result<(), SceneError> {
        self.groups.sort_unstable_by_key(|group| group.instance);
        reserve(&mut self.by_geometry, self.groups.len())?;
        self.by_geometry.extend(self.groups.iter().zip(0..).map(|(own, at)| (own.geometry, at)));
        self.by_geometry.sort_unstable();
        Ok(())
    }

    /// The instance of each group in the baked scene and its geometry, in the order of their names.
    pub fn groups(&self) -> impl Iterator<Item = (InstanceId, GeometryId)> + '_ {
        self.groups.iter().map(|group| (group.instance, group.geometry))
    }

    /// What a triangle of a group was; `None` where the group has no such triangle.
    fn original_of(&self, group: &Group, triangle: u32) -> Option<(InstanceId, GeometryId, u32)> {
        let Group { first_part, parts, triangles, .. } = *group;
        if triangle >= triangles {
            return None;
        }
        let parts = &self.parts[first_part..first_part + parts];
        // Of parts without triangles the last that begins here has it.
        let after = parts.partition_point(|part| part.first_triangle <= triangle);
        let part = parts.get(after.checked_sub(1)?)?;
        Some((part.instance, part.geometry, triangle - part.first_triangle))
    }

    /// What a triangle of a group's instance was: instance, geometry, and triangle. `None` for instances that are not baked, which are what they were, and for triangles that
    /// the group does not have.
    pub fn original(
        &self,
        instance: InstanceId,
        triangle: u32,
    ) -> Option<(InstanceId, GeometryId, u32)> {
        let place = self.groups.binary_search_by_key(&instance, |group| group.instance).ok()?;
        self.original_of(&self.groups[place], triangle)
    }

    /// What a triangle of a group's geometry was, as [`BakedTable::original`] says it of the group's own instance. So groups may have instances beside that: bake a house of its parts,
    /// place it a hundred times ([`BakedTable::groups`] names its geometry), and ask by the hit's geometry which part of the house was met, and by its instance which house. What is baked again asks one table after the other.
    ///
    /// ```
    /// use splitplane_core::mesh::Mesh;
    /// use splitplane_core::scene::{Instance, InstanceId, Scene, translation};
    ///
    /// let triangle = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    /// let mut parts = Scene::new();
    /// let part = parts.add_mesh(&Mesh::soup(&triangle).unwrap()).unwrap();
    /// let names = [0.0, 2.0].map(|x| {
    ///     parts.add_instance(Instance::new(part, translation([x, 0.0, 0.0]))).unwrap()
    /// });
    /// let (mut street, table) = parts.bake(&[&names]).unwrap();
    /// let (_, house) = table.groups().next().unwrap();
    /// let second = street.add_instance(Instance::new(house, translation([8.0, 0.0, 0.0]))).unwrap();
    /// // A hit of triangle 1 of the second house.
    /// assert_eq!(street.instance(second).unwrap().geometry, house);
    /// assert_eq!(table.original_part(house, 1), Some((names[1], part, 0)));
    /// ```
    pub fn original_part(
        &self,
        geometry: GeometryId,
        triangle: u32,
    ) -> Option<(InstanceId, GeometryId, u32)> {
        let at = self.by_geometry.binary_search_by_key(&geometry, |(named, _)| *named).ok()?;
        self.original_of(&self.groups[self.by_geometry[at].1 as usize], triangle)
    }

    /// A hit in the baked scene as one in the scene before; `t`, `u` and `v` stay. Misses, and hits of what is not baked, are themselves.
    pub fn original_hit(&self, hit: &SceneHit) -> SceneHit {
        match self.original(InstanceId(hit.instance), hit.triangle) {
            Some((instance, geometry, triangle)) => {
                SceneHit { instance: instance.0, geometry: geometry.0, triangle, ..*hit }
            }
            None => *hit,
        }
    }

    /// Bytes of the table.
    pub fn bytes(&self) -> u64 {
        let groups = self.groups.capacity() * size_of::<Group>();
        let by_geometry = self.by_geometry.capacity() * size_of::<(GeometryId, u32)>();
        (groups + by_geometry + self.parts.capacity() * size_of::<Part>()) as u64
    }
}

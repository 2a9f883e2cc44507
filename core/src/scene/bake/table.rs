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
    (size_of::<Group>() + instances * size_of::<Part>()) as u64
}

/// Tells of triangles of a scene that [`Scene::bake`](crate::scene::Scene::bake) made what they were in the scene before. It takes 12 bytes for each baked instance and 32 for each group, and
/// looks up in the logarithm of their number. It tells nothing of edits made since.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BakedTable {
    /// By name of the instance.
    groups: Vec<Group>,
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
        let group = Group { instance, geometry, triangles, first_part, parts: parts_of };
        let place = self.groups.partition_point(|own| own.instance < instance);
        self.groups.insert(place, group);
        self.parts.extend(parts);
        Ok(())
    }

    /// The instance of each group in the baked scene and its geometry, in the order of their names.
    pub fn groups(&self) -> impl Iterator<Item = (InstanceId, GeometryId)> + '_ {
        self.groups.iter().map(|group| (group.instance, group.geometry))
    }

    /// The part that a triangle is of; `None` where the instance is not baked, or has no such triangle.
    fn part(&self, instance: InstanceId, triangle: u32) -> Option<&Part> {
        let place = self.groups.binary_search_by_key(&instance, |group| group.instance).ok()?;
        let Group { first_part, parts, triangles, .. } = self.groups[place];
        if triangle >= triangles {
            return None;
        }
        let parts = &self.parts[first_part..first_part + parts];
        // Of parts without triangles the last that begins here has it.
        let after = parts.partition_point(|part| part.first_triangle <= triangle);
        parts.get(after.checked_sub(1)?)
    }

    /// What a triangle of a group's instance was: instance, geometry, and triangle. `None` for instances that are not baked, which are what they were, and for triangles that
    /// the group does not have.
    pub fn original(
        &self,
        instance: InstanceId,
        triangle: u32,
    ) -> Option<(InstanceId, GeometryId, u32)> {
        let part = self.part(instance, triangle)?;
        Some((part.instance, part.geometry, triangle - part.first_triangle))
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
        (groups + self.parts.capacity() * size_of::<Part>()) as u64
    }
}

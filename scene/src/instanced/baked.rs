//! What instances that a scene file bakes have become.

use splitplane_render::layout::FirstHit;
use std::borrow::Cow;

use splitplane_core::scene::{BakedTable, GeometryId, InstanceId, Scene, SceneError};

/// Groups of instances that are baked: see [`Scene::bake`]. Each group is a geometry of its own, in the world, and its instance has the place of the
/// group's least.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Baked {
    /// What triangles of the groups were in the file: hits become hits of the file by [`BakedTable::original_hit`].
    pub table: BakedTable,
    /// The other instances of the groups, by their places among all, ascending; of a .scene file, names that are free there. They are of a geometry without triangles here, and descriptions lack them.
    pub instances: Vec<u32>,
    /// Geometries of which no instance is left, and those whose names are free in a .scene file, by their places among all, ascending. Descriptions lack them.
    pub geometries: Vec<u32>,
}

impl Baked {
    /// Whether nothing is baked.
    pub fn is_empty(&self) -> bool {
        self.table.groups().next().is_none()
    }

    /// First hits of a picture with the names that triangles and instances have in the file.
    pub fn original_hits<'a>(&self, hits: &'a [FirstHit]) -> Cow<'a, [FirstHit]> {
        if self.is_empty() {
            return Cow::Borrowed(hits);
        }
        let of = |hit: &FirstHit| {
            let named = self.table.original(InstanceId(hit.instance), hit.triangle);
            match named.filter(|_| hit.triangle != u32::MAX) {
                Some((instance, _, triangle)) => {
                    FirstHit { instance: instance.0, triangle, ..*hit }
                }
                None => *hit,
            }
        };
        hits.iter().map(of).collect()
    }

    /// Removes from a description what baking replaced.
    pub(super) fn remove_from(&self, scene: &mut Scene) -> Result<(), SceneError> {
        for &instance in &self.instances {
            scene.remove_instance(InstanceId(instance))?;
        }
        for &geometry in &self.geometries {
            scene.remove_geometry(GeometryId(geometry))?;
        }
        Ok(())
    }
}

//! Geometries that get the same arrays in one update: one of them is built, and all have its tree.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::lists::push;
use super::needed::address;
use crate::scene::{GeometryId, GeometryMesh, SceneBuildError};

/// The geometries that may have the arrays of another one of the same update.
pub(super) struct Repeats {
    /// By the address of their arrays, then by name.
    shared: Vec<(usize, GeometryId)>,
}

impl Repeats {
    /// Of geometries that an update builds. Arrays that nobody else holds are no other geometry's, so mostly this takes no memory.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn of<'a>(
        geometries: impl Iterator<Item = (GeometryId, &'a Arc<GeometryMesh>)>,
    ) -> Result<Repeats, SceneBuildError> {
        let mut shared = Vec::new();
        for (name, mesh) in geometries {
            if Arc::strong_count(mesh) > 1 && mesh.shapes().is_none() {
                push(&mut shared, (address(mesh), name))?;
            }
        }
        shared.sort_unstable();
        Ok(Repeats { shared })
    }

    /// The first geometry that has these arrays, where several have.
    pub(super) fn first_of(&self, mesh: &Arc<GeometryMesh>) -> Option<GeometryId> {
        let own = address(mesh);
        let first = self.shared.partition_point(|&(address, _)| address < own);
        let [(one, name), (next, _)] = self.shared.get(first..first + 2)? else { return None };
        (*one == own && *next == own).then_some(*name)
    }
}

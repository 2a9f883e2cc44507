//! The meshes that an update needs trees of, each once, however many geometries have it.

use alloc::sync::Arc;
use alloc::vec::Vec;

use super::lists::push;
use super::shared::SharedGeometry;
use crate::scene::{GeometryId, GeometryMesh, SceneBuildError};

/// Meshes in the order in which they are built, with the trees that are there. A mesh is found in the logarithm of their number, and all sums are kept as they
/// change: many small meshes take no more than a few steps each.
#[derive(Default)]
pub(super) struct NeededTrees {
    meshes: Vec<Needed>,
    /// Where each mesh is, by the address of its arrays.
    places: Vec<(usize, usize)>,
    /// All before have a tree.
    next: usize,
    left: usize,
    bytes: u64,
}

/// A mesh that needs a tree.
struct Needed {
    /// The first geometry that has it.
    name: GeometryId,
    mesh: Arc<GeometryMesh>,
    tree: Option<SharedGeometry>,
}

/// The arrays as a number. They are held, so that nothing new can have the same.
pub(super) fn address(mesh: &Arc<GeometryMesh>) -> usize {
    Arc::as_ptr(mesh).addr()
}

impl NeededTrees {
    /// Those of geometries in ascending order of their names, no two of which have the same arrays; trees that are there already come from `before`.
    ///
    /// # Errors
    /// No memory.
    pub(super) fn of<'a>(
        geometries: impl Iterator<Item = (GeometryId, &'a Arc<GeometryMesh>)>,
        before: &NeededTrees,
    ) -> Result<NeededTrees, SceneBuildError> {
        let mut own = NeededTrees::default();
        for (name, mesh) in geometries {
            let tree = before.tree_of(mesh).cloned();
            own.left += usize::from(tree.is_none());
            own.bytes += tree.as_ref().map_or(0, SharedGeometry::bytes);
            push(&mut own.places, (address(mesh), own.meshes.len()))?;
            push(&mut own.meshes, Needed { name, mesh: Arc::clone(mesh), tree })?;
        }
        own.places.sort_unstable();
        own.pass_built();
        Ok(own)
    }

    /// Where the mesh of these arrays is, among [`NeededTrees::len`].
    fn place_of(&self, mesh: &Arc<GeometryMesh>) -> Option<usize> {
        let own = address(mesh);
        let place = self.places.binary_search_by_key(&own, |&(address, _)| address).ok()?;
        Some(self.places[place].1)
    }

    fn pass_built(&mut self) {
        while self.meshes.get(self.next).is_some_and(|own| own.tree.is_some()) {
            self.next += 1;
        }
    }

    /// The tree over these arrays, where there is one.
    pub(super) fn tree_of(&self, mesh: &Arc<GeometryMesh>) -> Option<&SharedGeometry> {
        self.meshes[self.place_of(mesh)?].tree.as_ref()
    }

    /// Meshes of all geometries.
    pub(super) fn len(&self) -> usize {
        self.meshes.len()
    }

    /// How many have no tree.
    pub(super) fn left(&self) -> usize {
        self.left
    }

    /// Bytes of all trees.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The first without a tree.
    pub(super) fn next(&self) -> Option<(GeometryId, &Arc<GeometryMesh>)> {
        let own = self.meshes.get(self.next)?;
        Some((own.name, &own.mesh))
    }

    /// The first geometry that waits for a tree over these arrays.
    pub(super) fn waits_for(&self, mesh: &Arc<GeometryMesh>) -> Option<GeometryId> {
        let own = &self.meshes[self.place_of(mesh)?];
        own.tree.is_none().then_some(own.name)
    }

    /// Keeps the tree over the arrays that it was made for, where these wait for one.
    pub(super) fn give(&mut self, tree: SharedGeometry) {
        let Some(place) = self.place_of(tree.mesh()) else { return };
        let own = &mut self.meshes[place];
        if own.tree.is_none() {
            self.bytes += tree.bytes();
            self.left -= 1;
            own.tree = Some(tree);
            self.pass_built();
        }
    }
}

//! Updates that use the memory of trees that are no longer needed.

use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::accelerator::SceneAccelerator;
use super::shared::{SharedGeometry, bytes_of};
use super::update::{UpdateReport, push, reserve};
use crate::backend::{Accelerator, Backend, BuildOptions};
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::scene::{GeometryId, GeometryMesh, Scene, SceneBuildError};

/// Brings a scene up to date as [`Backend::update_scene`] does, and keeps memory: for meshes whose vertices move every frame.
///
/// A tree that came from here and is replaced becomes the geometry's spare, and the next update builds into its memory ([`Backend::rebuild`], which with a
/// watch builds beside it on the CPU, and keeps nothing). So the first two updates of a mesh take new memory, and a failed update still
/// leaves the scene as it was, since no tree that rays go through is written. The price is a second tree for each mesh that changes: `max_spare_bytes` bounds
/// them, [`SceneUpdater::spare_bytes`] tells them, and [`SceneUpdater::clear`] drops them. [`Backend::update_scene`] keeps none.
///
/// Trees and hits are those of [`Backend::update_scene`]. A scene may be updated in both ways in turn.
///
/// ```
/// # use splitplane_core::backend::{Backend, BuildOptions};
/// # use splitplane_core::backend::scene::{SceneAccelerator, SceneUpdater};
/// # use splitplane_core::mesh::Mesh;
/// # use splitplane_core::scene::{GeometryId, Scene, SceneBuildError};
/// fn frames(
///     backend: &dyn Backend,
///     built: &mut Box<dyn SceneAccelerator>,
///     description: &mut Scene,
///     (flag, frames): (GeometryId, &[Mesh<'_>]),
/// ) -> Result<(), SceneBuildError> {
///     // Spares of 1 GiB at most.
///     let mut updater = SceneUpdater::new(1 << 30);
///     for mesh in frames {
///         description.replace_mesh(flag, mesh)?;
///         updater.update(backend, built, description, &BuildOptions::default())?;
///     }
///     Ok(())
/// }
/// ```
pub struct SceneUpdater {
    max_spare_bytes: u64,
    /// Shares of the trees that scenes got from here, by geometry.
    current: Vec<(GeometryId, SharedGeometry)>,
    spares: Vec<(GeometryId, Box<dyn Accelerator>)>,
    /// Empty between updates: their memory is kept.
    asked: Vec<(GeometryId, Arc<GeometryMesh>)>,
    made: Vec<(GeometryId, SharedGeometry)>,
}

impl SceneUpdater {
    /// One that has no spares yet, and never more than this.
    pub fn new(max_spare_bytes: u64) -> SceneUpdater {
        let (current, spares) = (Vec::new(), Vec::new());
        SceneUpdater { max_spare_bytes, current, spares, asked: Vec::new(), made: Vec::new() }
    }

    /// Bytes of all spares.
    pub fn spare_bytes(&self) -> u64 {
        self.spares.iter().map(|(_, tree)| bytes_of(&**tree)).sum()
    }

    /// Drops all spares, and its shares of trees that scenes have.
    pub fn clear(&mut self) {
        self.spares.clear();
        self.current.clear();
    }

    /// Brings a scene up to date with its description: see [`Backend::update_scene`]. Spares of meshes that do not change count towards the options' limit too.
    ///
    /// # Errors
    /// As there; the scene is then what it was.
    pub fn update(
        &mut self,
        backend: &dyn Backend,
        scene: &mut dyn SceneAccelerator,
        description: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        backend.check_shapes(description)?;
        self.asked.clear();
        for (name, mesh) in scene.scene().unbuilt(description) {
            push(&mut self.asked, (name, Arc::clone(mesh)))?;
        }
        // What cannot be kept later is asked for before anything changes.
        let more = self.asked.len();
        reserve(&mut self.made, more)?;
        reserve(&mut self.current, more)?;
        reserve(&mut self.spares, more)?;
        let asked = |name: &GeometryId| self.asked.iter().any(|(asked, _)| asked == name);
        let idle = self.spares.iter().filter(|(name, _)| !asked(name));
        let idle: u64 = idle.map(|(_, tree)| bytes_of(&**tree)).sum();
        let max_memory = options.max_memory.map(|limit| limit.saturating_sub(idle));
        let options = BuildOptions { max_memory, ..*options };

        let (spares, made) = (&mut self.spares, &mut self.made);
        let mut asked = self.asked.drain(..);
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| {
            // As many as are asked for, in this order.
            let missing = || BuildError::WrongMesh { reason: "it was not announced".into() };
            let (name, own) = asked.next().ok_or_else(missing)?;
            let spare = spares.iter_mut().position(|(spare, _)| *spare == name);
            let tree = match spare {
                Some(place) => {
                    // After an error it is still a spare.
                    backend.rebuild(&mut spares[place].1, mesh, options)?;
                    spares.swap_remove(place).1
                }
                None => backend.build(mesh, options)?,
            };
            let shared = SharedGeometry::new(own, tree);
            made.push((name, shared.clone()));
            let shared: Box<dyn Accelerator> = Box::new(shared);
            Ok(shared)
        };
        let updated = scene.update_by(description, &options, &mut build);
        drop(asked);
        while let Some((name, shared)) = self.made.pop() {
            let old = match &updated {
                Ok(_) => self.replace_current(name, shared),
                Err(_) => Some(shared),
            };
            // Who else has it keeps it.
            if let Some(tree) = old.and_then(SharedGeometry::into_tree) {
                self.keep(name, tree);
            }
        }
        if updated.as_ref().is_ok_and(|report| report.geometries_dropped > 0) {
            let is_there = |name: GeometryId| description.geometry(name).is_ok();
            self.current.retain(|(name, _)| is_there(*name));
            self.spares.retain(|(name, _)| is_there(*name));
        }
        updated
    }

    /// Notes the tree that the scene has now, and gives the one that it had.
    fn replace_current(
        &mut self,
        name: GeometryId,
        shared: SharedGeometry,
    ) -> Option<SharedGeometry> {
        match self.current.iter_mut().find(|(own, _)| *own == name) {
            Some((_, own)) => Some(core::mem::replace(own, shared)),
            None => {
                self.current.push((name, shared));
                None
            }
        }
    }

    /// Keeps a tree as the spare of a geometry, where there is room for it.
    fn keep(&mut self, name: GeometryId, tree: Box<dyn Accelerator>) {
        self.spares.retain(|(own, _)| *own != name);
        if self.spare_bytes().saturating_add(bytes_of(&*tree)) <= self.max_spare_bytes {
            self.spares.push((name, tree));
        }
    }
}

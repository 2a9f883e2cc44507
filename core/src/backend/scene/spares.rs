//! Updates that use the memory of trees that are no longer needed.

use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;

use super::accelerator::SceneAccelerator;
use super::built::{BuiltGeometry, BuiltScene};
use super::lists::{push, reserve};
use super::pending::{FinishError, PendingUpdate};
use super::shared::SharedGeometry;
use super::update::UpdateReport;
use crate::backend::{Accelerator, Backend, BuildOptions};
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::scene::{GeometryId, GeometryMesh, Scene, SceneBuildError};

/// Brings a scene up to date as [`Backend::update_scene`] does, and keeps memory: for meshes whose vertices move every frame.
///
/// A tree that came from here and is replaced becomes the geometry's spare, and the next update builds into its memory ([`Backend::rebuild`], which with a
/// watch builds beside it on the CPU, and keeps nothing). So the first two updates of a mesh take new memory, and a failed update still
/// leaves the scene as it was, since no tree that rays go through is written. The price is a second tree for each mesh that changes: `max_spare_bytes` bounds
/// them, [`SceneUpdater::spare_bytes`] tells them, and [`SceneUpdater::clear`] drops them. [`Backend::update_scene`] keeps none. A tree that was built into the memory
/// of a larger one goes on holding that: spares count by what they hold ([`Accelerator::held_bytes`]), a scene by what queries read.
///
/// Trees and hits are those of [`Backend::update_scene`]. A scene may be updated in both ways in turn. Trees that the scene does not have any more when an update begins
/// are spares from then on, within the bound; until then, and after a scene is dropped, they are held. [`SceneUpdater::clear`] drops them too.
///
/// Where the old scene answers while trees are built, [`SceneUpdater::build_next`] builds those of a [`PendingUpdate`] into spares, and [`SceneUpdater::finish`] keeps the trees that
/// it replaces. A device's `PendingSceneUpdate` does not use spares: the build that is under way has the memory of its tree, and gives it to nobody else before it is done.
///
/// Geometries that get the same arrays in one update have one tree. It is built into the spare of the first of them, and becomes a spare when no other has it any more.
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
    /// Shares of the trees that scenes got from here, in ascending order of geometries.
    current: Vec<(GeometryId, SharedGeometry)>,
    spares: Spares,
    /// Empty between updates: their memory is kept.
    asked: Vec<(GeometryId, Arc<GeometryMesh>)>,
    made: Vec<(GeometryId, SharedGeometry)>,
}

impl SceneUpdater {
    /// One that has no spares yet, and never more than this.
    pub fn new(max_spare_bytes: u64) -> SceneUpdater {
        let (current, spares) = (Vec::new(), Spares::default());
        SceneUpdater { max_spare_bytes, current, spares, asked: Vec::new(), made: Vec::new() }
    }

    /// Bytes that all spares hold.
    pub fn spare_bytes(&self) -> u64 {
        self.spares.bytes()
    }

    /// Drops all spares, and its shares of trees that scenes have or had.
    pub fn clear(&mut self) {
        self.spares = Spares::default();
        self.current.clear();
    }

    /// Brings a scene up to date with its description: see [`Backend::update_scene`]. Spares count towards the options' limit too, until they are built into.
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
        for (name, mesh) in scene.scene().unbuilt(description)? {
            push(&mut self.asked, (name, Arc::clone(mesh)))?;
        }
        // What cannot be kept later is asked for before anything changes.
        self.make_room(self.asked.len())?;
        self.release_what_is_gone(scene.scene());
        let mut waiting: u64 = self.asked.iter().map(|(name, _)| self.spares.bytes_of(*name)).sum();
        let idle = self.spares.bytes() - waiting;

        let (spares, made, most) = (&mut self.spares, &mut self.made, self.max_spare_bytes);
        let mut asked = self.asked.drain(..);
        let mut build = |mesh: &Mesh<'_>, options: &BuildOptions<'_>| {
            // As many as are asked for, in this order.
            let missing = || BuildError::WrongMesh { reason: "it was not announced".into() };
            let (name, own) = asked.next().ok_or_else(missing)?;
            // Who builds into a spare counts it.
            waiting -= spares.bytes_of(name);
            let tree = spares.build(backend, (name, mesh), &options.beside(waiting), most);
            let tree = tree.map_err(|error| error.beside(waiting, options.max_memory))?;
            let shared = SharedGeometry::new(own, tree);
            made.push((name, shared.clone()));
            let shared: Box<dyn Accelerator> = Box::new(shared);
            Ok(shared)
        };
        let updated = scene.update_by(description, &options.beside(idle), &mut build);
        drop(asked);
        self.keep_made(updated.is_ok());
        if updated.is_ok() {
            self.forget_what_is_gone(description);
        }
        updated.map_err(|error| error.beside(idle, options.max_memory))
    }

    /// Builds the next mesh of a pending update, into a spare where there is one: see [`PendingUpdate::build_next`]. Other spares count towards the options' limit
    /// too. The tree is the pending update's then, also where that is dropped.
    ///
    /// # Errors
    /// As there.
    pub fn build_next(
        &mut self,
        backend: &dyn Backend,
        pending: &mut PendingUpdate,
        options: &BuildOptions<'_>,
    ) -> Result<bool, SceneBuildError> {
        let (spares, most) = (&mut self.spares, self.max_spare_bytes);
        pending.build_next_by(options, &mut |name, mesh, options| {
            let others = spares.bytes() - spares.bytes_of(name);
            let built = spares.build(backend, (name, mesh), &options.beside(others), most);
            built.map_err(|error| error.beside(others, options.max_memory))
        })
    }

    /// Puts a pending update in place: see [`PendingUpdate::finish`]. The trees that it replaces become spares, where they came from here. Spares count towards
    /// the options' limit too.
    ///
    /// # Errors
    /// As there; the scene is then what it was, and trees are kept by the pending update.
    pub fn finish(
        &mut self,
        backend: &dyn Backend,
        pending: &mut PendingUpdate,
        scene: &mut dyn SceneAccelerator,
        description: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, FinishError> {
        self.made.clear();
        for (name, mesh) in scene.scene().unbuilt(description)? {
            if let Some(tree) = pending.tree_of(mesh) {
                push(&mut self.made, (name, tree.clone()))?;
            }
        }
        self.make_room(self.made.len())?;
        self.release_what_is_gone(scene.scene());
        let held = self.spares.bytes();
        let done = pending.finish(backend, scene, description, &options.beside(held));
        self.keep_made(done.is_ok());
        if done.is_ok() {
            self.forget_what_is_gone(description);
        }
        done.map_err(|error| match error {
            FinishError::Build(error) => error.beside(held, options.max_memory).into(),
            error => error,
        })
    }

    /// Room for what comes with so many new trees, so that nothing has to be asked for once anything changed.
    fn make_room(&mut self, more: usize) -> Result<(), SceneBuildError> {
        reserve(&mut self.made, more)?;
        reserve(&mut self.current, more)?;
        self.spares.reserve(more + self.current.len())
    }

    /// Drops what it has for geometries that are meshes no more.
    fn forget_what_is_gone(&mut self, description: &Scene) {
        let is_mesh = |name| description.geometry(name).is_ok_and(|own| own.shapes().is_none());
        self.current.retain(|(name, _)| is_mesh(*name));
        self.spares.retain(is_mesh);
    }

    /// Makes spares of trees that a scene has no more, where nobody else has them.
    fn release_what_is_gone(&mut self, scene: &BuiltScene) {
        let (spares, most) = (&mut self.spares, self.max_spare_bytes);
        let gone = self.current.extract_if(.., |(name, shared)| {
            let has = |own: &BuiltGeometry| core::ptr::eq(own.accelerator().tree(), shared.tree());
            !scene.geometry(*name).is_some_and(has)
        });
        for (name, shared) in gone {
            if let Some(tree) = shared.into_tree() {
                spares.keep(name, tree, most);
            }
        }
        spares.sort();
    }

    /// Notes the trees that were made, which the scene has now if it was updated; the ones before them become spares.
    fn keep_made(&mut self, updated: bool) {
        let before = self.current.len();
        // With no room for spares nobody will ask for what the scene has.
        let keeps = self.max_spare_bytes > 0;
        while let Some((name, shared)) = self.made.pop() {
            let old = if updated && keeps {
                let known = &mut self.current[..before];
                if let Ok(place) = known.binary_search_by_key(&name, |(name, _)| *name) {
                    Some(core::mem::replace(&mut known[place].1, shared))
                } else {
                    self.current.push((name, shared));
                    None
                }
            } else {
                Some(shared)
            };
            // Who else has it keeps it.
            if let Some(tree) = old.and_then(SharedGeometry::into_tree) {
                self.spares.keep(name, tree, self.max_spare_bytes);
            }
        }
        self.current.sort_unstable_by_key(|(name, _)| *name);
        self.spares.sort();
    }
}

/// The spares, each found by its geometry's name in the logarithm of their number.
#[derive(Default)]
struct Spares {
    /// In ascending order of names up to `sorted`; one that was taken leaves an empty place until all are sorted again.
    all: Vec<Spare>,
    sorted: usize,
    bytes: u64,
}

struct Spare {
    name: GeometryId,
    tree: Option<Box<dyn Accelerator>>,
    /// What it holds.
    bytes: u64,
}

impl Spares {
    fn reserve(&mut self, more: usize) -> Result<(), SceneBuildError> {
        reserve(&mut self.all, more)
    }

    /// Bytes that all hold.
    fn bytes(&self) -> u64 {
        self.bytes
    }

    fn place_of(&self, name: GeometryId) -> Option<usize> {
        self.all[..self.sorted].binary_search_by_key(&name, |spare| spare.name).ok()
    }

    /// Bytes that the spare of a geometry holds; 0 where there is none.
    fn bytes_of(&self, name: GeometryId) -> u64 {
        self.place_of(name).map_or(0, |place| self.all[place].bytes)
    }

    fn get_mut(&mut self, name: GeometryId) -> Option<&mut Box<dyn Accelerator>> {
        let place = self.place_of(name)?;
        self.all[place].tree.as_mut()
    }

    fn take(&mut self, name: GeometryId) -> Option<Box<dyn Accelerator>> {
        let place = self.place_of(name)?;
        let own = &mut self.all[place];
        self.bytes -= core::mem::take(&mut own.bytes);
        own.tree.take()
    }

    /// Builds a tree for a geometry, into its spare where there is one. After an error that is still a spare, which may hold more or less than before: it is
    /// counted again, and dropped where there is no room for it any more.
    fn build(
        &mut self,
        backend: &dyn Backend,
        (name, mesh): (GeometryId, &Mesh<'_>),
        options: &BuildOptions<'_>,
        max_bytes: u64,
    ) -> Result<Box<dyn Accelerator>, BuildError> {
        let Some(spare) = self.get_mut(name) else { return backend.build(mesh, options) };
        let built = backend.rebuild(spare, mesh, options);
        match (built, self.take(name)) {
            (Ok(()), Some(tree)) => Ok(tree),
            (built, tree) => {
                if let Some(tree) = tree {
                    self.keep(name, tree, max_bytes);
                }
                // It was there.
                Err(built.err().unwrap_or(BuildError::WrongMesh { reason: "no spare".into() }))
            }
        }
    }

    /// Keeps a tree as the spare of a geometry in place of another one, where there is room for it; the list has space. It is found once the list
    /// is sorted.
    fn keep(&mut self, name: GeometryId, tree: Box<dyn Accelerator>, max_bytes: u64) {
        drop(self.take(name));
        let bytes = tree.held_bytes();
        if self.bytes.saturating_add(bytes) > max_bytes {
            return;
        }
        self.bytes += bytes;
        let spare = Spare { name, tree: Some(tree), bytes };
        match self.place_of(name) {
            Some(place) => self.all[place] = spare,
            None => self.all.push(spare),
        }
    }

    /// Drops those of other geometries.
    fn retain(&mut self, keeps: impl Fn(GeometryId) -> bool) {
        self.all.retain(|spare| spare.tree.is_some() && keeps(spare.name));
        self.bytes = self.all.iter().map(|spare| spare.bytes).sum();
        self.sorted = self.all.len();
    }

    /// Sorts in what was kept since.
    fn sort(&mut self) {
        self.all.retain(|spare| spare.tree.is_some());
        self.all.sort_unstable_by_key(|spare| spare.name);
        self.sorted = self.all.len();
    }
}

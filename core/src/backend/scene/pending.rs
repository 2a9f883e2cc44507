//! An update whose trees are built while the scene goes on answering.

use alloc::boxed::Box;
use alloc::format;
use alloc::sync::Arc;
use alloc::vec::Vec;
use thiserror::Error;

use super::accelerator::SceneAccelerator;
use super::built::BuiltScene;
use super::lists::push;
use super::needed::NeededTrees;
use super::shared::SharedGeometry;
use super::update::UpdateReport;
use crate::backend::{Accelerator, Backend, BuildOptions};
use crate::cancel::go_on;
use crate::error::BuildError;
use crate::mesh::Mesh;
use crate::scene::{Edits, GeometryId, GeometryMesh, OpacityMask, Scene, SceneBuildError};
use crate::watch::{Progress, Stage};

/// Why a pending update was not put in place. The scene is what it was, and the update has all trees that it had.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FinishError {
    /// The scene was updated after this update began. [`PendingUpdate::renew`] takes it to the scene as it is now.
    #[error("the scene was updated after this update began; renew it")]
    Outdated,
    /// A geometry of the description is not built: it changed since the update began, or its build is not done.
    #[error("geometry {geometry} is not built yet; build what is left, or renew the update")]
    NotBuilt {
        /// The geometry.
        geometry: u32,
    },
    /// The update itself failed.
    #[error(transparent)]
    Build(#[from] SceneBuildError),
}

/// An update of a scene of which the geometries' trees are built first, and put in place later. It holds nothing of the scene but shares of its arrays,
/// so the scene answers meanwhile as before, and what goes on with the update may be another thread.
///
/// Building takes the time; [`PendingUpdate::finish`] then takes what an update takes for which no mesh is to be built. (Trees over shapes are built there.)
/// Dropping it, or an error, leaves the scene as it was. Several may be pending for one scene: the one that is finished first makes
/// the others outdated, which keep their trees.
///
/// Trees are built in new memory; [`SceneUpdater::build_next`](super::SceneUpdater::build_next) builds them into spares.
///
/// ```
/// # use splitplane_core::backend::{Backend, BuildOptions};
/// # use splitplane_core::backend::scene::{FinishError, PendingUpdate, SceneAccelerator, UpdateReport};
/// # use splitplane_core::scene::Scene;
/// fn change(
///     backend: &dyn Backend,
///     built: &mut Box<dyn SceneAccelerator>,
///     description: &Scene,
/// ) -> Result<UpdateReport, FinishError> {
///     let options = BuildOptions::default();
///     let mut pending = PendingUpdate::begin(backend, built.scene(), description)?;
///     // On another thread, say; `built` answers rays meanwhile.
///     pending.build(backend, &options)?;
///     pending.finish(backend, built, description, &options)
/// }
/// ```
pub struct PendingUpdate {
    before: Before,
    trees: NeededTrees,
}

/// Builds the mesh of a geometry.
pub(super) type BuildNamed<'a> = dyn FnMut(GeometryId, &Mesh<'_>, &BuildOptions<'_>) -> Result<Box<dyn Accelerator>, BuildError>
    + 'a;

/// What a geometry of a scene consists of.
type Content = (Arc<GeometryMesh>, Option<Arc<OpacityMask>>);

/// The scene when the update began, as far as it tells whether it was updated since: identities of what it was made from. They are held, so
/// that nothing new can have the same.
struct Before {
    edits: Option<Edits>,
    geometries: Vec<(GeometryId, Content)>,
    /// Bytes of the scene.
    held: u64,
}

impl Before {
    fn of(scene: &BuiltScene) -> Result<Before, SceneBuildError> {
        let mut geometries = Vec::new();
        for (name, own) in scene.geometries() {
            push(&mut geometries, (name, (Arc::clone(&own.mesh), own.opacity.clone())))?;
        }
        Ok(Before { edits: scene.edits.clone(), geometries, held: scene.bytes() })
    }

    fn is_now(&self, scene: &BuiltScene) -> bool {
        let edits = match (&self.edits, &scene.edits) {
            (Some(one), Some(other)) => one.is_same(other),
            (one, other) => one.is_none() && other.is_none(),
        };
        let mut now = scene.geometries();
        let geometries = self.geometries.iter().all(|(name, (mesh, opacity))| {
            now.next().is_some_and(|(other, own)| {
                let masks = match (opacity, &own.opacity) {
                    (Some(one), Some(other)) => Arc::ptr_eq(one, other),
                    (one, other) => one.is_none() && other.is_none(),
                };
                *name == other && Arc::ptr_eq(mesh, &own.mesh) && masks
            })
        });
        edits && geometries && now.next().is_none()
    }
}

impl PendingUpdate {
    /// Begins an update of a scene to a description: finds the meshes whose trees it needs. Builds nothing.
    ///
    /// # Errors
    /// Shapes that the backend does not answer, or no memory.
    pub fn begin(
        backend: &dyn Backend,
        scene: &BuiltScene,
        description: &Scene,
    ) -> Result<PendingUpdate, SceneBuildError> {
        backend.check_shapes(description)?;
        let before = Before::of(scene)?;
        let trees = NeededTrees::of(scene.unbuilt(description)?, &NeededTrees::default())?;
        Ok(PendingUpdate { before, trees })
    }

    /// Begins again, with the scene as it is now and another description or the same: after [`FinishError::Outdated`], or when geometries of the
    /// description changed. Trees over arrays that are still needed are kept.
    ///
    /// # Errors
    /// No memory; the update is then what it was.
    pub fn renew(
        &mut self,
        scene: &BuiltScene,
        description: &Scene,
    ) -> Result<(), SceneBuildError> {
        let before = Before::of(scene)?;
        let trees = NeededTrees::of(scene.unbuilt(description)?, &self.trees)?;
        (self.before, self.trees) = (before, trees);
        Ok(())
    }

    /// How many meshes have no tree yet. One that several geometries share counts once.
    pub fn left(&self) -> usize {
        self.trees.left()
    }

    /// Bytes of the trees that are built, which no scene has yet. One that several geometries share counts once.
    pub fn bytes(&self) -> u64 {
        self.trees.bytes()
    }

    /// The next mesh without a tree, for who builds it elsewhere and gives it to [`PendingUpdate::give`].
    pub fn next_mesh(&self) -> Option<(GeometryId, &Arc<GeometryMesh>)> {
        self.trees.next()
    }

    /// The first geometry that waits for a tree over these arrays.
    pub fn waits_for(&self, mesh: &Arc<GeometryMesh>) -> Option<GeometryId> {
        self.trees.waits_for(mesh)
    }

    /// How far building has come.
    pub fn progress(&self) -> Progress {
        let total = self.trees.len() as u64;
        Progress { stage: Stage::Geometries, done: total - self.left() as u64, total }
    }

    /// Options for the next mesh: of a limit what the scene as it was and the trees so far leave.
    pub fn options_for_next<'a>(&self, options: &BuildOptions<'a>) -> BuildOptions<'a> {
        options.beside(self.before.held.saturating_add(self.bytes()))
    }

    /// What a failed build of a mesh, with [`PendingUpdate::options_for_next`], is to the caller, who set a limit for all.
    pub fn error_of(
        &self,
        geometry: GeometryId,
        error: BuildError,
        options: &BuildOptions<'_>,
    ) -> SceneBuildError {
        let error = match error {
            BuildError::Cancelled { .. } => {
                return SceneBuildError::Cancelled { progress: self.progress() };
            }
            error => {
                let held = self.before.held.saturating_add(self.bytes());
                error.beside(held, options.max_memory)
            }
        };
        SceneBuildError::Geometry { geometry: geometry.0, error }
    }

    /// Gives the tree over the arrays that [`PendingUpdate::next_mesh`] named, which [`Backend::build`] or [`Backend::load`] made of them. Where several geometries
    /// have these arrays, all of them get it; where none waits for it any more, it is dropped.
    ///
    /// A tree over other arrays gives wrong hits, or panics when it is asked. Only the number of triangles is compared.
    ///
    /// # Errors
    /// [`BuildError::WrongMesh`] for a tree of another number of triangles than the mesh has. The mesh then still waits.
    pub fn give(
        &mut self,
        mesh: &Arc<GeometryMesh>,
        tree: Box<dyn Accelerator>,
    ) -> Result<(), BuildError> {
        let (own, given) = (mesh.mesh().len(), tree.tree().triangles as usize);
        if own != given {
            let reason = format!("the tree has {given} triangles, the mesh {own}");
            return Err(BuildError::WrongMesh { reason });
        }
        if self.trees.waits_for(mesh).is_some() {
            self.trees.give(SharedGeometry::new(Arc::clone(mesh), tree));
        }
        Ok(())
    }

    /// Builds the tree of the next mesh without one, and waits for it. False where there is none. So a thread can do other work between two.
    ///
    /// # Errors
    /// The build fails, a limit binds, or the watch cancels it; the next call tries again.
    pub fn build_next(
        &mut self,
        backend: &dyn Backend,
        options: &BuildOptions<'_>,
    ) -> Result<bool, SceneBuildError> {
        self.build_next_by(options, &mut |_, mesh, options| backend.build(mesh, options))
    }

    /// The same by what builds a mesh of a geometry.
    pub(super) fn build_next_by(
        &mut self,
        options: &BuildOptions<'_>,
        build: &mut BuildNamed<'_>,
    ) -> Result<bool, SceneBuildError> {
        let Some((name, mesh)) = self.next_mesh() else { return Ok(false) };
        let mesh = Arc::clone(mesh);
        let progress = self.progress();
        go_on(options.watch, progress).map_err(|_| SceneBuildError::Cancelled { progress })?;
        let tree = build(name, &mesh.mesh(), &self.options_for_next(options));
        let given = tree.and_then(|tree| self.give(&mesh, tree));
        given.map_err(|error| self.error_of(name, error, options))?;
        Ok(true)
    }

    /// The tree over these arrays, where there is one.
    pub(super) fn tree_of(&self, mesh: &Arc<GeometryMesh>) -> Option<&SharedGeometry> {
        self.trees.tree_of(mesh)
    }

    /// Builds all that are left, and waits for them.
    ///
    /// # Errors
    /// As for [`PendingUpdate::build_next`]; what was built before is kept.
    pub fn build(
        &mut self,
        backend: &dyn Backend,
        options: &BuildOptions<'_>,
    ) -> Result<(), SceneBuildError> {
        while self.build_next(backend, options)? {}
        Ok(())
    }

    /// Puts the update in place. The description may have been edited since the update began, as far as its meshes are the same: instances are placed
    /// as it says now. Afterwards the update is of no more use.
    ///
    /// # Errors
    /// See [`FinishError`]. The scene is then what it was, and trees are kept here: it may be tried again.
    pub fn finish(
        &mut self,
        backend: &dyn Backend,
        scene: &mut dyn SceneAccelerator,
        description: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, FinishError> {
        backend.check_shapes(description)?;
        if !self.before.is_now(scene.scene()) {
            return Err(FinishError::Outdated);
        }
        let mut trees: Vec<SharedGeometry> = Vec::new();
        for (name, mesh) in scene.scene().unbuilt(description)? {
            let missing = FinishError::NotBuilt { geometry: name.0 };
            push(&mut trees, self.trees.tree_of(mesh).ok_or(missing)?.clone())?;
        }
        let mut trees = trees.into_iter();
        let mut next = |_: &Mesh<'_>, options: &BuildOptions<'_>| {
            // As many as are asked for, in this order.
            let missing = || BuildError::WrongMesh { reason: "it was not built before".into() };
            let tree = trees.next().ok_or_else(missing)?;
            let needed = tree.bytes();
            if let Some(limit) = options.max_memory.filter(|&limit| needed > limit) {
                return Err(BuildError::OutOfMemory { needed, limit });
            }
            let tree: Box<dyn Accelerator> = Box::new(tree);
            Ok(tree)
        };
        let report = scene.update_by(description, options, &mut next)?;
        self.trees = NeededTrees::default();
        Ok(report)
    }
}

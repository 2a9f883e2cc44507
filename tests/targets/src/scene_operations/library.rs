//! The calls that edits and updates are made of, so that a test can put a faulty one in the place of each.

use splitplane_core::backend::scene::{
    BuiltScene, FinishError, PendingUpdate, SceneAccelerator, SceneUpdater, UpdateReport,
};
use splitplane_core::backend::{Backend, BuildOptions};
use splitplane_core::mesh::Mesh;
use splitplane_core::scene::{
    BakeError, BakedTable, GeometryId, InstanceId, Scene, SceneBuildError, SceneError,
};

type Built<'a> = &'a mut Box<dyn SceneAccelerator>;

/// The library's calls.
pub trait Library {
    /// What builds.
    fn backend(&self) -> &dyn Backend;

    /// What was built.
    fn scene(&self, built: Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator> {
        built
    }

    /// An updater with a bound of its spares.
    fn updater(&self, bound: u64) -> SceneUpdater {
        SceneUpdater::new(bound)
    }

    /// See [`SceneUpdater::clear`].
    fn clear(&self, updater: &mut SceneUpdater) {
        updater.clear();
    }

    /// Gives a geometry the arrays of another one of the same description.
    fn share(&self, scene: &mut Scene, to: GeometryId, from: GeometryId) -> Result<(), SceneError> {
        let mut aside = Scene::new();
        let none: [[[f32; 3]; 3]; 0] = [];
        let name = aside.add_mesh(&Mesh::soup(&none).expect("a mesh"))?;
        aside.share_geometry(name, scene, from)?;
        scene.share_geometry(to, &aside, name)
    }

    /// See [`Scene::bake_within`].
    fn bake(
        &self,
        scene: &Scene,
        groups: &[&[InstanceId]],
        limit: u64,
    ) -> Result<(Scene, BakedTable), BakeError> {
        scene.bake_within(groups, limit)
    }

    /// See [`Backend::update_scene`].
    fn update(
        &self,
        built: Built<'_>,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        self.backend().update_scene(built, scene, options)
    }

    /// See [`PendingUpdate::build_next`], and [`SceneUpdater::build_next`].
    fn build_next(
        &self,
        updater: Option<&mut SceneUpdater>,
        pending: &mut PendingUpdate,
        options: &BuildOptions<'_>,
    ) -> Result<bool, SceneBuildError> {
        match updater {
            Some(updater) => updater.build_next(self.backend(), pending, options),
            None => pending.build_next(self.backend(), options),
        }
    }

    /// See [`PendingUpdate::renew`].
    fn renew(
        &self,
        pending: &mut PendingUpdate,
        built: &BuiltScene,
        scene: &Scene,
    ) -> Result<(), SceneBuildError> {
        pending.renew(built, scene)
    }

    /// See [`PendingUpdate::finish`], and [`SceneUpdater::finish`].
    fn finish(
        &self,
        updater: Option<&mut SceneUpdater>,
        pending: &mut PendingUpdate,
        built: Built<'_>,
        scene: &Scene,
        options: &BuildOptions<'_>,
    ) -> Result<UpdateReport, FinishError> {
        match updater {
            Some(updater) => updater.finish(self.backend(), pending, built, scene, options),
            None => pending.finish(self.backend(), built, scene, options),
        }
    }
}

/// The library with a backend, and with a fault in what it builds.
pub struct OnBackend<'a, F> {
    /// What builds.
    pub backend: &'a dyn Backend,
    /// Puts the fault into a scene.
    pub fault: F,
}

impl<F: Fn(Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator>> Library for OnBackend<'_, F> {
    fn backend(&self) -> &dyn Backend {
        self.backend
    }

    fn scene(&self, built: Box<dyn SceneAccelerator>) -> Box<dyn SceneAccelerator> {
        (self.fault)(built)
    }
}

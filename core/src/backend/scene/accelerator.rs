//! What answers rays through a scene: the trait that backends implement.

use alloc::boxed::Box;

use super::all_hits::{SceneAllHits, SceneAllHitsOptions};
use super::built::{BuildGeometry, BuiltScene};
use super::update::UpdateReport;
use crate::backend::BuildOptions;
use crate::error::QueryError;
use crate::query::inside::{LocateOptions, Located};
use crate::ray::Ray;
use crate::scene::{Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};

/// A scene that is built, ready for rays. Answers do not depend on the order of rays, the thread count, or the tree over the
/// instances; in accuracies watertight and exact they are equal on all backends, bit for bit.
///
/// [`Backend::build_scene`](crate::backend::Backend::build_scene) makes one,
/// [`Backend::update_scene`](crate::backend::Backend::update_scene) brings it up to date.
pub trait SceneAccelerator: Send + Sync {
    /// What was built.
    fn scene(&self) -> &BuiltScene;

    /// Brings it up to date with a description: see [`BuiltScene::update`]. `build` is the backend's
    /// [`Backend::build`](crate::backend::Backend::build).
    ///
    /// # Errors
    /// As for [`BuiltScene::update`]; the scene is then what it was.
    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError>;

    /// The hit of least (t, instance, triangle) of every ray; [`SceneHit::MISS`] where there is none. After an error
    /// `hits` holds the answers to some of the rays, and nothing says which: do not use it.
    ///
    /// # Errors
    /// `rays` and `hits` of different length, a watch that cancels the batch, no memory, or a device that fails.
    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError>;

    /// For every ray, whether it hits anything. After an error `occluded` must not be used.
    ///
    /// # Errors
    /// As for [`SceneAccelerator::closest_hits`].
    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError>;

    /// The closest hit of a single ray. Ignores the options' watch.
    fn closest_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> Option<SceneHit> {
        self.scene().answer_one::<SceneHit>(ray, options).some()
    }

    /// Whether a single ray hits anything. Ignores the options' watch.
    fn any_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> bool {
        self.scene().answer_one(ray, options)
    }

    /// All crossings of every ray with surfaces of all instances, in order of (t, instance, triangle): see
    /// [`SceneAllHits`].
    ///
    /// # Errors
    /// More memory than the options allow or than the system has, a watch that cancels the batch, or a device that
    /// fails.
    fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, QueryError> {
        self.scene().all_hits(rays, options)
    }

    /// How often the surfaces of all instances wind around each point: see [`BuiltScene::locate`].
    ///
    /// # Errors
    /// As for [`SceneAccelerator::all_hits`].
    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        self.scene().locate(points, options)
    }
}

/// A scene in a box, which need not be known by its own type.
impl SceneAccelerator for Box<dyn SceneAccelerator> {
    fn scene(&self) -> &BuiltScene {
        (**self).scene()
    }

    fn update_by(
        &mut self,
        scene: &Scene,
        options: &BuildOptions<'_>,
        build: &mut BuildGeometry<'_>,
    ) -> Result<UpdateReport, SceneBuildError> {
        (**self).update_by(scene, options, build)
    }

    fn closest_hits(
        &self,
        rays: &[Ray],
        hits: &mut [SceneHit],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        (**self).closest_hits(rays, hits, options)
    }

    fn any_hits(
        &self,
        rays: &[Ray],
        occluded: &mut [bool],
        options: &SceneOptions<'_>,
    ) -> Result<SceneReport, QueryError> {
        (**self).any_hits(rays, occluded, options)
    }
}

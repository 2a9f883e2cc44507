//! Queries that have no way which could reach a part of a scene: they build all of it.

use super::{LazyError, LazyScene};
use splitplane_core::backend::scene::{
    SceneClosestPoint, SceneClosestPointOptions, SceneOverlapOptions, SceneOverlaps,
};
use splitplane_core::query::inside::{LocateOptions, Located};
use splitplane_core::query::overlap::Volume;
use splitplane_core::report::QueryReport;
use splitplane_float_state::Standard;

impl LazyScene {
    /// How often surfaces wind around each point: see [`locate`](splitplane_core::backend::scene::SceneAccelerator::locate). Builds everything: points have no way that could
    /// reach a part of it.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, LazyError> {
        let _state = Standard::set();
        self.complete(options.watch)?;
        Ok(self.state().accelerator.locate(points, options)?)
    }

    /// The closest point of the scene to each point: see [`closest_points`](splitplane_core::backend::scene::SceneAccelerator::closest_points). Builds everything.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, LazyError> {
        let _state = Standard::set();
        self.complete(options.watch)?;
        Ok(self.state().accelerator.closest_points(points, closest, options)?)
    }

    /// The triangles that each volume meets: see [`overlaps`](splitplane_core::backend::scene::SceneAccelerator::overlaps). Builds everything.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, LazyError> {
        let _state = Standard::set();
        self.complete(options.watch)?;
        Ok(self.state().accelerator.overlaps(volumes, options)?)
    }

    /// For every volume, whether it meets any triangle: see [`overlaps_any`](splitplane_core::backend::scene::SceneAccelerator::overlaps_any). Builds everything. After an error
    /// `found` must not be used.
    ///
    /// # Errors
    /// As for [`LazyScene::closest_hits`].
    pub fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), LazyError> {
        let _state = Standard::set();
        self.complete(options.watch)?;
        Ok(self.state().accelerator.overlaps_any(volumes, found, options)?)
    }
}

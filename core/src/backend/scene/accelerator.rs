//! What answers rays through a scene: the trait that backends implement.

use alloc::boxed::Box;

use super::all_hits::{SceneAllHits, SceneAllHitsOptions};
use super::built::{BuildGeometry, BuiltScene};
use super::closest_point::{SceneClosestPoint, SceneClosestPointOptions};
use super::overlap::{SceneOverlapOptions, SceneOverlaps};
use super::update::UpdateReport;
use crate::backend::BuildOptions;
use crate::cancel::go_on_tracing;
use crate::error::QueryError;
use crate::query::closest_point::check_lengths;
use crate::query::inside::{LocateOptions, Located};
use crate::query::overlap::Volume;
use crate::ray::Ray;
use crate::report::QueryReport;
use crate::scene::{Scene, SceneBuildError, SceneHit, SceneOptions, SceneReport};

/// A scene that is built, ready for rays. Answers do not depend on the order of rays, the thread count, or the tree over the
/// instances; in accuracies watertight and exact they are equal on all backends, bit for bit.
///
/// [`Backend::build_scene`](crate::backend::Backend::build_scene) makes one,
/// [`Backend::update_scene`](crate::backend::Backend::update_scene) brings it up to date.
pub trait SceneAccelerator: Send + Sync {
    /// What was built.
    fn scene(&self) -> &BuiltScene;

    /// Why the CPU finds the instances that rays enter, for a backend whose device could: `None` where the device does that for
    /// batches of accuracy watertight without a filter, and for the CPU backend.
    fn placed_by_cpu(&self) -> Option<&str> {
        None
    }

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

    /// How many crossings [`SceneAccelerator::all_hits`] has of every ray, without them: see [`BuiltScene::count_hits`]. After an error `counts` must not be used.
    ///
    /// # Errors
    /// As there.
    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.scene().count_hits(rays, counts, options)
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

    /// The point of the scene that is closest to each point: see [`BuiltScene::closest_points`]. After an error `closest` must not
    /// be used.
    ///
    /// # Errors
    /// As there.
    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        self.scene().closest_points(points, closest, options)
    }

    /// The triangles that each volume meets in the world, exactly: see [`BuiltScene::overlaps`]. Order and answers do not depend on
    /// the number of threads.
    ///
    /// # Errors
    /// As there.
    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        self.scene().overlaps(volumes, options)
    }

    /// For every volume, whether it meets any triangle in the world. After an error `found` must not be used.
    ///
    /// # Errors
    /// As for [`SceneAccelerator::overlaps`], and `volumes` and `found` of different length.
    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        check_lengths(volumes.len(), found.len())?;
        let total = volumes.len() as u64;
        for (done, (volume, found)) in volumes.iter().zip(found).enumerate() {
            go_on_tracing(options.watch, done as u64, total)?;
            *found = self.scene().overlaps_any(volume, options)?;
        }
        go_on_tracing(options.watch, total, total)
    }
}

/// A scene in a box, which need not be known by its own type.
impl SceneAccelerator for Box<dyn SceneAccelerator> {
    fn scene(&self) -> &BuiltScene {
        (**self).scene()
    }

    fn placed_by_cpu(&self) -> Option<&str> {
        (**self).placed_by_cpu()
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

    fn closest_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> Option<SceneHit> {
        (**self).closest_hit(ray, options)
    }

    fn any_hit(&self, ray: &Ray, options: &SceneOptions<'_>) -> bool {
        (**self).any_hit(ray, options)
    }

    fn all_hits(
        &self,
        rays: &[Ray],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<SceneAllHits, QueryError> {
        (**self).all_hits(rays, options)
    }

    fn count_hits(
        &self,
        rays: &[Ray],
        counts: &mut [u64],
        options: &SceneAllHitsOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        (**self).count_hits(rays, counts, options)
    }

    fn locate(
        &self,
        points: &[[f32; 3]],
        options: &LocateOptions<'_>,
    ) -> Result<Located, QueryError> {
        (**self).locate(points, options)
    }

    fn closest_points(
        &self,
        points: &[[f32; 3]],
        closest: &mut [SceneClosestPoint],
        options: &SceneClosestPointOptions<'_>,
    ) -> Result<QueryReport, QueryError> {
        (**self).closest_points(points, closest, options)
    }

    fn overlaps(
        &self,
        volumes: &[Volume<'_>],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<SceneOverlaps, QueryError> {
        (**self).overlaps(volumes, options)
    }

    fn overlaps_any(
        &self,
        volumes: &[Volume<'_>],
        found: &mut [bool],
        options: &SceneOverlapOptions<'_>,
    ) -> Result<(), QueryError> {
        (**self).overlaps_any(volumes, found, options)
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::AtomicUsize;
    use core::sync::atomic::Ordering::Relaxed;

    use super::*;

    const NAMES: [&str; 13] = [
        "scene",
        "placed_by_cpu",
        "update_by",
        "closest_hits",
        "any_hits",
        "closest_hit",
        "any_hit",
        "all_hits",
        "count_hits",
        "locate",
        "closest_points",
        "overlaps",
        "overlaps_any",
    ];

    /// Writes down which of its methods was called.
    #[derive(Default)]
    struct Noted {
        scene: BuiltScene,
        called: AtomicUsize,
    }

    impl Noted {
        fn note<T>(&self, name: &str, answer: T) -> T {
            let place = NAMES.iter().position(|known| *known == name).expect("a name");
            self.called.store(place, Relaxed);
            answer
        }
    }

    impl SceneAccelerator for &'static Noted {
        fn scene(&self) -> &BuiltScene {
            self.note("scene", &self.scene)
        }

        fn placed_by_cpu(&self) -> Option<&str> {
            self.note("placed_by_cpu", None)
        }

        fn update_by(
            &mut self,
            _: &Scene,
            _: &BuildOptions<'_>,
            _: &mut BuildGeometry<'_>,
        ) -> Result<UpdateReport, SceneBuildError> {
            self.note("update_by", Ok(UpdateReport::default()))
        }

        fn closest_hits(
            &self,
            _: &[Ray],
            _: &mut [SceneHit],
            _: &SceneOptions<'_>,
        ) -> Result<SceneReport, QueryError> {
            self.note("closest_hits", Ok(SceneReport::default()))
        }

        fn any_hits(
            &self,
            _: &[Ray],
            _: &mut [bool],
            _: &SceneOptions<'_>,
        ) -> Result<SceneReport, QueryError> {
            self.note("any_hits", Ok(SceneReport::default()))
        }

        fn closest_hit(&self, _: &Ray, _: &SceneOptions<'_>) -> Option<SceneHit> {
            self.note("closest_hit", None)
        }

        fn any_hit(&self, _: &Ray, _: &SceneOptions<'_>) -> bool {
            self.note("any_hit", false)
        }

        fn all_hits(
            &self,
            _: &[Ray],
            _: &SceneAllHitsOptions<'_>,
        ) -> Result<SceneAllHits, QueryError> {
            self.note("all_hits", Err(QueryError::Unsupported { query: "all hits" }))
        }

        fn count_hits(
            &self,
            _: &[Ray],
            _: &mut [u64],
            _: &SceneAllHitsOptions<'_>,
        ) -> Result<QueryReport, QueryError> {
            self.note("count_hits", Ok(QueryReport::default()))
        }

        fn locate(&self, _: &[[f32; 3]], _: &LocateOptions<'_>) -> Result<Located, QueryError> {
            self.note("locate", Ok(Located::default()))
        }

        fn closest_points(
            &self,
            _: &[[f32; 3]],
            _: &mut [SceneClosestPoint],
            _: &SceneClosestPointOptions<'_>,
        ) -> Result<QueryReport, QueryError> {
            self.note("closest_points", Ok(QueryReport::default()))
        }

        fn overlaps(
            &self,
            _: &[Volume<'_>],
            _: &SceneOverlapOptions<'_>,
        ) -> Result<SceneOverlaps, QueryError> {
            self.note("overlaps", Ok(SceneOverlaps::default()))
        }

        fn overlaps_any(
            &self,
            _: &[Volume<'_>],
            _: &mut [bool],
            _: &SceneOverlapOptions<'_>,
        ) -> Result<(), QueryError> {
            self.note("overlaps_any", Ok(()))
        }
    }

    /// A box hands every call on: a default in its place would pass over what a backend has of its own.
    #[test]
    fn a_box_hands_every_call_on() {
        let noted: &'static Noted = Box::leak(Box::default());
        let mut boxed: Box<dyn SceneAccelerator> = Box::new(noted);
        let called = || NAMES[noted.called.load(Relaxed)];
        let (ray, options) = (Ray::new([0.0; 3], [1.0; 3]), SceneOptions::default());
        let _ = SceneAccelerator::scene(&boxed);
        assert_eq!(called(), "scene");
        let _ = SceneAccelerator::placed_by_cpu(&boxed);
        assert_eq!(called(), "placed_by_cpu");
        let build = &mut |_: &crate::mesh::Mesh<'_>, _: &BuildOptions<'_>| unreachable!();
        let _ =
            SceneAccelerator::update_by(&mut boxed, &Scene::new(), &BuildOptions::default(), build);
        assert_eq!(called(), "update_by");
        let _ = SceneAccelerator::closest_hits(&boxed, &[], &mut [], &options);
        assert_eq!(called(), "closest_hits");
        let _ = SceneAccelerator::any_hits(&boxed, &[], &mut [], &options);
        assert_eq!(called(), "any_hits");
        let _ = SceneAccelerator::closest_hit(&boxed, &ray, &options);
        assert_eq!(called(), "closest_hit");
        let _ = SceneAccelerator::any_hit(&boxed, &ray, &options);
        assert_eq!(called(), "any_hit");
        let _ = SceneAccelerator::all_hits(&boxed, &[], &SceneAllHitsOptions::default());
        assert_eq!(called(), "all_hits");
        let _ = SceneAccelerator::count_hits(&boxed, &[], &mut [], &SceneAllHitsOptions::default());
        assert_eq!(called(), "count_hits");
        let _ = SceneAccelerator::locate(&boxed, &[], &LocateOptions::default());
        assert_eq!(called(), "locate");
        let options = SceneClosestPointOptions::default();
        let _ = SceneAccelerator::closest_points(&boxed, &[], &mut [], &options);
        assert_eq!(called(), "closest_points");
        let options = SceneOverlapOptions::default();
        let _ = SceneAccelerator::overlaps(&boxed, &[], &options);
        assert_eq!(called(), "overlaps");
        let _ = SceneAccelerator::overlaps_any(&boxed, &[], &mut [], &options);
        assert_eq!(called(), "overlaps_any");
    }
}

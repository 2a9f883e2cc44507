//! Which hits of a query of a scene count, for rays that are followed from instance to instance.

use core::cell::Cell;

use splitplane_core::backend::scene::{BuiltScene, Kept};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::scene::{GeometryId, InstanceId, SceneOptions};

use crate::trace::keep::Keep;

/// What tells it within one instance: `None` where all count.
#[derive(Clone, Copy)]
pub(super) struct KeepSome<'a> {
    kept: Option<Kept<'a>>,
    rejected: &'a Cell<u64>,
}

impl Keep for KeepSome<'_> {
    const ALL: bool = false;

    #[inline]
    fn keeps(self, hit: &Hit) -> bool {
        let keeps = self.kept.is_none_or(|kept| kept.keeps(hit));
        self.rejected.set(self.rejected.get() + u64::from(!keeps));
        keeps
    }
}

/// What tells it for a ray alone, whose rejected hits nobody counts.
#[derive(Clone, Copy)]
pub(super) struct KeepOf<'a>(pub(super) Kept<'a>);

impl Keep for KeepOf<'_> {
    const ALL: bool = false;

    #[inline]
    fn keeps(self, hit: &Hit) -> bool {
        self.0.keeps(hit)
    }
}

impl<'a> KeepSome<'a> {
    /// Within an instance of a geometry. Hits that do not count are added to `rejected`.
    pub(super) fn within(
        scene: &'a BuiltScene,
        (geometry, instance): (GeometryId, InstanceId),
        options: &'a SceneOptions<'a>,
        rejected: &'a Cell<u64>,
    ) -> KeepSome<'a> {
        let built = scene.geometry(geometry);
        let kept = built.and_then(|built| built.kept(geometry, instance, options));
        KeepSome { kept, rejected }
    }

    /// Whether every hit counts.
    pub(super) fn keeps_all(self) -> bool {
        self.kept.is_none()
    }

    /// The hit that is the answer, given the first one of a ray that is not traced in steps.
    pub(super) fn settle(
        self,
        scene: &BuiltScene,
        geometry: GeometryId,
        ray: &Ray,
        first: Hit,
        query: (&QueryOptions<'_>, Query),
    ) -> Hit {
        let (Some(kept), Some(built)) = (self.kept, scene.geometry(geometry)) else { return first };
        let mut more = 0;
        let hit = kept.next(built, ray, first, query, &mut more);
        self.rejected.set(self.rejected.get() + more);
        hit
    }
}

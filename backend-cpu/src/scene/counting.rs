//! Which hits of a query of a scene count, for rays that are followed from instance to instance.

use core::cell::Cell;

use splitplane_core::backend::scene::{BuiltScene, Kept};
use splitplane_core::query::traverse::Query;
use splitplane_core::ray::{Hit, QueryOptions, Ray};
use splitplane_core::scene::{GeometryId, InstanceId, SceneOptions};

use crate::trace::keep::{Keep, KeepAll};

/// How a batch tells which hits count.
pub(super) trait Counting {
    /// What tells it within one instance.
    type Keep<'b>: Keep;

    /// What tells it within an instance of a geometry. Hits that do not count are added to the number.
    fn within<'b>(
        scene: &'b BuiltScene,
        of: (GeometryId, InstanceId),
        options: &'b SceneOptions<'b>,
        rejected: &'b Cell<u64>,
    ) -> Self::Keep<'b>;

    /// The hit that is the answer, given the first one of a ray that is not traced in steps.
    fn settle(
        keep: Self::Keep<'_>,
        scene: &BuiltScene,
        geometry: GeometryId,
        ray: &Ray,
        first: Hit,
        query: (&QueryOptions<'_>, Query),
    ) -> Hit;
}

/// All hits count.
pub(super) struct EveryHit;

impl Counting for EveryHit {
    type Keep<'b> = KeepAll;

    #[inline(always)]
    fn within<'b>(
        _: &'b BuiltScene,
        _: (GeometryId, InstanceId),
        _: &'b SceneOptions<'b>,
        _: &'b Cell<u64>,
    ) -> KeepAll {
        KeepAll
    }

    #[inline(always)]
    fn settle(
        _: KeepAll,
        _: &BuiltScene,
        _: GeometryId,
        _: &Ray,
        first: Hit,
        _: (&QueryOptions<'_>, Query),
    ) -> Hit {
        first
    }
}

/// Those that the filter keeps, in parts of triangles that are opaque.
pub(super) struct KeptHits;

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

impl Counting for KeptHits {
    type Keep<'b> = KeepSome<'b>;

    fn within<'b>(
        scene: &'b BuiltScene,
        (geometry, instance): (GeometryId, InstanceId),
        options: &'b SceneOptions<'b>,
        rejected: &'b Cell<u64>,
    ) -> KeepSome<'b> {
        let built = scene.geometry(geometry);
        let kept = built.and_then(|built| built.kept(geometry, instance, options));
        KeepSome { kept, rejected }
    }

    fn settle(
        KeepSome { kept, rejected }: KeepSome<'_>,
        scene: &BuiltScene,
        geometry: GeometryId,
        ray: &Ray,
        first: Hit,
        query: (&QueryOptions<'_>, Query),
    ) -> Hit {
        let (Some(kept), Some(built)) = (kept, scene.geometry(geometry)) else { return first };
        let mut more = 0;
        let hit = kept.next(built, ray, first, query, &mut more);
        rejected.set(rejected.get() + more);
        hit
    }
}

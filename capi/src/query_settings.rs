//! The settings of a query, checked: what it does not use has to be what it is by default.

use library::objects::{
    Filter, IgnoredTriangle, InstanceId, SceneAllHitsOptions, SceneClosestPointOptions,
    SceneOptions, SceneOverlapOptions,
};
use library::{
    Accuracy as LibraryAccuracy, AllHitsOptions, CastOptions, ClosestPointOptions,
    Culling as LibraryCulling, LocateOptions, OverlapOptions, QueryOptions as LibraryQueryOptions,
    Watch,
};

use crate::filter::{HitFilter, PointFilter};
use crate::options::{
    ACCURACIES, CULLINGS, NONE, QUERY_DEFAULTS, QueryOptions, chosen, limit, reserved, settings,
};
use crate::progress::{Caller, caller};
use crate::status::{Failure, Status};

/// What a query uses of its settings, besides progress and threads.
#[derive(Clone, Copy)]
pub(crate) struct Uses {
    pub(crate) accuracy: bool,
    pub(crate) culling: bool,
    pub(crate) ignore: bool,
    pub(crate) instances: bool,
    pub(crate) max_distance: bool,
    pub(crate) max_memory: bool,
    /// The filter of hits.
    pub(crate) filter: bool,
    pub(crate) point_filter: bool,
}

impl Uses {
    const NOTHING: Uses = Uses {
        accuracy: false,
        culling: false,
        ignore: false,
        instances: false,
        max_distance: false,
        max_memory: false,
        filter: false,
        point_filter: false,
    };
    pub(crate) const HITS: Uses =
        Uses { accuracy: true, culling: true, ignore: true, ..Uses::NOTHING };
    pub(crate) const ALL_HITS: Uses =
        Uses { culling: true, ignore: true, max_memory: true, ..Uses::NOTHING };
    pub(crate) const LOCATE: Uses = Uses { max_memory: true, ..Uses::NOTHING };
    pub(crate) const CLOSEST_POINTS: Uses =
        Uses { accuracy: true, ignore: true, max_distance: true, ..Uses::NOTHING };
    pub(crate) const SIGNED: Uses = Uses { max_memory: true, ..Uses::NOTHING };
    pub(crate) const POINTS: Uses =
        Uses { max_distance: true, max_memory: true, point_filter: true, ..Uses::NOTHING };
    pub(crate) const SCENE_HITS: Uses = Uses { instances: true, filter: true, ..Uses::HITS };
    pub(crate) const SCENE_ALL_HITS: Uses =
        Uses { instances: true, filter: true, ..Uses::ALL_HITS };
    pub(crate) const COMPLETE: Uses = Uses::NOTHING;
    pub(crate) const OVERLAPS: Uses = Uses { ignore: true, max_memory: true, ..Uses::NOTHING };
    pub(crate) const OVERLAPS_ANY: Uses = Uses { ignore: true, ..Uses::NOTHING };
    pub(crate) const IMPACTS: Uses = Uses { ignore: true, ..Uses::NOTHING };
    pub(crate) const SCENE_OVERLAPS: Uses = Uses { instances: true, ..Uses::OVERLAPS };
    pub(crate) const SCENE_OVERLAPS_ANY: Uses = Uses { instances: true, ..Uses::OVERLAPS_ANY };
    pub(crate) const SCENE_CLOSEST_POINTS: Uses = Uses { instances: true, ..Uses::CLOSEST_POINTS };
}

/// The settings of a query, checked.
pub(crate) struct Query {
    accuracy: LibraryAccuracy,
    culling: LibraryCulling,
    mask: u32,
    ignore: Option<u32>,
    ignore_instance: Option<u32>,
    pub(crate) max_distance: f32,
    pub(crate) max_memory: Option<u64>,
    pub(crate) caller: Option<Caller>,
    filter: Option<HitFilter>,
    pub(crate) point_filter: Option<PointFilter>,
    pub(crate) threads: u32,
}

impl Query {
    /// # Safety
    /// See [`settings`].
    pub(crate) unsafe fn read(options: *const QueryOptions, uses: Uses) -> Result<Query, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { settings(options, QUERY_DEFAULTS)? };
        reserved(own.reserved)?;
        let standard = QUERY_DEFAULTS;
        let limited = own.max_distance != standard.max_distance;
        for (used, changed, name) in [
            (uses.accuracy, own.accuracy != standard.accuracy, "accuracy"),
            (uses.culling, own.culling != standard.culling, "culling"),
            (uses.instances, own.mask != standard.mask, "mask"),
            (uses.ignore, own.ignore_triangle != NONE, "ignore_triangle"),
            (uses.instances && uses.ignore, own.ignore_instance != NONE, "ignore_instance"),
            (uses.max_distance, limited, "max_distance"),
            (uses.max_memory, own.max_memory != 0, "max_memory"),
            (uses.filter, own.filter.is_some(), "filter"),
            (uses.point_filter, own.point_filter.is_some(), "point_filter"),
            (uses.filter || uses.point_filter, !own.filter_user.is_null(), "filter_user"),
        ] {
            if changed && !used {
                let text = format!("options: `{name}` means nothing for this call");
                return Err(Failure::new(Status::Option, text));
            }
        }
        if own.max_distance.is_nan() {
            return Err(Failure::new(Status::Option, "options: `max_distance` is NaN"));
        }
        let accuracy = chosen(own.accuracy, &ACCURACIES, "accuracy")?;
        let culling = chosen(own.culling, &CULLINGS, "culling")?;
        let [ignore, ignore_instance] = [own.ignore_triangle, own.ignore_instance]
            .map(|number| Some(number).filter(|&n| n != NONE));
        if uses.instances && ignore.is_some() != ignore_instance.is_some() {
            let text =
                "options: a triangle to ignore needs its instance too, and the other way round";
            return Err(Failure::new(Status::Option, text));
        }
        Ok(Query {
            accuracy,
            culling,
            mask: own.mask,
            ignore,
            ignore_instance,
            max_distance: own.max_distance,
            max_memory: limit(own.max_memory),
            caller: caller(own.progress, own.user),
            filter: HitFilter::of(own.filter, own.filter_user),
            point_filter: PointFilter::of(own.point_filter, own.filter_user),
            threads: own.threads,
        })
    }

    pub(crate) fn hits<'a>(&self, watch: Option<&'a dyn Watch>) -> LibraryQueryOptions<'a> {
        let Query { accuracy, culling, ignore, .. } = *self;
        LibraryQueryOptions { accuracy, culling, ignore, watch, ..LibraryQueryOptions::default() }
    }

    pub(crate) fn all_hits<'a>(&self, watch: Option<&'a dyn Watch>) -> AllHitsOptions<'a> {
        let Query { culling, ignore, max_memory, .. } = *self;
        AllHitsOptions { culling, ignore, max_memory, watch }
    }

    pub(crate) fn locate<'a>(&self, watch: Option<&'a dyn Watch>) -> LocateOptions<'a> {
        LocateOptions { max_memory: self.max_memory, watch }
    }

    pub(crate) fn closest<'a>(&self, watch: Option<&'a dyn Watch>) -> ClosestPointOptions<'a> {
        let Query { accuracy, max_distance, ignore, .. } = *self;
        ClosestPointOptions { max_distance, accuracy, ignore, watch }
    }

    pub(crate) fn overlaps<'a>(&self, watch: Option<&'a dyn Watch>) -> OverlapOptions<'a> {
        OverlapOptions { ignore: self.ignore, max_memory: self.max_memory, watch }
    }

    pub(crate) fn impacts<'a>(&self, watch: Option<&'a dyn Watch>) -> CastOptions<'a> {
        CastOptions { ignore: self.ignore, watch }
    }

    pub(crate) fn scene_overlaps<'a>(
        &self,
        watch: Option<&'a dyn Watch>,
    ) -> SceneOverlapOptions<'a> {
        let Query { mask, max_memory, .. } = *self;
        SceneOverlapOptions { mask, ignore: self.ignored(), max_memory, watch }
    }

    fn ignored(&self) -> Option<IgnoredTriangle> {
        let (instance, triangle) = (InstanceId(self.ignore_instance?), self.ignore?);
        Some(IgnoredTriangle { instance, triangle })
    }

    pub(crate) fn scene_hits<'a>(&'a self, watch: Option<&'a dyn Watch>) -> SceneOptions<'a> {
        let Query { accuracy, culling, mask, .. } = *self;
        let filter = self.filter.as_ref().map(|filter| -> &dyn Filter { filter });
        SceneOptions { accuracy, culling, mask, ignore: self.ignored(), filter, watch }
    }

    pub(crate) fn scene_all_hits<'a>(
        &'a self,
        watch: Option<&'a dyn Watch>,
    ) -> SceneAllHitsOptions<'a> {
        SceneAllHitsOptions { query: self.scene_hits(watch), max_memory: self.max_memory }
    }

    pub(crate) fn scene_closest<'a>(
        &self,
        watch: Option<&'a dyn Watch>,
    ) -> SceneClosestPointOptions<'a> {
        let Query { accuracy, max_distance, mask, .. } = *self;
        let ignore = self.ignored();
        SceneClosestPointOptions { max_distance, accuracy, mask, ignore, watch }
    }
}

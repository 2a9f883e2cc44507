//! Which hits count: all of them, but where a query of a scene has a filter or a geometry an opacity mask.

use splitplane_core::ray::Hit;

/// Decides which hits count.
pub(crate) trait Keep: Copy {
    /// Whether all do, so that nothing is asked.
    const ALL: bool;

    /// Whether a hit counts. It is asked of hits that would be the best so far, and has all their parts.
    fn keeps(self, hit: &Hit) -> bool;
}

/// All hits count.
#[derive(Clone, Copy)]
pub(crate) struct KeepAll;

impl Keep for KeepAll {
    const ALL: bool = true;

    #[inline(always)]
    fn keeps(self, _: &Hit) -> bool {
        true
    }
}

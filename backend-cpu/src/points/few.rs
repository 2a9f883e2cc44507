//! The eight least keys of a search.

use splitplane_core::points::distance::NOTHING;

use super::search::Visitor;
use crate::simd::{LeastKeys, Simd};

/// Up to so many points are kept by vectors.
pub(super) const FEW: usize = 8;

/// Keeps the eight least keys, of which only the first `k` count.
#[derive(Clone, Copy)]
pub(super) struct Few {
    keys: LeastKeys,
    last: usize,
}

impl Few {
    /// For k keys, 1 to 8, below `stop`.
    pub(super) fn new(k: usize, stop: u64) -> Few {
        Few { keys: LeastKeys([stop.min(NOTHING); FEW]), last: k - 1 }
    }

    /// The k least keys, in order; those after the last one are what keys had to be below.
    pub(super) fn keys(&self) -> &[u64] {
        &self.keys.0[..=self.last]
    }
}

impl Visitor for Few {
    #[inline(always)]
    fn stop(&self) -> u64 {
        self.keys.0[self.last]
    }
    fn visit(&mut self, _: u64) {}
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn visit_lanes<S: Simd>(
        &mut self,
        distances: *const f32,
        points: *const u32,
        near: u32,
    ) {
        // SAFETY: the caller's contract. Distances are not negative.
        unsafe { S::keep_least(&mut self.keys, distances, points, near) }
    }
}

//! Functions of the caller's that reject hits and points.

use std::ffi::c_void;

use library::objects::{Filter, SceneHit as HitOfScene};

use crate::options::{FilterFunction, PointFilterFunction};
use crate::record::SceneHit;

/// Decides which hits count.
#[derive(Clone, Copy)]
pub(crate) struct HitFilter {
    function: unsafe extern "C" fn(*mut c_void, *const SceneHit) -> i32,
    user: *mut c_void,
}

// SAFETY: the function may be called from any thread, by several at a time, as its documentation says.
unsafe impl Send for HitFilter {}
// SAFETY: as above.
unsafe impl Sync for HitFilter {}

impl HitFilter {
    pub(crate) fn of(function: FilterFunction, user: *mut c_void) -> Option<HitFilter> {
        function.map(|function| HitFilter { function, user })
    }
}

impl Filter for HitFilter {
    fn keeps(&self, hit: &HitOfScene) -> bool {
        // SAFETY: both records are one in memory; the caller of the entry vouches for the function.
        unsafe { (self.function)(self.user, (&raw const *hit).cast()) != 0 }
    }
}

/// Decides which points count.
#[derive(Clone, Copy)]
pub(crate) struct PointFilter {
    function: unsafe extern "C" fn(*mut c_void, u32) -> i32,
    user: *mut c_void,
}

// SAFETY: the function may be called from any thread, by several at a time, as its documentation says.
unsafe impl Send for PointFilter {}
// SAFETY: as above.
unsafe impl Sync for PointFilter {}

impl PointFilter {
    pub(crate) fn of(function: PointFilterFunction, user: *mut c_void) -> Option<PointFilter> {
        function.map(|function| PointFilter { function, user })
    }

    pub(crate) fn keeps(&self, point: u32) -> bool {
        // SAFETY: the caller of the entry vouches for the function.
        unsafe { (self.function)(self.user, point) != 0 }
    }
}

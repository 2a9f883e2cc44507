//! A number of each ray of a group.

use crate::simd::{MOST_LANES, Simd};

/// A number of each ray.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct GroupRow(pub(crate) [f32; MOST_LANES]);

pub(super) const ZERO: GroupRow = GroupRow([0.0; MOST_LANES]);

/// # Safety
/// The processor must have the set.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn load<S: Simd>(row: &GroupRow) -> S::Floats {
    // SAFETY: the caller has the set; rows are of the most lanes.
    unsafe { S::load(row.0.as_ptr()) }
}

/// # Safety
/// As for [`load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn store<S: Simd>(row: &mut GroupRow, x: S::Floats) {
    // SAFETY: as above.
    unsafe { S::store(row.0.as_mut_ptr(), x) }
}

/// # Safety
/// As for [`load`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) unsafe fn put<S: Simd>(mask: S::Mask, row: &mut GroupRow, x: S::Floats) {
    // SAFETY: as above.
    unsafe { store::<S>(row, S::select(mask, x, load::<S>(row))) }
}

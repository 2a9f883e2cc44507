//! Writing to one slice from many tasks, each to places of its own.

use core::marker::PhantomData;

/// A mutable slice that several tasks may write to at once, each to elements that no other touches.
///
/// The builder's kernels know from exclusive scans which elements belong to which chunk; a borrow
/// checker cannot see that, hence the `unsafe` of the two accessors.
#[derive(Clone, Copy)]
pub(crate) struct Scatter<'a, T> {
    start: *mut T,
    length: usize,
    borrow: PhantomData<&'a mut [T]>,
}

// SAFETY: a `Scatter` is a mutable borrow of `[T]` that is handed out in disjoint parts; sending the
// parts to other threads is as safe as sending `&mut T`.
unsafe impl<T: Send> Send for Scatter<'_, T> {}
// SAFETY: as above; a shared `Scatter` gives access only through `unsafe` methods whose contract
// demands disjoint elements.
unsafe impl<T: Send> Sync for Scatter<'_, T> {}

impl<'a, T> Scatter<'a, T> {
    /// Borrows a slice for scattered writing.
    pub(crate) fn new(slice: &'a mut [T]) -> Scatter<'a, T> {
        Scatter { start: slice.as_mut_ptr(), length: slice.len(), borrow: PhantomData }
    }

    /// Part of the slice.
    ///
    /// # Safety
    /// While the part is borrowed, no other access may touch any element of it.
    ///
    /// # Panics
    /// If the part reaches beyond the slice.
    #[allow(clippy::mut_from_ref, reason = "disjointness is the caller's contract")]
    pub(crate) unsafe fn part(&self, first: usize, count: usize) -> &mut [T] {
        assert!(
            first <= self.length && count <= self.length - first,
            "part {first}+{count} of {}",
            self.length
        );
        // SAFETY: in range by the check above, not aliased by the caller's contract, and the borrow
        // cannot outlive the slice because of `'a`.
        unsafe { core::slice::from_raw_parts_mut(self.start.add(first), count) }
    }
}

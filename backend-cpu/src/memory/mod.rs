//! Memory: bytes counted against a limit, allocations that report failure, and vectors that are filled by all threads.

mod scatter;

use core::mem::MaybeUninit;
use std::collections::TryReserveError;

use splitplane_core::error::BuildError;

use crate::cancel::{ProgressMeter, UNWATCHED};
use crate::parallel::{Parallel, ParallelSlice};
use crate::span;

pub(crate) use scatter::Scatter;

/// Counts bytes against a limit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    /// Bytes held now.
    pub held: u64,
    /// Most bytes held so far.
    pub peak: u64,
    /// The limit, if any.
    pub limit: Option<u64>,
}

impl Memory {
    /// Accounts for `bytes` more.
    ///
    /// # Errors
    /// More than the limit.
    pub fn take(&mut self, bytes: u64) -> Result<(), BuildError> {
        let needed = self.held + bytes;
        if let Some(limit) = self.limit
            && needed > limit
        {
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        self.held = needed;
        self.peak = self.peak.max(needed);
        Ok(())
    }

    /// Makes a vector at least `length` long. What it held may be lost: callers write all they read.
    ///
    /// # Errors
    /// More memory than the limit allows, or than there is.
    pub fn grow<T: bytemuck::Zeroable + Clone + Send + Sync>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        self.grow_watched(vector, length, &UNWATCHED)
    }

    /// As [`Memory::grow`]; new memory takes time to clear, and the watch may cancel it.
    pub(crate) fn grow_watched<T: bytemuck::Zeroable + Clone + Send + Sync>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
        meter: &ProgressMeter<'_>,
    ) -> Result<(), BuildError> {
        if vector.len() >= length {
            return Ok(());
        }
        self.make_room(vector, length)?;
        resize(meter, vector, length, &T::zeroed());
        meter.check()
    }

    /// Accounts for space for `length` elements in all, and makes it.
    ///
    /// # Errors
    /// More memory than the limit allows, or than there is; the vector is then what it was.
    pub(crate) fn make_room<T>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        let more = length.saturating_sub(vector.capacity());
        self.take((more * size_of::<T>()) as u64)?;
        self.reserve(vector, length)
    }

    /// As [`Memory::make_room`], for lists that grow step by step: a capacity that is too small is
    /// at least doubled.
    ///
    /// # Errors
    /// As for [`Memory::make_room`].
    pub(crate) fn double_room<T>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        if length <= vector.capacity() {
            return Ok(());
        }
        self.make_room(vector, length.max(2 * vector.capacity()))
    }

    /// Makes space for exactly `length` elements in all, which has been accounted for.
    ///
    /// # Errors
    /// More memory than there is; the vector is then what it was.
    pub(crate) fn reserve<T>(&self, vector: &mut Vec<T>, length: usize) -> Result<(), BuildError> {
        let more = length.saturating_sub(vector.len());
        vector.try_reserve_exact(more).map_err(|_| self.lacking())
    }

    /// The error where the system has less memory than what is accounted for.
    pub(crate) fn lacking(&self) -> BuildError {
        BuildError::OutOfMemory { needed: self.held, limit: self.held }
    }
}

/// As [`Box::new`], with an error in place of an abort where there is no memory.
///
/// # Errors
/// Not enough memory.
pub(crate) fn boxed<T>(make: impl FnOnce() -> T) -> Result<Box<T>, TryReserveError> {
    let mut one = Vec::new();
    one.try_reserve_exact(1)?;
    one.push(make());
    let one = Box::into_raw(one.into_boxed_slice());
    // SAFETY: a slice of one element has the layout of the element.
    Ok(unsafe { Box::from_raw(one.cast::<T>()) })
}

/// Capacity of a vector in bytes.
pub(crate) fn bytes_of<T>(vector: &Vec<T>) -> u64 {
    (vector.capacity() * size_of::<T>()) as u64
}

/// Makes a list at least `length` long.
///
/// # Errors
/// Less memory than that.
pub(crate) fn lengthen<T: Copy>(
    list: &mut Vec<T>,
    length: usize,
    filler: T,
) -> Result<(), TryReserveError> {
    if list.len() < length {
        list.try_reserve_exact(length - list.len())?;
        list.resize(length, filler);
    }
    Ok(())
}

/// Elements that are cleared between two calls of the watch.
const PIECE: usize = 1 << 15;

/// [`Vec::resize`] for vectors that have the capacity, by all threads, since most of the time is
/// spent in the system's page allocation. With a watch it works piece by piece. Ends early when the
/// work is cancelled.
pub(crate) fn resize<T: Clone + Send + Sync>(
    meter: &ProgressMeter<'_>,
    vector: &mut Vec<T>,
    length: usize,
    value: &T,
) {
    if !meter.is_watched() && vector.len() < length {
        let more = length - vector.len();
        let room = &mut vector.spare_capacity_mut()[..more];
        let pieces = room.len().div_ceil(PIECE);
        let fill = |room: &mut [MaybeUninit<T>]| {
            for element in room {
                element.write(value.clone());
            }
        };
        span::evenly(pieces, || room.par_chunks_mut(PIECE).for_each(fill));
        // SAFETY: all of them were written.
        unsafe { vector.set_len(length) };
    }
    while vector.len() < length {
        let next = length.min(vector.len() + PIECE);
        let references = (next - vector.len()) * size_of::<T>() / 32;
        vector.resize(next, value.clone());
        if meter.record_work(references as u64) {
            return;
        }
    }
    vector.truncate(length);
}

/// Appends all of a slice, as [`resize`] does with one value. Ends early when the work is cancelled.
pub(crate) fn extend<T: Copy + Send + Sync>(
    meter: &ProgressMeter<'_>,
    vector: &mut Vec<T>,
    slice: &[T],
) {
    if !meter.is_watched() {
        vector.reserve(slice.len());
        let all = vector.len() + slice.len();
        let room = &mut vector.spare_capacity_mut()[..slice.len()];
        let pieces = room.par_chunks_mut(PIECE).zip(slice.par_chunks(PIECE));
        let copy = |(room, piece): (&mut [MaybeUninit<T>], &[T])| {
            for (element, value) in room.iter_mut().zip(piece) {
                element.write(*value);
            }
        };
        span::evenly(slice.len().div_ceil(PIECE), || pieces.for_each(copy));
        // SAFETY: all of them were written.
        unsafe { vector.set_len(all) };
        return;
    }
    for piece in slice.chunks(PIECE) {
        vector.extend_from_slice(piece);
        if meter.record_work((size_of_val(piece) / 32) as u64) {
            return;
        }
    }
}

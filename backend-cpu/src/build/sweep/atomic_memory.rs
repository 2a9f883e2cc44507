//! Bytes counted against a limit, from many threads.

use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;
use splitplane_core::error::BuildError;

use crate::memory::Memory;

/// [`Memory`] that threads share. Which of them exceeds the limit first may differ from run to run.
/// Exceeding it ends the build, so no tree depends on it.
#[derive(Debug)]
pub(super) struct AtomicMemory {
    held: AtomicU64,
    peak: AtomicU64,
    limit: Option<u64>,
}

impl AtomicMemory {
    /// Continues the count of `memory`.
    pub(super) fn new(memory: Memory) -> AtomicMemory {
        AtomicMemory {
            held: AtomicU64::new(memory.held),
            peak: AtomicU64::new(memory.peak),
            limit: memory.limit,
        }
    }

    /// The bytes counted so far.
    pub(super) fn total(&self) -> Memory {
        Memory { held: self.held.load(Relaxed), peak: self.peak.load(Relaxed), limit: self.limit }
    }

    /// Accounts for `bytes` more.
    ///
    /// # Errors
    /// More than the limit.
    pub(super) fn take(&self, bytes: u64) -> Result<(), BuildError> {
        let needed = self.held.fetch_add(bytes, Relaxed) + bytes;
        if let Some(limit) = self.limit
            && needed > limit
        {
            self.held.fetch_sub(bytes, Relaxed);
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        self.peak.fetch_max(needed, Relaxed);
        Ok(())
    }

    /// Makes space for `more` elements after those of a vector; at least doubles its capacity, so
    /// that growing piece by piece costs no more than growing at once.
    ///
    /// # Errors
    /// More memory than the limit allows, or than there is.
    pub(super) fn reserve<T>(&self, vector: &mut Vec<T>, more: usize) -> Result<(), BuildError> {
        let (before, needed) = (vector.capacity(), vector.len() + more);
        if needed <= before {
            return Ok(());
        }
        let size = size_of::<T>() as u64;
        let mut wanted = needed.max(before * 2);
        if self.take((wanted - before) as u64 * size).is_err() {
            // What is needed may fit where twice as much does not.
            wanted = needed;
            self.take((wanted - before) as u64 * size)?;
        }
        vector.try_reserve_exact(wanted - vector.len()).map_err(|_| self.lacking())
    }

    /// The same without more than that: for lists that seldom grow.
    ///
    /// # Errors
    /// As for [`AtomicMemory::reserve`].
    pub(super) fn reserve_exactly<T>(
        &self,
        vector: &mut Vec<T>,
        more: usize,
    ) -> Result<(), BuildError> {
        let needed = (vector.len() + more).saturating_sub(vector.capacity());
        self.take((needed * size_of::<T>()) as u64)?;
        vector.try_reserve_exact(more).map_err(|_| self.lacking())
    }

    /// A list with capacity for `length` elements that is dropped before its creator returns:
    /// kilobytes, which do not count.
    ///
    /// # Errors
    /// Less memory than that.
    pub(super) fn temporary<T>(&self, length: usize) -> Result<Vec<T>, BuildError> {
        let mut list = Vec::new();
        list.try_reserve_exact(length).map_err(|_| self.lacking())?;
        Ok(list)
    }

    /// The error where the system has less memory than what is accounted for.
    pub(super) fn lacking(&self) -> BuildError {
        let held = self.held.load(Relaxed);
        BuildError::OutOfMemory { needed: held, limit: held }
    }
}

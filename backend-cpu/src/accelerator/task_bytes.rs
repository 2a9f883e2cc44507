//! The memory of queries that take long and give more than a hit: small tasks, which share a limit.

use core::sync::atomic::AtomicU64;
use core::sync::atomic::Ordering::Relaxed;

use splitplane_core::error::{QueryError, check_bytes};

/// Rays of one task of all hits, and points of one task, which take longer and give more.
pub(super) const FEW: usize = 64;

/// A task's share of the bytes that all tasks of a batch hold.
pub(super) struct TaskBytes<'a> {
    pub(super) held: &'a AtomicU64,
    pub(super) own: u64,
    pub(super) max_memory: Option<u64>,
}

impl TaskBytes<'_> {
    /// From now on the task holds `bytes` bytes.
    ///
    /// # Errors
    /// [`QueryError::OutOfMemory`] when all tasks together hold more than allowed.
    pub(super) fn hold(&mut self, bytes: u64) -> Result<(), QueryError> {
        if bytes == self.own {
            return Ok(());
        }
        let difference = bytes.wrapping_sub(self.own);
        self.own = bytes;
        let all = self.held.fetch_add(difference, Relaxed).wrapping_add(difference);
        check_bytes(all, self.max_memory)
    }
}

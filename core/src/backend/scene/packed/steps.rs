//! Steps of long work, counted, with a look at the watch between every few of them.

use super::sizes::Unpackable;
use crate::cancel::go_on;
use crate::error::BuildError;
use crate::watch::{Progress, Watch};

/// Steps between two calls of the watch: a step is a few nanoseconds, so that is a fraction of a millisecond.
pub(super) const STEPS: u64 = 1 << 14;

/// Counts steps, and calls a watch between every [`STEPS`] of them.
pub(super) struct Steps<'a> {
    watch: Option<&'a dyn Watch>,
    progress: Progress,
    taken: u64,
}

impl<'a> Steps<'a> {
    /// `progress` is what the watch is told.
    pub(super) fn new(watch: Option<&'a dyn Watch>, progress: Progress) -> Steps<'a> {
        Steps { watch, progress, taken: 0 }
    }

    /// So many steps are taken, or are about to be.
    ///
    /// # Errors
    /// A watch that cancels the work.
    #[inline]
    pub(super) fn take(&mut self, steps: u64) -> Result<(), Unpackable> {
        let before = self.taken / STEPS;
        self.taken += steps;
        if self.taken / STEPS == before {
            return Ok(());
        }
        go_on(self.watch, self.progress).map_err(|error| match error {
            BuildError::Cancelled { progress } => Unpackable::Cancelled { progress },
            _ => Unpackable::Cancelled { progress: self.progress },
        })
    }

    /// How many were taken.
    #[cfg(test)]
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }
}

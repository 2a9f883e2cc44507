//! What may end a build early: a limit of memory, and a watch.

use alloc::vec::Vec;

use bytemuck::Zeroable;

use crate::cancel::go_on;
use crate::error::BuildError;
use crate::watch::{Progress, Stage, Watch};

/// The memory and the progress of a build: the one is compared with a limit, the other reported to
/// a watch.
pub struct Budget<'w> {
    held: u64,
    peak: u64,
    limit: Option<u64>,
    watch: Option<&'w dyn Watch>,
    progress: Progress,
    /// Work since the last call of the watch, in references read and written once.
    work: u64,
}

/// References read and written between two calls of the watch: some tenths of a millisecond.
const DUE: u64 = 1 << 13;

/// Bytes that can be cleared in the time of reading and writing one reference.
const CLEARED: usize = 32;

impl core::fmt::Debug for Budget<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Budget { held, peak, limit, progress, .. } = self;
        let mut out = f.debug_struct("Budget");
        out.field("held", held).field("peak", peak).field("limit", limit);
        out.field("progress", progress).finish_non_exhaustive()
    }
}

impl Default for Budget<'_> {
    /// No limit and no watch.
    fn default() -> Self {
        Budget::new(None, None)
    }
}

impl<'w> Budget<'w> {
    /// A budget of at most `limit` bytes at once, if there is a limit. The watch, if there is one,
    /// may cancel the work.
    pub fn new(limit: Option<u64>, watch: Option<&'w dyn Watch>) -> Budget<'w> {
        let progress = Progress { stage: Stage::Start, done: 0, total: 0 };
        Budget { held: 0, peak: 0, limit, watch, progress, work: 0 }
    }

    /// Most bytes held so far.
    pub fn peak(&self) -> u64 {
        self.peak
    }

    /// Makes a vector at least `length` long. New elements are zero.
    ///
    /// # Errors
    /// [`BuildError::OutOfMemory`] for more memory than the limit allows or the system has, and
    /// [`BuildError::Cancelled`] by the watch.
    pub fn grow<T: Zeroable + Clone>(
        &mut self,
        vector: &mut Vec<T>,
        length: usize,
    ) -> Result<(), BuildError> {
        let more = length.saturating_sub(vector.capacity()).saturating_mul(size_of::<T>());
        let needed = self.held.saturating_add(more as u64);
        if let Some(limit) = self.limit.filter(|&limit| needed > limit) {
            return Err(BuildError::OutOfMemory { needed, limit });
        }
        let refused = |_| BuildError::OutOfMemory { needed, limit: needed };
        vector.try_reserve_exact(length.saturating_sub(vector.len())).map_err(refused)?;
        self.held = needed;
        self.peak = self.peak.max(needed);
        // In pieces, since clearing much memory takes time.
        let piece = (DUE as usize * CLEARED / size_of::<T>().max(1)).max(1);
        while vector.len() < length {
            let next = length.min(vector.len() + piece);
            let bytes = (next - vector.len()) * size_of::<T>();
            vector.resize(next, T::zeroed());
            self.worked((bytes / CLEARED) as u64)?;
        }
        Ok(())
    }

    /// Begins a stage and reports it to the watch; `total` is 0 where it is not known.
    ///
    /// # Errors
    /// [`BuildError::Cancelled`] by the watch. So everywhere below.
    pub fn begin(&mut self, stage: Stage, total: u64) -> Result<(), BuildError> {
        self.progress = Progress { stage, done: 0, total };
        self.ask()
    }

    /// Adds to the progress of the stage, in its unit. The watch receives it at its next call.
    pub fn advance(&mut self, done: u64) {
        self.progress.done += done;
    }

    /// Records work that took as long as reading and writing this many references. Calls the watch
    /// when it is due.
    ///
    /// # Errors
    /// As for [`Budget::begin`].
    pub fn worked(&mut self, references: u64) -> Result<(), BuildError> {
        self.work += references;
        if self.work < DUE {
            return Ok(());
        }
        self.work = 0;
        self.ask()
    }

    /// Ends a stage and reports it to the watch.
    ///
    /// # Errors
    /// As for [`Budget::begin`].
    pub fn finish(&mut self) -> Result<(), BuildError> {
        self.progress.done = self.progress.done.max(self.progress.total);
        self.ask()
    }

    fn ask(&self) -> Result<(), BuildError> {
        go_on(self.watch, self.progress)
    }
}

#[cfg(test)]
mod tests {
    use core::ops::ControlFlow;
    use core::sync::atomic::AtomicU64;
    use core::sync::atomic::Ordering::Relaxed;

    use super::*;

    /// Lets work continue this many times.
    struct Times(AtomicU64);

    impl Watch for Times {
        fn progress(&self, _: &Progress) -> ControlFlow<()> {
            match self.0.fetch_sub(1, Relaxed) {
                1 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        }
    }

    #[test]
    fn the_limit_counts_what_is_held_at_once() {
        let mut budget = Budget::new(Some(100), None);
        let (mut a, mut b) = (Vec::<u32>::new(), Vec::<u64>::new());
        assert_eq!(budget.grow(&mut a, 10), Ok(()));
        assert_eq!(budget.grow(&mut a, 5), Ok(()), "it is longer already");
        assert_eq!((a.len(), budget.peak()), (10, 40));
        let refused = BuildError::OutOfMemory { needed: 104, limit: 100 };
        assert_eq!(budget.grow(&mut b, 8), Err(refused));
        assert_eq!((b.len(), budget.peak()), (0, 40), "nothing was taken");
        assert_eq!(budget.grow(&mut b, 7), Ok(()));
        assert_eq!((b, budget.peak()), ([0; 7].to_vec(), 96));
    }

    #[test]
    fn more_memory_than_there_is_ends_in_an_error() {
        let mut vector = Vec::<u64>::new();
        let refused = Budget::default().grow(&mut vector, usize::MAX / 8);
        assert!(
            matches!(refused, Err(BuildError::OutOfMemory { needed, limit }) if needed == limit)
        );
    }

    #[test]
    fn the_watch_is_asked_when_work_is_due_and_ends_it() {
        let watch = Times(AtomicU64::new(3));
        let mut budget = Budget::new(None, Some(&watch));
        assert_eq!(budget.begin(Stage::SmallNodes, 7), Ok(()));
        for _ in 0..4 {
            assert_eq!(budget.worked(DUE / 4), Ok(()));
        }
        assert_eq!(watch.0.load(Relaxed), 1, "asked twice");
        budget.advance(5);
        let progress = Progress { stage: Stage::SmallNodes, done: 5, total: 7 };
        assert_eq!(budget.worked(DUE), Err(BuildError::Cancelled { progress }));
    }
}

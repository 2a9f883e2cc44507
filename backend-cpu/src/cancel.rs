//! Progress and cancellation of one build or batch, shared by the threads that work on it.

use core::ops::ControlFlow;
use core::sync::atomic::Ordering::Relaxed;
use core::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use splitplane_core::error::{BuildError, QueryError};
use splitplane_core::watch::{Progress, Stage, Watch};

/// Work between two calls of the watch, in references read and written once: some tenths of a millisecond of one
/// thread, and less where several threads share the work.
pub(crate) const WORK_BETWEEN_CHECKS: u64 = 1 << 13;

/// Adds up the progress of all threads, reports it to a [`Watch`], and tells all threads when the watch has cancelled the
/// work.
///
/// One thread calls the watch at a time. A thread that would have to wait for another one's call
/// continues its work instead. So a watch that is slow, or that runs work of its own in the same
/// pool, delays no other thread, and `done` never decreases within a stage.
#[derive(Debug)]
pub(crate) struct ProgressMeter<'w> {
    /// Without a watch every call costs one test of this `Option`, about once every few hundred references.
    watch: Option<Watched<'w>>,
}

struct Watched<'w> {
    watch: &'w dyn Watch,
    /// Locked by the thread that calls the watch; poisoned when the watch panics.
    stage: Mutex<Progress>,
    done: AtomicU64,
    /// Work so far, in the unit of [`WORK_BETWEEN_CHECKS`].
    work: AtomicU64,
    is_cancelled: AtomicBool,
}

impl core::fmt::Debug for Watched<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Watched").field("stage", &self.stage).finish_non_exhaustive()
    }
}

/// The meter of work without a watch, which nothing cancels.
pub(crate) static UNWATCHED: ProgressMeter<'static> = ProgressMeter { watch: None };

impl<'w> ProgressMeter<'w> {
    /// A meter of work that may have a watch.
    pub(crate) fn of(watch: Option<&'w dyn Watch>) -> ProgressMeter<'w> {
        watch.map_or(ProgressMeter { watch: None }, ProgressMeter::new)
    }

    /// A meter that reports to this watch.
    pub(crate) fn new(watch: &'w dyn Watch) -> ProgressMeter<'w> {
        let nothing = Progress { stage: Stage::Start, done: 0, total: 0 };
        let watch = Watched {
            watch,
            stage: Mutex::new(nothing),
            done: AtomicU64::new(0),
            work: AtomicU64::new(0),
            is_cancelled: AtomicBool::new(false),
        };
        ProgressMeter { watch: Some(watch) }
    }

    /// Whether there is a watch.
    #[inline]
    pub(crate) fn is_watched(&self) -> bool {
        self.watch.is_some()
    }

    /// Whether the work was cancelled. Its result will not be used, so threads may leave it incomplete.
    #[inline]
    pub(crate) fn is_cancelled(&self) -> bool {
        self.watch.as_ref().is_some_and(|watched| watched.is_cancelled.load(Relaxed))
    }

    /// Begins a stage and reports it. `total` is 0 where the length of the stage is not known. No other thread may be
    /// working.
    pub(crate) fn begin_stage(&self, stage: Stage, total: u64) {
        if let Some(watched) = self.watch.as_ref().filter(|_| !self.is_cancelled()) {
            watched.done.store(0, Relaxed);
            let mut progress = watched.lock();
            *progress = Progress { stage, done: 0, total };
            watched.report(progress);
        }
    }

    /// Finishes the stage and reports it. No other thread may be working.
    pub(crate) fn finish_stage(&self) {
        if let Some(watched) = &self.watch {
            let progress = watched.lock();
            watched.done.fetch_max(progress.total, Relaxed);
            watched.report(progress);
        }
    }

    /// Adds to the progress of the stage, in its unit.
    #[inline]
    pub(crate) fn advance(&self, done: u64) {
        if let Some(watched) = &self.watch {
            watched.done.fetch_add(done, Relaxed);
        }
    }

    /// Records work, in references read and written once, and calls the watch when enough work was done since the last
    /// call. Returns whether the work was cancelled.
    #[inline]
    pub(crate) fn record_work(&self, references: u64) -> bool {
        self.watch.as_ref().is_some_and(|watched| watched.record_work(references))
    }

    /// [`BuildError::Cancelled`] when the work was cancelled.
    #[inline]
    pub(crate) fn check(&self) -> Result<(), BuildError> {
        match self.cancelled_at() {
            None => Ok(()),
            Some(progress) => Err(BuildError::Cancelled { progress }),
        }
    }

    /// [`QueryError::Cancelled`] when the work was cancelled.
    #[inline]
    pub(crate) fn check_batch(&self) -> Result<(), QueryError> {
        match self.cancelled_at() {
            None => Ok(()),
            Some(Progress { done, total, .. }) => Err(QueryError::Cancelled { done, total }),
        }
    }

    /// How far the work was when it was cancelled.
    #[inline]
    fn cancelled_at(&self) -> Option<Progress> {
        let watched = self.watch.as_ref()?;
        watched.is_cancelled.load(Relaxed).then(|| *watched.lock())
    }
}

impl Watched<'_> {
    #[cfg(not(all(target_family = "wasm", target_feature = "atomics")))]
    fn lock(&self) -> MutexGuard<'_, Progress> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A thread of WebAssembly that ends within the watch keeps the lock, since nothing unwinds. Who waited for it would hear nothing of that
    /// end, so it does the pool's work instead, in which it is told.
    #[cfg(all(target_family = "wasm", target_feature = "atomics"))]
    #[inline(never)]
    fn lock(&self) -> MutexGuard<'_, Progress> {
        loop {
            match self.stage.try_lock() {
                Ok(progress) => return progress,
                Err(TryLockError::Poisoned(error)) => return PoisonError::into_inner(error),
                Err(TryLockError::WouldBlock) => drop(rayon::yield_now()),
            }
        }
    }

    fn record_work(&self, references: u64) -> bool {
        let before = self.work.fetch_add(references, Relaxed);
        if before / WORK_BETWEEN_CHECKS != (before + references) / WORK_BETWEEN_CHECKS {
            match self.stage.try_lock() {
                Ok(progress) => self.report(progress),
                Err(TryLockError::WouldBlock) => {}
                // The watch has panicked on another thread, which passes the panic on to the
                // caller.
                Err(TryLockError::Poisoned(_)) => self.is_cancelled.store(true, Relaxed),
            }
        }
        self.is_cancelled.load(Relaxed)
    }

    /// Calls the watch, unless it has cancelled the work before.
    fn report(&self, mut progress: MutexGuard<'_, Progress>) {
        if self.is_cancelled.load(Relaxed) {
            return;
        }
        progress.done = self.done.load(Relaxed);
        if let ControlFlow::Break(()) = self.watch.progress(&progress) {
            self.is_cancelled.store(true, Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn one_thread_calls_at_a_time_and_none_after_the_break() {
        let (inside, calls) = (AtomicUsize::new(0), AtomicUsize::new(0));
        struct Strict<'a>(&'a AtomicUsize, &'a AtomicUsize);
        impl Watch for Strict<'_> {
            fn progress(&self, _progress: &Progress) -> ControlFlow<()> {
                assert_eq!(self.0.fetch_add(1, Relaxed), 0);
                let call = self.1.fetch_add(1, Relaxed) + 1;
                self.0.fetch_sub(1, Relaxed);
                if call == 50 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            }
        }
        let watch = Strict(&inside, &calls);
        let meter = ProgressMeter::new(&watch);
        meter.begin_stage(Stage::SmallNodes, 1000);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..1000 {
                        meter.advance(1);
                        meter.record_work(WORK_BETWEEN_CHECKS);
                    }
                });
            }
        });
        meter.finish_stage();
        assert_eq!(calls.load(Relaxed), 50);
        assert!(meter.is_cancelled());
        let Err(BuildError::Cancelled { progress }) = meter.check() else { panic!() };
        assert!(progress.stage == Stage::SmallNodes && progress.done < 4000);
    }
}

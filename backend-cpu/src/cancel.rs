//! One build or batch under a [`Watch`], seen from the threads that work on it.

use core::ops::ControlFlow;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use rayon::prelude::*;
use splitplane_core::backend::{BuildError, QueryError};
use splitplane_core::watch::{Progress, Stage, Watch};

/// Work between two looks at the watch, in references read and written once: some tenths of a
/// millisecond of one thread, and no more where several share the work.
pub(crate) const DUE: u64 = 1 << 13;

/// Asks a watch on behalf of all threads, one at a time, and tells them when it has ended the work.
///
/// A thread that would have to wait for another one's question goes on instead: so a watch that is slow,
/// or that runs work of its own in the same pool, holds up nobody else, and `done` never falls.
#[derive(Debug)]
pub(crate) struct Lookout<'w> {
    /// `None` costs a test of it, once every few hundred references.
    watch: Option<Watched<'w>>,
}

struct Watched<'w> {
    watch: &'w dyn Watch,
    /// Held by the thread that asks; poisoned by a watch that panics.
    stage: Mutex<Progress>,
    done: AtomicU64,
    /// Work so far, in the unit of [`DUE`].
    work: AtomicU64,
    over: AtomicBool,
}

impl core::fmt::Debug for Watched<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Watched").field("stage", &self.stage).finish_non_exhaustive()
    }
}

/// For work that nobody watches.
pub(crate) static UNWATCHED: Lookout<'static> = Lookout { watch: None };

impl<'w> Lookout<'w> {
    /// A lookout over work that begins with this stage.
    pub fn new(watch: &'w dyn Watch) -> Lookout<'w> {
        let nothing = Progress { stage: Stage::Start, done: 0, total: 0 };
        let watch = Watched {
            watch,
            stage: Mutex::new(nothing),
            done: AtomicU64::new(0),
            work: AtomicU64::new(0),
            over: AtomicBool::new(false),
        };
        Lookout { watch: Some(watch) }
    }

    /// Whether anybody watches.
    #[inline]
    pub fn is_watched(&self) -> bool {
        self.watch.is_some()
    }

    /// Whether the work has ended: what is left of it is of no use.
    #[inline]
    pub fn is_over(&self) -> bool {
        self.watch.as_ref().is_some_and(|watched| watched.over.load(Relaxed))
    }

    /// Begins a stage, of whose length `total` is 0 if it is not known. To be called while no other
    /// thread works.
    pub fn begin(&self, stage: Stage, total: u64) {
        if let Some(watched) = self.watch.as_ref().filter(|_| !self.is_over()) {
            watched.done.store(0, Relaxed);
            let mut progress = watched.lock();
            *progress = Progress { stage, done: 0, total };
            watched.ask(progress);
        }
    }

    /// Ends a stage. To be called while no other thread works.
    pub fn finish(&self) {
        if let Some(watched) = &self.watch {
            let progress = watched.lock();
            watched.done.fetch_max(progress.total, Relaxed);
            watched.ask(progress);
        }
    }

    /// This much more of the stage is done.
    #[inline]
    pub fn advance(&self, done: u64) {
        if let Some(watched) = &self.watch {
            watched.done.fetch_add(done, Relaxed);
        }
    }

    /// Work like reading and writing so many references was done. Asks the watch when it is time. True
    /// when the work is over.
    #[inline]
    pub fn worked(&self, references: u64) -> bool {
        self.watch.as_ref().is_some_and(|watched| watched.worked(references))
    }

    /// [`BuildError::Cancelled`] when the work is over.
    #[inline]
    pub fn check(&self) -> Result<(), BuildError> {
        match self.ended() {
            None => Ok(()),
            Some(progress) => Err(BuildError::Cancelled { progress }),
        }
    }

    /// [`QueryError::Cancelled`] when the work is over.
    #[inline]
    pub fn check_batch(&self) -> Result<(), QueryError> {
        match self.ended() {
            None => Ok(()),
            Some(Progress { done, total, .. }) => Err(QueryError::Cancelled { done, total }),
        }
    }

    /// Where the work was ended.
    #[inline]
    fn ended(&self) -> Option<Progress> {
        let watched = self.watch.as_ref()?;
        watched.over.load(Relaxed).then(|| *watched.lock())
    }
}

impl Watched<'_> {
    fn lock(&self) -> MutexGuard<'_, Progress> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn worked(&self, references: u64) -> bool {
        let before = self.work.fetch_add(references, Relaxed);
        if before / DUE != (before + references) / DUE {
            match self.stage.try_lock() {
                Ok(progress) => self.ask(progress),
                Err(TryLockError::WouldBlock) => {}
                // The watch has panicked on another thread, which takes the panic to the caller.
                Err(TryLockError::Poisoned(_)) => self.over.store(true, Relaxed),
            }
        }
        self.over.load(Relaxed)
    }

    /// Asks the watch, once it has not ended the work.
    fn ask(&self, mut progress: MutexGuard<'_, Progress>) {
        if self.over.load(Relaxed) {
            return;
        }
        progress.done = self.done.load(Relaxed);
        if let ControlFlow::Break(()) = self.watch.progress(&progress) {
            self.over.store(true, Relaxed);
        }
    }
}

/// Elements that are cleared between two looks at the watch.
const PIECE: usize = 1 << 15;

/// [`Vec::resize`] for vectors that have the room: by all threads, since most of the time goes into the system's
/// making of pages; under a watch in pieces, one after the other. Ends early when the work is over.
pub(crate) fn resize<T: Clone + Send + Sync>(
    lookout: &Lookout<'_>,
    vector: &mut Vec<T>,
    length: usize,
    value: &T,
) {
    if !lookout.is_watched() && vector.len() < length {
        let more = rayon::iter::repeat_n(value.clone(), length - vector.len());
        vector.par_extend(more.with_min_len(PIECE));
    }
    while vector.len() < length {
        let next = length.min(vector.len() + PIECE);
        let references = (next - vector.len()) * size_of::<T>() / 32;
        vector.resize(next, value.clone());
        if lookout.worked(references as u64) {
            return;
        }
    }
    vector.truncate(length);
}

/// Appends all of a slice, as [`resize`] does with one value. Ends early when the work is over.
pub(crate) fn extend<T: Copy + Send + Sync>(
    lookout: &Lookout<'_>,
    vector: &mut Vec<T>,
    slice: &[T],
) {
    if !lookout.is_watched() {
        vector.par_extend(slice.par_iter().copied().with_min_len(PIECE));
        return;
    }
    for piece in slice.chunks(PIECE) {
        vector.extend_from_slice(piece);
        if lookout.worked((size_of_val(piece) / 32) as u64) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn one_asks_at_a_time_and_nothing_follows_the_end() {
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
        let lookout = Lookout::new(&watch);
        lookout.begin(Stage::SmallNodes, 1000);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..1000 {
                        lookout.advance(1);
                        lookout.worked(DUE);
                    }
                });
            }
        });
        lookout.finish();
        assert_eq!(calls.load(Relaxed), 50);
        assert!(lookout.is_over());
        let Err(BuildError::Cancelled { progress }) = lookout.check() else { panic!() };
        assert!(progress.stage == Stage::SmallNodes && progress.done < 4000);
    }
}

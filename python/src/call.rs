//! A long call: the work runs on other threads without the GIL, while the calling thread looks after Ctrl-C and progress.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use splitplane::{Progress, QueryError, Stage, Watch};

use crate::failure::Failure;
use crate::pool;

/// How often the calling thread looks up from waiting.
const BETWEEN: Duration = Duration::from_millis(20);

/// A block that takes longer is slow: the library looks at its watch as often.
const QUICK: Duration = Duration::from_millis(2);

/// What every long call can be given.
#[derive(FromPyObject)]
pub(crate) struct Call(
    /// Threads; `None` for all cores.
    Option<usize>,
    /// Called with (stage, done, total), by the calling thread.
    Option<Py<PyAny>>,
);

/// Keeps the last progress, and ends the work when it is told to.
#[derive(Default)]
pub(crate) struct Watcher {
    stop: AtomicBool,
    last: Mutex<Option<Progress>>,
}

impl Watch for Watcher {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        if let Ok(mut last) = self.last.try_lock() {
            // Of blocks that are under way at the same time, one may be late to say how far all are.
            if last.is_none_or(|last| last.stage != progress.stage || last.done <= progress.done) {
                *last = Some(*progress);
            }
        }
        match self.stop.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}

/// The watch of a part of a batch.
pub(crate) struct Part<'a> {
    pub watcher: &'a Watcher,
    /// Items before this part.
    pub first: usize,
    /// Items of the whole batch.
    pub total: usize,
}

impl Watch for Part<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let (done, total) = (progress.done + self.first as u64, self.total as u64);
        self.watcher.progress(&Progress { done, total, ..*progress })
    }
}

/// The watch of blocks that are under way at the same time.
pub(crate) struct Blocks<'a> {
    watcher: &'a Watcher,
    done: AtomicU64,
    total: usize,
}

impl<'a> Blocks<'a> {
    pub(crate) fn new(watcher: &'a Watcher, total: usize) -> Blocks<'a> {
        Blocks { watcher, done: AtomicU64::new(0), total }
    }

    /// So many more are done.
    pub(crate) fn add(&self, more: usize) {
        let done = self.done.fetch_add(more as u64, Ordering::Relaxed) + more as u64;
        let total = self.total as u64;
        if done < total {
            let _ = self.watcher.progress(&Progress { stage: Stage::Rays, done, total });
        } else if let Ok(mut last) = self.watcher.last.lock() {
            *last = Some(Progress { stage: Stage::Rays, done, total });
        }
    }
}

/// How long blocks take of late, on one thread.
///
/// A batch with a watch begins with few rays, as nobody knows how slow they are; for each block anew that takes a fifth as long as
/// quick rays themselves. So blocks have a watch only while they are slow, and cancellation is looked for between them too.
pub(crate) struct Pace {
    is_quick: bool,
    begun: Instant,
}

impl Pace {
    pub(crate) fn new() -> Pace {
        Pace { is_quick: false, begun: Instant::now() }
    }

    /// Begins a block: its watch.
    pub(crate) fn begin<'a>(
        &mut self,
        blocks: &'a Blocks<'_>,
    ) -> Result<Option<&'a dyn Watch>, Failure> {
        if blocks.watcher.stop.load(Ordering::Relaxed) {
            let (done, total) = (blocks.done.load(Ordering::Relaxed), blocks.total as u64);
            return Err(QueryError::Cancelled { done, total }.into());
        }
        self.begun = Instant::now();
        Ok((!self.is_quick).then_some(blocks))
    }

    /// Ends a block.
    pub(crate) fn end(&mut self, blocks: &Blocks<'_>, rays: usize) {
        self.is_quick = self.begun.elapsed() < QUICK;
        blocks.add(rays);
    }
}

impl Watch for Blocks<'_> {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total as u64);
        self.watcher.progress(&Progress { done, total, ..*progress })
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|broken| broken.into_inner())
}

impl Call {
    /// On all cores, without progress.
    pub(crate) const PLAIN: Call = Call(None, None);

    /// Whether somebody wants to know how far the work is.
    pub(crate) fn is_watched(&self) -> bool {
        self.1.is_some()
    }

    /// Does the work. An exception of the callback or of a signal ends it, and is raised when it has ended.
    pub(crate) fn run<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&Watcher) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        let pool = pool::of(self.0)?;
        let watcher = Watcher::default();
        if let Some(progress) = &self.1 {
            progress.call1(py, ("start", 0, 0))?;
        }
        let (result, finished) = (Mutex::new(None), Condvar::new());
        let mut raised = None;
        py.detach(|| {
            pool.in_place_scope(|scope| {
                scope.spawn(|_| {
                    let done = catch_unwind(AssertUnwindSafe(|| work(&watcher)));
                    *locked(&result) = Some(done);
                    finished.notify_all();
                });
                self.wait(&result, &finished, &watcher, &mut raised);
            });
        });
        if let Some(error) = raised {
            return Err(error);
        }
        match result.into_inner().unwrap_or_else(|broken| broken.into_inner()) {
            Some(Ok(Ok(done))) => {
                self.report(py, &watcher)?;
                Ok(done)
            }
            Some(Ok(Err(failure))) => Err(failure.into()),
            Some(Err(panic)) => resume_unwind(panic),
            None => Err(Failure::new("SplitplaneError", "the work was not done").into()),
        }
    }

    fn wait<T>(
        &self,
        result: &Mutex<Option<T>>,
        finished: &Condvar,
        watcher: &Watcher,
        raised: &mut Option<PyErr>,
    ) {
        let mut guard = locked(result);
        while guard.is_none() {
            let waited = finished.wait_timeout(guard, BETWEEN);
            let (again, timeout) = waited.unwrap_or_else(|broken| broken.into_inner());
            guard = again;
            if guard.is_none() && timeout.timed_out() && raised.is_none() {
                drop(guard);
                let looked = Python::attach(|py| {
                    py.check_signals()?;
                    self.report(py, watcher)
                });
                if let Err(error) = looked {
                    watcher.stop.store(true, Ordering::Relaxed);
                    *raised = Some(error);
                }
                guard = locked(result);
            }
        }
    }

    /// Calls the callback with how far the work is.
    fn report(&self, py: Python<'_>, watcher: &Watcher) -> PyResult<()> {
        let Some(callback) = &self.1 else { return Ok(()) };
        let last = *locked(&watcher.last);
        if let Some(Progress { stage, done, total }) = last {
            callback.call1(py, (stage.name(), done, total))?;
        }
        Ok(())
    }
}

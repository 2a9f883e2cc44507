//! A long call: the work runs on other threads without the GIL, while the calling thread looks after Ctrl-C and progress.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use pyo3::prelude::*;
use splitplane::{Progress, QueryError, Stage, Watch};
use splitplane_float_state::standard;

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
    /// Where the calling thread does the work itself.
    alone: Option<Alone>,
}

/// What a thread needs that looks after Ctrl-C and progress between parts of its own work.
struct Alone {
    callback: Option<Py<PyAny>>,
    looked: Mutex<Instant>,
    raised: Mutex<Option<PyErr>>,
}

impl Watcher {
    /// Looks up from the work, if that is due.
    fn look(&self) {
        let Some(Alone { callback, looked, raised }) = &self.alone else { return };
        let now = Instant::now();
        if now.duration_since(*locked(looked)) < BETWEEN || locked(raised).is_some() {
            return;
        }
        let seen = Python::attach(|py| {
            py.check_signals()?;
            self.report(py, callback.as_ref())
        });
        if let Err(error) = seen {
            self.stop.store(true, Ordering::Relaxed);
            *locked(raised) = Some(error);
        }
        *locked(looked) = Instant::now();
    }

    /// Calls the callback with how far the work is.
    fn report(&self, py: Python<'_>, callback: Option<&Py<PyAny>>) -> PyResult<()> {
        let Some(callback) = callback else { return Ok(()) };
        let last = *locked(&self.last);
        if let Some(Progress { stage, done, total }) = last {
            callback.call1(py, (stage.name(), done, total))?;
        }
        Ok(())
    }
}

impl Watch for Watcher {
    fn progress(&self, progress: &Progress) -> ControlFlow<()> {
        if let Ok(mut last) = self.last.try_lock() {
            // Of blocks that are under way at the same time, one may be late to say how far all are.
            if last.is_none_or(|last| last.stage != progress.stage || last.done <= progress.done) {
                *last = Some(*progress);
            }
        }
        self.look();
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
    /// Whether the last block that ended was quick.
    is_quick: AtomicBool,
}

impl<'a> Blocks<'a> {
    pub(crate) fn new(watcher: &'a Watcher, total: usize) -> Blocks<'a> {
        Blocks { watcher, done: AtomicU64::new(0), total, is_quick: AtomicBool::new(false) }
    }

    /// So many more are done.
    fn add(&self, more: usize) {
        let done = self.done.fetch_add(more as u64, Ordering::Relaxed) + more as u64;
        let total = self.total as u64;
        if done < total {
            let _ = self.watcher.progress(&Progress { stage: Stage::Rays, done, total });
        } else if let Ok(mut last) = self.watcher.last.lock() {
            *last = Some(Progress { stage: Stage::Rays, done, total });
        }
    }
}

/// How long blocks take of late, in one task of the pool.
///
/// A batch with a watch begins with few rays, as nobody knows how slow they are; for each block anew that takes time of
/// its own. So blocks have a watch only while they are slow, and cancellation is looked for between them too. A task that has
/// had no block yet goes by the last one of any.
pub(crate) struct Pace {
    is_quick: Option<bool>,
    begun: Instant,
}

impl Pace {
    pub(crate) fn new() -> Pace {
        Pace { is_quick: None, begun: Instant::now() }
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
        let is_quick = self.is_quick.unwrap_or_else(|| blocks.is_quick.load(Ordering::Relaxed));
        self.begun = Instant::now();
        Ok((!is_quick).then_some(blocks))
    }

    /// Ends a block.
    pub(crate) fn end(&mut self, blocks: &Blocks<'_>, rays: usize) {
        let is_quick = self.begun.elapsed() < QUICK;
        self.is_quick = Some(is_quick);
        blocks.is_quick.store(is_quick, Ordering::Relaxed);
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

    /// Does the work, in the default floating-point state. An exception of the callback or of a signal ends it, and is raised when it has ended.
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
                    let done = catch_unwind(AssertUnwindSafe(|| standard(|| work(&watcher))));
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
                watcher.report(py, self.1.as_ref())?;
                Ok(done)
            }
            Some(Ok(Err(failure))) => Err(failure.into()),
            Some(Err(panic)) => resume_unwind(panic),
            None => Err(Failure::new("SplitplaneError", "the work was not done").into()),
        }
    }

    /// Whether the calling thread does blocks of rays itself: where it would only wait for one other thread. To wake that and to
    /// be woken takes as long as hundreds of rays.
    pub(crate) fn is_alone(&self, blocks: usize) -> bool {
        self.0 == Some(1) || blocks <= 1
    }

    /// Does the work on the calling thread, which looks after Ctrl-C and progress when the work calls its watch. No part of it may need
    /// a pool.
    pub(crate) fn run_alone<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&Watcher) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        let callback = self.1.as_ref().map(|callback| callback.clone_ref(py));
        if let Some(progress) = &callback {
            progress.call1(py, ("start", 0, 0))?;
        }
        let (looked, raised) = (Mutex::new(Instant::now()), Mutex::new(None));
        let alone = Some(Alone { callback, looked, raised });
        let mut watcher = Watcher { alone, ..Watcher::default() };
        let done = py.detach(|| standard(|| work(&watcher)));
        if let Some(error) = watcher.alone.as_mut().and_then(|alone| locked(&alone.raised).take()) {
            return Err(error);
        }
        let done = done?;
        watcher.report(py, self.1.as_ref())?;
        Ok(done)
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
                    watcher.report(py, self.1.as_ref())
                });
                if let Err(error) = looked {
                    watcher.stop.store(true, Ordering::Relaxed);
                    *raised = Some(error);
                }
                guard = locked(result);
            }
        }
    }
}

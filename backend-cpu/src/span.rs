//! Work and span of a build: how long it takes on one thread, and the longest chain of what must follow one another. No part of the
//! interface.
//!
//! The work runs on one thread. Where the builders divide it among tasks they say so here: what tasks of one loop, or two branches of a
//! join, take counts once for the longest of them. What is left is what each step waits for, and by Graham's bound a greedy scheduler
//! needs no longer than `(work - span) / threads + span`, beside what the scheduler itself takes.

use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Duration;

use splitplane_float_state::standard;

/// What was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// All time.
    pub work: Duration,
    /// The longest chain.
    pub span: Duration,
    /// What the first task does alone, outside of all loops and joins: nothing else can be done meanwhile. Part of the span.
    pub serial: Duration,
}

impl Span {
    /// The most that a greedy scheduler takes with so many threads.
    pub fn time_on(&self, threads: u32) -> Duration {
        (self.work - self.span) / threads.max(1) + self.span
    }
}

/// Measures what `work` does, by the clock, as if it had `threads` threads: the sizes of tasks depend on these. The calling thread must do
/// all of it: it runs in a pool of one thread, this one.
pub fn measure<T>(threads: usize, clock: fn() -> Duration, work: impl FnOnce() -> T) -> (Span, T) {
    let (frames, loops, span) = (vec![Duration::ZERO], Vec::new(), Span::default());
    let (reading, last) = (reading(clock), clock());
    let recorder = Recorder { threads, clock, reading, last, span, frames, loops };
    RECORDER.with_borrow_mut(|own| *own = Some(recorder));
    // Taken back however the work ends.
    let active = Active::new();
    let done = work();
    let span = with(|recorder| {
        recorder.tick();
        Span { span: recorder.frames[0], ..recorder.span }
    });
    drop(active);
    (span.unwrap_or_default(), done)
}

/// What it takes to read a clock: the median of some times.
fn reading(clock: fn() -> Duration) -> Duration {
    let mut last = clock();
    let mut times: Vec<Duration> = (0..1001)
        .map(|_| {
            let now = clock();
            now.saturating_sub(core::mem::replace(&mut last, now))
        })
        .collect();
    times.sort_unstable();
    times[times.len() / 2]
}

/// How many threads tasks are made for.
pub(crate) fn threads() -> usize {
    with(|recorder| recorder.threads).unwrap_or_else(rayon::current_num_threads)
}

/// As [`rayon::join`]; both branches run in the default floating-point state.
pub(crate) fn join<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if !is_active() {
        return rayon::join(|| standard(a), || standard(b));
    }
    with(|recorder| recorder.open());
    let a = a();
    let first = with(Recorder::close).unwrap_or_default();
    with(|recorder| recorder.open());
    let b = b();
    let second = with(Recorder::close).unwrap_or_default();
    with(|recorder| recorder.add(first.max(second)));
    (a, b)
}

/// A loop whose pieces are done by many tasks, from here until it is dropped. A task has so many pieces, which follow one another.
#[must_use]
pub(crate) fn pieces_of(least: usize) -> Loop {
    Loop(with(|recorder| {
        recorder.tick();
        recorder.loops.push(Pieces { least, ..Pieces::default() });
    }))
}

/// A piece of the innermost loop, from here until it is dropped.
#[must_use]
pub(crate) fn piece() -> Piece {
    Piece(with(|recorder| {
        // The clock is read once for a task: pieces may be short.
        if recorder.loops.last().is_none_or(|pieces| pieces.count == 0) {
            recorder.open();
        }
    }))
}

/// Work of one task, which is all that the task does.
pub(crate) fn task<T>(work: impl FnOnce() -> T) -> T {
    let pieces = pieces_of(1);
    let piece = piece();
    let done = work();
    drop(piece);
    drop(pieces);
    done
}

/// Work that many tasks do in this many equal parts.
pub(crate) fn evenly<T>(parts: usize, work: impl FnOnce() -> T) -> T {
    let open = with(|recorder| recorder.open());
    let done = work();
    if open.is_some() {
        with(|recorder| {
            let took = recorder.close();
            recorder.add(took / parts.max(1) as u32);
        });
    }
    done
}

/// Ends a loop.
#[derive(Debug)]
pub(crate) struct Loop(Option<()>);

impl Drop for Loop {
    fn drop(&mut self) {
        if self.0.is_some() {
            with(|recorder| {
                let mut pieces = recorder.loops.pop().unwrap_or_default();
                if pieces.count > 0 {
                    // A task that has fewer pieces than others.
                    pieces.longest = pieces.longest.max(recorder.close());
                } else {
                    recorder.tick();
                }
                recorder.add(pieces.longest);
            });
        }
    }
}

/// Ends a piece.
#[derive(Debug)]
pub(crate) struct Piece(Option<()>);

impl Drop for Piece {
    fn drop(&mut self) {
        if self.0.is_some() {
            with(|recorder| {
                let Some(pieces) = recorder.loops.last_mut() else { return };
                pieces.count += 1;
                if pieces.count >= pieces.least {
                    pieces.count = 0;
                    let took = recorder.close();
                    if let Some(pieces) = recorder.loops.last_mut() {
                        pieces.longest = pieces.longest.max(took);
                    }
                }
            });
        }
    }
}

/// How many threads measure: with none, nothing is looked up.
static MEASURING: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    static RECORDER: RefCell<Option<Recorder>> = const { RefCell::new(None) };
}

/// Measures while it lives.
struct Active;

impl Active {
    fn new() -> Active {
        MEASURING.fetch_add(1, Relaxed);
        Active
    }
}

impl Drop for Active {
    fn drop(&mut self) {
        MEASURING.fetch_sub(1, Relaxed);
        RECORDER.with_borrow_mut(|own| *own = None);
    }
}

#[inline]
fn is_active() -> bool {
    with(|_| ()).is_some()
}

/// Does something with this thread's recorder, if it measures.
#[inline]
fn with<T>(work: impl FnOnce(&mut Recorder) -> T) -> Option<T> {
    if MEASURING.load(Relaxed) == 0 {
        return None;
    }
    RECORDER.with_borrow_mut(|own| own.as_mut().map(work))
}

/// What a thread has measured so far.
struct Recorder {
    threads: usize,
    clock: fn() -> Duration,
    /// What it takes to read the clock, which is no part of the work.
    reading: Duration,
    /// Until when time is accounted for.
    last: Duration,
    span: Span,
    /// The longest chain of each task under way, the innermost last.
    frames: Vec<Duration>,
    loops: Vec<Pieces>,
}

/// A loop under way.
#[derive(Default)]
struct Pieces {
    /// Pieces of a task, at least.
    least: usize,
    /// Pieces of the task under way so far.
    count: usize,
    /// The longest task.
    longest: Duration,
}

impl Recorder {
    /// Accounts for the time since the last call.
    fn tick(&mut self) {
        let now = (self.clock)();
        let took = now.saturating_sub(self.last);
        self.last = now;
        let took = took.saturating_sub(self.reading);
        self.span.work += took;
        if self.frames.len() == 1 {
            self.span.serial += took;
        }
        self.add(took);
    }

    fn open(&mut self) {
        self.tick();
        self.frames.push(Duration::ZERO);
    }

    /// Ends the innermost task. Returns its longest chain.
    fn close(&mut self) -> Duration {
        self.tick();
        self.frames.pop().unwrap_or_default()
    }

    /// Adds to the chain of the innermost task.
    fn add(&mut self, chain: Duration) {
        if let Some(frame) = self.frames.last_mut() {
            *frame += chain;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    thread_local! {
        static NOW: Cell<u64> = const { Cell::new(0) };
    }

    fn clock() -> Duration {
        Duration::from_millis(NOW.get())
    }

    fn take(milliseconds: u64) {
        NOW.set(NOW.get() + milliseconds);
    }

    fn measured(work: impl FnOnce()) -> [u64; 3] {
        let (Span { work, span, serial }, ()) = measure(64, clock, work);
        [work, span, serial].map(|time| time.as_millis() as u64)
    }

    #[test]
    fn the_longest_piece_of_a_loop_counts() {
        let pieces = |least: usize, all: &[u64]| {
            let _loop = pieces_of(least);
            for &one in all {
                let _piece = piece();
                take(one);
            }
        };
        let some = || {
            take(5);
            pieces(1, &[1, 4, 2]);
            pieces(2, &[1, 4, 2, 2, 3]);
            take(1);
        };
        assert_eq!(measured(some), [25, 15, 6]);
        // Not measured: nothing happens.
        some();
        assert_eq!(measured(|| take(1)), [1, 1, 1]);
    }

    #[test]
    fn the_longer_branch_counts() {
        let branches = || {
            let inner = || {
                take(1);
                join(|| task(|| take(4)), || task(|| take(6)));
            };
            join(inner, || task(|| take(5)));
            evenly(4, || take(8));
        };
        // 1 + 6 + 8 / 4.
        assert_eq!(measured(branches), [24, 9, 0]);
    }

    #[test]
    fn tasks_are_those_of_the_threads_that_are_thought_of() {
        assert_eq!(measure(64, clock, threads).1, 64);
        assert_eq!(threads(), rayon::current_num_threads());
    }

    #[test]
    fn threads_share_what_need_not_wait() {
        let [work, span, serial] = [100, 20, 5].map(Duration::from_millis);
        let span = Span { work, span, serial };
        let times = [1, 4, 80].map(|threads| span.time_on(threads).as_millis());
        assert_eq!(times, [100, 40, 21]);
    }
}

//! Work of a driver in a thread of its own, waited for no longer than its limits allow. Time in which the process could have run,
//! but others did, does not count: see [`Stopwatch`].
//!
//! Drivers compile inside the process, in a call that takes as long and as much as it likes. The thread
//! that makes the call cannot be ended: when a limit is exceeded, it is left to itself.

#[cfg(not(target_family = "wasm"))]
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
#[cfg(not(target_family = "wasm"))]
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
#[cfg(not(target_family = "wasm"))]
use std::thread;
use std::time::Duration;

use super::stopwatch::Stopwatch;
use crate::error::DriverLimit;

/// Polling interval for memory and time.
#[cfg(not(target_family = "wasm"))]
const LOOK: Duration = Duration::from_millis(20);

/// Compilers recurse. On a main thread they have this much.
#[cfg(not(target_family = "wasm"))]
const STACK: usize = 8 << 20;

/// A driver's limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bounds {
    /// Time for all the pipelines of an opening together, and for each one later.
    pub time: Duration,
    /// Bytes by which the memory of this process may grow meanwhile.
    pub memory: u64,
}

/// Why work has no outcome.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Unfinished {
    Exceeded(DriverLimit),
    /// No thread could be started.
    #[cfg_attr(target_family = "wasm", allow(dead_code, reason = "nothing starts threads there"))]
    NotStarted(String),
}

/// The outcome of `work`, or the limit that it exceeded. With no time at all, nothing is started.
/// `within` has the time of all work of which this is a part, and for which the limit of time holds too; what is done between two parts does
/// not count.
pub(crate) fn run<T: Send + 'static>(
    bounds: &Bounds,
    within: Option<&Mutex<Stopwatch>>,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Unfinished> {
    run_metered(bounds, within, private_memory, work)
}

/// In a browser the call only tells another process to compile, which does so while this one goes on.
#[cfg(target_family = "wasm")]
fn run_metered<T>(
    bounds: &Bounds,
    within: Option<&Mutex<Stopwatch>>,
    _memory: impl FnMut() -> Option<u64>,
    work: impl FnOnce() -> T,
) -> Result<T, Unfinished> {
    let within = within.map(|watch| watch.lock().unwrap_or_else(PoisonError::into_inner));
    let is_over = within.is_some_and(|mut watch| watch.is_over(bounds.time));
    if is_over || Stopwatch::own().is_over(bounds.time) {
        return Err(Unfinished::Exceeded(DriverLimit::Time(bounds.time)));
    }
    Ok(work())
}

#[cfg(not(target_family = "wasm"))]
fn run_metered<T: Send + 'static>(
    bounds: &Bounds,
    within: Option<&Mutex<Stopwatch>>,
    mut memory: impl FnMut() -> Option<u64>,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Unfinished> {
    let mut own = Stopwatch::own();
    if let Some(within) = within {
        within.lock().unwrap_or_else(PoisonError::into_inner).resume();
    }
    let mut is_over = || {
        let within = within.map(|watch| watch.lock().unwrap_or_else(PoisonError::into_inner));
        own.is_over(bounds.time) || within.is_some_and(|mut watch| watch.is_over(bounds.time))
    };
    let over = Unfinished::Exceeded(DriverLimit::Time(bounds.time));
    if is_over() {
        return Err(over);
    }
    let before = memory();
    let (send, receive) = mpsc::channel();
    thread::Builder::new()
        .name("splitplane driver".into())
        .stack_size(STACK)
        .spawn(move || {
            // The receiver is gone if it took too long.
            let _ = send.send(catch_unwind(AssertUnwindSafe(work)));
        })
        .map_err(|error| Unfinished::NotStarted(error.to_string()))?;
    loop {
        match receive.recv_timeout(LOOK) {
            Ok(Ok(out)) => return Ok(out),
            Ok(Err(panic)) => resume_unwind(panic),
            Err(RecvTimeoutError::Disconnected) => unreachable!("it sends before it ends"),
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let (Some(before), Some(now)) = (before, memory())
            && now.saturating_sub(before) > bounds.memory
        {
            return Err(Unfinished::Exceeded(DriverLimit::Memory(bounds.memory)));
        }
        if is_over() {
            return Err(over);
        }
    }
}

/// Bytes of memory that this process has for itself; `None` where the system does not say.
fn private_memory() -> Option<u64> {
    private_memory_of("self")
}

/// Bytes of memory that a process has for itself, without what files are mapped to; `None` where the
/// system does not say. Linux does.
#[doc(hidden)]
pub fn private_memory_of(process: &str) -> Option<u64> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOREVER: Duration = Duration::MAX;

    /// Work that lasts until the sender is dropped.
    fn stalled() -> (mpsc::Sender<()>, impl FnOnce() + Send) {
        let (release, stall) = mpsc::channel::<()>();
        (release, move || {
            let _ = stall.recv();
        })
    }

    #[test]
    fn what_ends_gives_its_outcome() {
        let bounds = Bounds { time: FOREVER, memory: u64::MAX };
        assert_eq!(run(&bounds, None, || 7), Ok(7));
        let raised = catch_unwind(|| run(&bounds, None, || panic!("of the driver's own")));
        assert_eq!(raised.unwrap_err().downcast_ref(), Some(&"of the driver's own"));
    }

    #[test]
    fn what_lasts_too_long_is_left() {
        let bounds = Bounds { time: Duration::from_millis(30), memory: u64::MAX };
        let (_release, work) = stalled();
        let limit = DriverLimit::Time(bounds.time);
        assert_eq!(run(&bounds, None, work), Err(Unfinished::Exceeded(limit)));
        // The end of an enclosing piece of work comes before its own.
        let whole = Mutex::new(Stopwatch::of("no process, so all time counts".into()));
        thread::sleep(bounds.time);
        assert!(whole.lock().unwrap().is_over(bounds.time));
        let (send, begun) = mpsc::channel();
        let out = run(&bounds, Some(&whole), move || send.send(()));
        assert!(matches!(out, Err(Unfinished::Exceeded(_))), "{out:?}");
        assert_eq!(begun.recv(), Err(mpsc::RecvError));
    }

    /// Between two pipelines a device builds and traces, and nobody looks at the time.
    #[test]
    fn what_is_done_between_parts_does_not_count() {
        let bounds = Bounds { time: Duration::from_secs(60), memory: u64::MAX };
        let whole = Stopwatch::of("no process, so all time counts".into());
        let whole = Mutex::new(whole.unseen_for(bounds.time));
        assert_eq!(run(&bounds, Some(&whole), || 7), Ok(7));
    }

    #[test]
    fn nothing_is_begun_without_time() {
        let none = Bounds { time: Duration::ZERO, memory: u64::MAX };
        let (send, begun) = mpsc::channel();
        let out = run(&none, None, move || send.send(()));
        assert!(matches!(out, Err(Unfinished::Exceeded(DriverLimit::Time(_)))), "{out:?}");
        // Not even later: what would send is gone.
        assert_eq!(begun.recv(), Err(mpsc::RecvError));
    }

    #[test]
    fn what_takes_too_much_memory_is_left_at_the_first_look_that_sees_it() {
        let bounds = Bounds { time: FOREVER, memory: 50 };
        let (_release, work) = stalled();
        let mut looks = 0;
        // Memory that is given back, or what the process had before, does not count.
        let meter = || {
            looks += 1;
            Some([1000, 900, 1050, 1051, 9000][looks - 1])
        };
        let out = run_metered(&bounds, None, meter, work);
        assert_eq!(out, Err(Unfinished::Exceeded(DriverLimit::Memory(50))));
        assert_eq!(looks, 4);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn memory_of_this_process_is_known() {
        let before = private_memory().unwrap();
        let held = std::hint::black_box(vec![1u8; 64 << 20]);
        assert!(private_memory().unwrap() > before.min(64 << 20));
        drop(held);
        assert_eq!(private_memory_of("no process"), None);
    }
}

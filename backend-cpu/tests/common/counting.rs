//! An allocator that counts, and refuses requests on demand.
//!
//! Bytes that are held are those of the whole process. Allocations are counted, and requests
//! refused, on threads of [`pool`] only: a test's own thread and the harness allocate when they
//! like.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicUsize};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

/// The alignment of what is shared between the threads of a pool (`CachePadded` of crossbeam).
const QUEUES: usize = 128;

/// Bytes that the process holds, and the most that it held since [`peak_of`] began.
static HELD: AtomicI64 = AtomicI64::new(0);
static PEAK: AtomicI64 = AtomicI64::new(0);

/// Whether threads of a [`pool`] count, and what: requests, their bytes, and by how many bytes
/// these threads hold more.
static COUNTING: AtomicBool = AtomicBool::new(false);
static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);
static BYTES: AtomicUsize = AtomicUsize::new(0);
static GROWTH: AtomicI64 = AtomicI64::new(0);

static ARMED: AtomicBool = AtomicBool::new(false);
/// Bytes of requests that may be refused.
static LEAST: AtomicUsize = AtomicUsize::new(0);
/// Such requests that are granted still.
static GRANTED: AtomicI64 = AtomicI64::new(0);
/// Whether only one is refused, or all after it too.
static ONCE: AtomicBool = AtomicBool::new(false);
static REFUSED: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Whether this is a thread of a [`pool`].
    static COUNTS: Cell<bool> = const { Cell::new(false) };
}

fn is_granted(size: usize, align: usize) -> bool {
    let counts = size >= LEAST.load(Relaxed) && align < QUEUES;
    if !ARMED.load(Relaxed) || !counts || !COUNTS.with(Cell::get) {
        return true;
    }
    let granted = GRANTED.fetch_sub(1, Relaxed);
    let refused = granted == 0 || granted < 0 && !ONCE.load(Relaxed);
    REFUSED.fetch_add(usize::from(refused), Relaxed);
    !refused
}

fn note(bytes: usize, freed: usize) {
    let change = bytes as i64 - freed as i64;
    let held = HELD.fetch_add(change, Relaxed) + change;
    PEAK.fetch_max(held, Relaxed);
    if COUNTING.load(Relaxed) && COUNTS.with(Cell::get) {
        if bytes > 0 {
            ALLOCATIONS.fetch_add(1, Relaxed);
            BYTES.fetch_add(bytes, Relaxed);
        }
        GROWTH.fetch_add(change, Relaxed);
    }
}

/// The system's allocator, which counts and refuses.
struct Counting;

// SAFETY: hands what it grants on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if !is_granted(layout.size(), layout.align()) {
            return std::ptr::null_mut();
        }
        note(layout.size(), 0);
        // SAFETY: the caller's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        note(0, layout.size());
        // SAFETY: the caller's contract.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if !is_granted(size, layout.align()) {
            return std::ptr::null_mut();
        }
        note(size, layout.size());
        // SAFETY: the caller's contract.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test at a time.
pub(crate) fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    let alone = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    // A test that panicked may have left them.
    COUNTING.store(false, Relaxed);
    ARMED.store(false, Relaxed);
    alone
}

/// A pool whose threads' requests are counted and refused, except those that they need to end: they
/// do after the pool is gone.
pub(crate) fn pool(threads: usize) -> ThreadPool {
    let pool = ThreadPoolBuilder::new().num_threads(threads);
    let pool = pool.start_handler(|_| COUNTS.set(true)).exit_handler(|_| COUNTS.set(false));
    pool.build().expect("threads")
}

/// How often, and how many bytes, threads of pools allocate meanwhile.
pub(crate) fn allocated(work: impl FnOnce()) -> (usize, usize) {
    ALLOCATIONS.store(0, Relaxed);
    BYTES.store(0, Relaxed);
    GROWTH.store(0, Relaxed);
    COUNTING.store(true, Relaxed);
    work();
    COUNTING.store(false, Relaxed);
    (ALLOCATIONS.load(Relaxed), BYTES.load(Relaxed))
}

/// By how many bytes threads of pools hold more than when [`allocated`] began: for work that it
/// does.
pub(crate) fn growth() -> i64 {
    GROWTH.load(Relaxed)
}

/// Bytes that the process holds.
pub(crate) fn held() -> i64 {
    HELD.load(Relaxed)
}

/// What work allocates at most beyond what is there.
pub(crate) fn peak_of<T>(work: impl FnOnce() -> T) -> (T, i64) {
    let before = held();
    PEAK.store(before, Relaxed);
    let out = work();
    (out, PEAK.load(Relaxed) - before)
}

/// Refuses the request of this number, from 0 on, or all from it on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refuse {
    pub(crate) number: i64,
    pub(crate) once: bool,
    /// Bytes of requests that count.
    pub(crate) least: usize,
}

impl Refuse {
    /// Does some work, of which the request is one.
    pub(crate) fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        LEAST.store(self.least, Relaxed);
        GRANTED.store(self.number, Relaxed);
        ONCE.store(self.once, Relaxed);
        REFUSED.store(0, Relaxed);
        ARMED.store(true, Relaxed);
        let out = work();
        ARMED.store(false, Relaxed);
        out
    }

    /// Whether work that was done last was refused anything.
    pub(crate) fn was_refused() -> bool {
        REFUSED.load(Relaxed) > 0
    }
}

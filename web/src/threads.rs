//! The pool of threads that work is divided among: the thread that asks for it, which alone may call functions of JavaScript, and workers
//! that JavaScript has started.
//!
//! A worker that traps would leave the others waiting for its share. JavaScript, which sees the trap, then calls [`end_threads`] on the
//! same worker, and every thread of the pool traps as soon as it waits or looks for work.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

use rayon::{ThreadBuilder, ThreadPoolBuilder};
use wasm_bindgen::prelude::*;

use crate::failure::Failure;

/// Bytes that are kept for the end: the pool is told of it even where there is no memory left.
const RESERVE: usize = 64 << 10;

/// Threads of the pool that no worker has taken yet.
static WAITING: Mutex<Vec<ThreadBuilder>> = Mutex::new(Vec::new());
static MORE: Condvar = Condvar::new();
static KEPT: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static HAS_LOST: AtomicBool = AtomicBool::new(false);

/// Makes the pool of this thread and `count` less one others, for each of which a worker is in [`run_thread`], or on its way there. Waits
/// for them, so it is not for a window's own thread.
#[wasm_bindgen(js_name = beginThreads)]
pub fn begin_threads(count: usize) -> Result<(), JsValue> {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Vec::with_capacity(RESERVE);
    let begin = |thread: ThreadBuilder| {
        WAITING.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
        MORE.notify_one();
        Ok(())
    };
    let pool =
        ThreadPoolBuilder::new().num_threads(count).use_current_thread().spawn_handler(begin);
    let failed = |error| Failure::new("threads", format!("there are no threads: {error}"));
    Ok(pool.build_global().map_err(failed)?)
}

/// What a worker does: a thread of the pool, until its end.
#[wasm_bindgen(js_name = runThread)]
pub fn run_thread() {
    let thread = {
        let mut waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            match waiting.pop() {
                Some(thread) => break thread,
                None => waiting = MORE.wait(waiting).unwrap_or_else(PoisonError::into_inner),
            }
        }
    };
    thread.run();
}

/// How many threads there are.
#[wasm_bindgen(js_name = threadCount)]
pub fn thread_count() -> usize {
    rayon::current_num_threads()
}

/// Ends all threads, for a worker that has trapped. A thread that is just falling asleep can miss it, so it is to be repeated.
#[wasm_bindgen(js_name = endThreads)]
pub fn end_threads() {
    HAS_LOST.store(true, Ordering::Relaxed);
    // No lock is waited for here: the thread that trapped may have held it.
    if let Ok(mut kept) = KEPT.try_lock() {
        *kept = Vec::new();
    }
    rayon::spawn_broadcast(|_| std::process::abort());
}

/// Whether a worker has trapped.
#[wasm_bindgen(js_name = hasLostThread)]
pub fn has_lost_thread() -> bool {
    HAS_LOST.load(Ordering::Relaxed)
}

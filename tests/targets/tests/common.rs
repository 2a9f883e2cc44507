//! What tests of fuzz targets share.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

/// Makes the pool that all tests share. Fuzzers' own, which `single_thread` makes where there is
/// none, is the thread of one of them: others would wait for it for ever.
pub(crate) fn make_pool() {
    rayon::current_num_threads();
}

/// Whether some work panics, as it should. Neither this thread nor the pool says so.
pub(crate) fn is_caught(work: impl FnOnce()) -> bool {
    static HOOK: Once = Once::new();
    static CAUGHT: AtomicUsize = AtomicUsize::new(0);
    thread_local! {
        static IS_CAUGHT: Cell<bool> = const { Cell::new(false) };
    }
    // One hook for the whole process: tests that each set one would put back one another's.
    HOOK.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |panic| {
            let of_pool = CAUGHT.load(Relaxed) > 0 && rayon::current_thread_index().is_some();
            if !IS_CAUGHT.get() && !of_pool {
                usual(panic);
            }
        }));
    });
    CAUGHT.fetch_add(1, Relaxed);
    IS_CAUGHT.set(true);
    let caught = catch_unwind(AssertUnwindSafe(work)).is_err();
    IS_CAUGHT.set(false);
    CAUGHT.fetch_sub(1, Relaxed);
    caught
}

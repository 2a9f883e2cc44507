//! Threads that do the work. Never rayon's own pool: after a fork its threads are gone, and whoever asked it would wait for ever.

use std::sync::{Arc, Mutex};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::failure::Failure;

/// Most threads that a call may ask for.
const MOST: usize = 1024;
/// Pools that are kept, besides the one with as many threads as there are cores.
const KEPT: usize = 3;

struct Pools {
    process: u32,
    kept: Vec<(usize, Arc<ThreadPool>)>,
}

static POOLS: Mutex<Option<Pools>> = Mutex::new(None);

/// The pool of so many threads; `None` for as many as there are cores, or as `RAYON_NUM_THREADS` says.
///
/// Called with the GIL held, and keeps it: so no other thread holds the lock when Python forks.
pub(crate) fn of(threads: Option<usize>) -> Result<Arc<ThreadPool>, Failure> {
    let count = threads.unwrap_or(0);
    if count > MOST || threads == Some(0) {
        let text = format!("threads is {count}, but must be from 1 to {MOST}");
        return Err(Failure::new("ConfigError", text));
    }
    let mut pools = POOLS.lock().unwrap_or_else(|broken| broken.into_inner());
    let process = std::process::id();
    if let Some(old) = pools.take_if(|pools| pools.process != process) {
        // Its threads are those of the parent; to end them would be to wait for them.
        std::mem::forget(old);
    }
    let pools = pools.get_or_insert_with(|| Pools { process, kept: Vec::new() });
    if let Some((_, pool)) = pools.kept.iter().find(|(kept, _)| *kept == count) {
        return Ok(Arc::clone(pool));
    }
    let named =
        ThreadPoolBuilder::new().num_threads(count).thread_name(|i| format!("splitplane-{i}"));
    let pool = named.build().map_err(|error| {
        Failure::new("OutOfMemoryError", format!("{count} threads were not started: {error}"))
    })?;
    let pool = Arc::new(pool);
    if pools.kept.iter().filter(|(kept, _)| *kept != 0).count() >= KEPT
        && let Some(oldest) = pools.kept.iter().position(|(kept, _)| *kept != 0)
    {
        pools.kept.remove(oldest);
    }
    pools.kept.push((count, Arc::clone(&pool)));
    Ok(pool)
}

//! Threads that do the work of a call.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::status::{Failure, Status};

/// Most threads that a call may ask for.
const MOST: u32 = 1024;
/// Pools that are kept.
const KEPT: usize = 3;

static POOLS: Mutex<Vec<(u32, Arc<ThreadPool>)>> = Mutex::new(Vec::new());

/// Does work on so many threads; 0: on rayon's own pool.
pub(crate) fn run<T: Send>(
    threads: u32,
    work: impl FnOnce() -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    match threads {
        0 => work(),
        threads => of(threads)?.install(work),
    }
}

fn of(threads: u32) -> Result<Arc<ThreadPool>, Failure> {
    if threads > MOST {
        let text = format!("options: `threads` is {threads}, but may be {MOST} at most");
        return Err(Failure::new(Status::Option, text));
    }
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, pool)) = pools.iter().find(|(kept, _)| *kept == threads) {
        return Ok(Arc::clone(pool));
    }
    let named = ThreadPoolBuilder::new().num_threads(threads as usize);
    let pool = named.thread_name(|place| format!("splitplane-{place}")).build();
    let pool = Arc::new(pool.map_err(|error| {
        Failure::new(Status::OutOfMemory, format!("{threads} threads were not started: {error}"))
    })?);
    if pools.len() >= KEPT {
        pools.remove(0);
    }
    pools.push((threads, Arc::clone(&pool)));
    Ok(pool)
}

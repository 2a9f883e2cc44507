//! Ticks for work that gives way: one thread wakes all that waits, again and again, and ends when nothing has waited for a while.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};
use std::time::Duration;

/// Time between two ticks: as long as a thread that blocks sleeps between two looks at a device.
const TICK: Duration = Duration::from_micros(200);
/// How long the thread stays when nothing waits.
const IDLE: Duration = Duration::from_millis(200);

/// Who waits for the next tick.
static WAITING: Mutex<Waiting> = Mutex::new(Waiting { wakers: Vec::new(), ticks: 0, runs: false });
static BEGINS: Condvar = Condvar::new();

struct Waiting {
    wakers: Vec<Waker>,
    ticks: u64,
    /// Whether there is a thread.
    runs: bool,
}

fn lock() -> MutexGuard<'static, Waiting> {
    WAITING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Resolves at the next tick.
pub(crate) async fn tick() {
    let mut begun = None;
    std::future::poll_fn(|context| {
        let mut waiting = lock();
        let begun = *begun.get_or_insert(waiting.ticks);
        if waiting.ticks > begun {
            return Poll::Ready(());
        }
        waiting.wakers.push(context.waker().clone());
        if !waiting.runs {
            let thread = std::thread::Builder::new().name("splitplane ticks".into()).spawn(run);
            if thread.is_err() {
                // Without a thread the executor asks again at once.
                waiting.ticks += 1;
                let woken = std::mem::take(&mut waiting.wakers);
                drop(waiting);
                woken.into_iter().for_each(Waker::wake);
                return Poll::Pending;
            }
            waiting.runs = true;
        }
        BEGINS.notify_one();
        Poll::Pending
    })
    .await;
}

fn run() {
    loop {
        let waiting = lock();
        let is_idle = |waiting: &mut Waiting| waiting.wakers.is_empty();
        let (mut waiting, waited) = BEGINS
            .wait_timeout_while(waiting, IDLE, is_idle)
            .unwrap_or_else(PoisonError::into_inner);
        if waited.timed_out() && waiting.wakers.is_empty() {
            waiting.runs = false;
            return;
        }
        drop(waiting);
        std::thread::sleep(TICK);
        let woken = {
            let mut waiting = lock();
            waiting.ticks += 1;
            std::mem::take(&mut waiting.wakers)
        };
        // Outside of the lock: an executor may poll at once.
        woken.into_iter().for_each(Waker::wake);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_come_to_all_who_wait_and_after_a_break() {
        for _ in 0..3 {
            let threads: Vec<_> = (0..4)
                .map(|_| {
                    std::thread::spawn(|| {
                        pollster::block_on(async {
                            for _ in 0..5 {
                                tick().await;
                            }
                        });
                    })
                })
                .collect();
            for thread in threads {
                thread.join().expect("five ticks");
            }
        }
        std::thread::sleep(IDLE + Duration::from_millis(50));
        pollster::block_on(tick());
    }
}

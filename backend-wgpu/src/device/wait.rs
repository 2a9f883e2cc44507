//! How work waits for a device: by blocking its thread, or by giving way to whatever else the caller's executor has to do.
//!
//! Everything that waits is stated once, as a future. Work that blocks is done when it is first polled, so that the functions
//! that block only have to poll it. A page cannot block: there such work ends with [`GpuError::CannotBlock`].

use splitplane_float_state::Standard;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

#[cfg(not(target_family = "wasm"))]
use super::ticks::tick;
#[cfg(target_family = "wasm")]
use super::web::tick;
use crate::error::GpuError;

/// How work waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// On its thread.
    Blocking,
    /// By giving way.
    Yielding,
}

/// The outcome of work that waits by [`Wait::Blocking`].
pub fn blocking<T>(work: impl Future<Output = T>) -> T {
    let _state = Standard::set();
    match pin!(work).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(out) => out,
        Poll::Pending => unreachable!("work that blocks gives way to nobody"),
    }
}

impl Wait {
    /// Whether it blocks the thread.
    pub(crate) fn blocks(self) -> bool {
        self == Wait::Blocking
    }

    /// Refuses to block where nothing can.
    pub(crate) fn check(self) -> Result<(), GpuError> {
        match self {
            Wait::Blocking if cfg!(target_family = "wasm") => Err(GpuError::CannotBlock),
            _ => Ok(()),
        }
    }

    /// Lets a browser tell what it has to tell.
    pub(crate) async fn turn(self) {
        #[cfg(target_family = "wasm")]
        if self == Wait::Yielding {
            super::web::turn().await;
        }
    }

    /// Lets some time pass: about `time` where it blocks, and otherwise until the bell is rung or the next tick. It gives way
    /// also where the bell was rung before: an executor has others to serve.
    ///
    /// # Errors
    /// [`GpuError::CannotBlock`].
    pub(crate) async fn pause(self, time: Duration, bell: &Bell) -> Result<(), GpuError> {
        self.check()?;
        match self {
            Wait::Blocking if time.is_zero() => std::thread::yield_now(),
            Wait::Blocking => std::thread::sleep(time),
            Wait::Yielding => {
                let mut tick = pin!(tick());
                let (mut rung, mut gave_way) = (false, false);
                let next = |context: &mut Context<'_>| {
                    rung = rung || bell.rings(context.waker());
                    if !rung {
                        gave_way = true;
                        return tick.as_mut().poll(context);
                    }
                    if std::mem::replace(&mut gave_way, true) {
                        return Poll::Ready(());
                    }
                    context.waker().wake_by_ref();
                    Poll::Pending
                };
                std::future::poll_fn(next).await;
            }
        }
        Ok(())
    }
}

/// Rung by a callback, it wakes who waits for that.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bell(Arc<Mutex<Ringing>>);

#[derive(Debug, Default)]
struct Ringing {
    rung: bool,
    waiting: Option<Waker>,
}

impl Bell {
    /// Wakes who waits, or lets the next wait end at once.
    pub(crate) fn ring(&self) {
        let waiting = {
            let mut ringing = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            ringing.rung = true;
            ringing.waiting.take()
        };
        // Outside of the lock: an executor may poll at once.
        if let Some(waiting) = waiting {
            waiting.wake();
        }
    }

    /// Whether it was rung since it was last asked; if not, it will wake `waker`.
    fn rings(&self, waker: &Waker) -> bool {
        let mut ringing = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let rung = std::mem::take(&mut ringing.rung);
        ringing.waiting = (!rung).then(|| waker.clone());
        rung
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::clock::Instant;

    #[test]
    fn work_that_blocks_is_done_at_once() {
        let work = async {
            let start = Instant::now();
            let pause = Duration::from_millis(2);
            Wait::Blocking.pause(pause, &Bell::default()).await.expect("threads can wait here");
            start.elapsed() >= pause
        };
        assert!(blocking(work));
    }

    #[test]
    fn a_bell_ends_a_wait_that_gives_way() {
        let (bell, woken) = (Bell::default(), Arc::new(Woken::default()));
        let waker = Waker::from(Arc::clone(&woken));
        assert!(!bell.rings(&waker));
        bell.ring();
        assert_eq!(woken.0.load(std::sync::atomic::Ordering::Relaxed), 1);
        // Rung between two waits, it ends the next one, and that one only.
        assert!(bell.rings(&waker));
        assert!(!bell.rings(&waker));
    }

    #[test]
    fn a_bell_that_was_rung_before_does_not_keep_the_thread() {
        let (bell, woken) = (Bell::default(), Arc::new(Woken::default()));
        let waker = Waker::from(Arc::clone(&woken));
        let mut context = Context::from_waker(&waker);
        bell.ring();
        let mut pause = pin!(Wait::Yielding.pause(Duration::ZERO, &bell));
        assert!(pause.as_mut().poll(&mut context).is_pending());
        assert_eq!(woken.0.load(std::sync::atomic::Ordering::Relaxed), 1);
        assert!(matches!(pause.as_mut().poll(&mut context), Poll::Ready(Ok(()))));
    }

    #[derive(Default)]
    struct Woken(std::sync::atomic::AtomicU32);

    impl std::task::Wake for Woken {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        }
    }
}

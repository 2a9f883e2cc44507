//! Errors that are known later: a browser tells what an error scope has caught by a promise.
//!
//! Each piece of work marks where it begins, and asks before it ends whether all that was done since has gone well. What is
//! refused later than the last question of a piece of work is not lost: objects that a device refused are refused wherever they are
//! used, and who uses them asks again.

use std::collections::VecDeque;
use std::fmt;
use std::pin::Pin;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

use crate::error::GpuError;

/// Most errors that are kept for work which is under way.
const KEPT: usize = 256;

/// Becomes an error, or none.
pub(crate) type Check = Pin<Box<dyn Future<Output = Option<GpuError>> + Send>>;

/// Where a piece of work begins, in the order of all checks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Mark(u64);

/// The checks of a device that are under way, and the errors that some have found.
#[derive(Default)]
pub(crate) struct Deferred(Mutex<Checks>);

#[derive(Default)]
struct Checks {
    next: Mark,
    under_way: Vec<(Mark, Check)>,
    errors: VecDeque<(Mark, GpuError)>,
}

impl Deferred {
    /// What is checked from now on comes after this mark.
    pub(crate) fn mark(&self) -> Mark {
        self.lock().next
    }

    /// Keeps a check whose outcome is not known yet.
    #[cfg_attr(
        not(any(target_family = "wasm", test)),
        allow(dead_code, reason = "elsewhere errors are known at once")
    )]
    pub(crate) fn add(&self, check: Check) {
        let mut checks = self.lock();
        let mark = checks.next;
        checks.next.0 += 1;
        checks.under_way.push((mark, check));
    }

    /// Whether all checks since a mark are done.
    ///
    /// # Errors
    /// The first error that they have found. Work that overlaps may be given one another's errors.
    pub(crate) fn settled(&self, from: Mark) -> Result<bool, GpuError> {
        let mut checks = self.lock();
        let Checks { under_way, errors, .. } = &mut *checks;
        let mut context = Context::from_waker(Waker::noop());
        under_way.retain_mut(|(mark, check)| match check.as_mut().poll(&mut context) {
            Poll::Pending => true,
            Poll::Ready(found) => {
                if let Some(error) = found {
                    if errors.len() == KEPT {
                        errors.pop_front();
                    }
                    errors.push_back((*mark, error));
                }
                false
            }
        });
        let first = errors.iter().filter(|(mark, _)| *mark >= from).min_by_key(|(mark, _)| *mark);
        match first {
            Some((_, error)) => Err(error.clone()),
            None => Ok(!under_way.iter().any(|(mark, _)| *mark >= from)),
        }
    }

    /// An error of work after any mark.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn refuse(&self, error: GpuError) {
        self.lock().errors.push_back((Mark(u64::MAX), error));
    }

    /// A check of work after any mark.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn delay(&self, check: Check) {
        self.lock().under_way.push((Mark(u64::MAX), check));
    }

    /// Forgets all errors.
    #[cfg(all(test, not(target_family = "wasm")))]
    pub(crate) fn forget(&self) {
        self.lock().errors.clear();
    }

    fn lock(&self) -> MutexGuard<'_, Checks> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for Deferred {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let checks = self.lock();
        f.debug_struct("Deferred")
            .field("under_way", &checks.under_way.len())
            .field("errors", &checks.errors)
            .finish()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    /// A check whose outcome is known once it is told.
    fn later(error: Option<&str>) -> (Arc<AtomicBool>, Check) {
        let told = Arc::new(AtomicBool::new(false));
        let (known, error) = (Arc::clone(&told), error.map(str::to_owned));
        let check = std::future::poll_fn(move |_| match known.load(Ordering::Relaxed) {
            true => Poll::Ready(error.clone().map(GpuError::Refused)),
            false => Poll::Pending,
        });
        (told, Box::pin(check))
    }

    #[test]
    fn work_sees_what_was_refused_since_it_began_and_nothing_before() {
        let deferred = Deferred::default();
        let before = deferred.mark();
        let (first, check) = later(Some("first"));
        deferred.add(check);
        let after = deferred.mark();
        assert_eq!(deferred.settled(before), Ok(false));
        assert_eq!(deferred.settled(after), Ok(true));
        let (second, check) = later(None);
        deferred.add(check);
        first.store(true, Ordering::Relaxed);
        let error = Err(GpuError::Refused("first".into()));
        assert_eq!(deferred.settled(before), error);
        assert_eq!(deferred.settled(after), Ok(false));
        second.store(true, Ordering::Relaxed);
        assert_eq!(deferred.settled(after), Ok(true));
        // It stays for all that was under way.
        assert_eq!(deferred.settled(before), error);
        assert_eq!(deferred.settled(deferred.mark()), Ok(true));
    }
}

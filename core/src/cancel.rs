//! Cancellation: the check between two pieces of work, for whoever does the work.

use crate::error::{BuildError, QueryError};
use crate::watch::{Progress, Stage, Watch};

/// Checks whether to continue a build.
///
/// # Errors
/// [`BuildError::Cancelled`] where the watch cancels it.
#[inline]
pub fn go_on(watch: Option<&dyn Watch>, progress: Progress) -> Result<(), BuildError> {
    match watch.is_some_and(|watch| watch.progress(&progress).is_break()) {
        true => Err(BuildError::Cancelled { progress }),
        false => Ok(()),
    }
}

/// Checks whether to continue a batch of rays.
///
/// # Errors
/// [`QueryError::Cancelled`] where the watch cancels it.
#[inline]
pub fn go_on_tracing(watch: Option<&dyn Watch>, done: u64, total: u64) -> Result<(), QueryError> {
    let progress = Progress { stage: Stage::Rays, done, total };
    match watch.is_some_and(|watch| watch.progress(&progress).is_break()) {
        true => Err(QueryError::Cancelled { done, total }),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::ops::ControlFlow;

    #[test]
    fn a_closure_is_a_watch() {
        let ends = |progress: &Progress| match progress.done {
            0 => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        };
        let at = |done| Progress { stage: Stage::Start, done, total: 4 };
        assert_eq!(go_on(Some(&ends), at(0)), Ok(()));
        assert_eq!(go_on(Some(&ends), at(1)), Err(BuildError::Cancelled { progress: at(1) }));
        assert_eq!(go_on_tracing(Some(&ends), 0, 4), Ok(()));
        let cancelled = QueryError::Cancelled { done: 3, total: 4 };
        assert_eq!(go_on_tracing(Some(&ends), 3, 4), Err(cancelled));
        assert_eq!(go_on(None, at(1)), Ok(()));
    }
}

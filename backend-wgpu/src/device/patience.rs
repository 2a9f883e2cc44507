//! How long to wait for a device.

use std::time::Duration;

use super::clock::Instant;
use crate::error::GpuError;

/// A limit of time for one wait.
#[derive(Debug)]
pub(crate) struct Patience {
    since: Instant,
    limit: Duration,
    was_over: bool,
}

impl Patience {
    pub(crate) fn new(limit: Duration) -> Patience {
        Patience { since: Instant::now(), limit, was_over: false }
    }

    /// Whether the limit is exceeded. A browser stops a page in the background for as long as it likes, so that much time may have
    /// passed in which what is waited for was not told: a page asks once more before it gives up.
    pub(crate) fn is_over(&mut self) -> bool {
        let is_over = self.since.elapsed() >= self.limit;
        let was_over = std::mem::replace(&mut self.was_over, is_over);
        is_over && (was_over || !cfg!(target_family = "wasm"))
    }

    /// The error of a wait that took longer.
    pub(crate) fn exceeded(&self) -> GpuError {
        GpuError::TimedOut { seconds: self.limit.as_secs() }
    }
}

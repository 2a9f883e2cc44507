//! Time, where the platform tells it.

use std::time::Duration;

/// Runs from when it is made. `wasm32-unknown-unknown` has no clock of its own, and asking for the time there ends the program: on it a
/// stopwatch shows nothing. Whoever uses one must do the same work without it.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    #[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
    since: std::time::Instant,
}

impl Stopwatch {
    /// A stopwatch that runs.
    pub fn start() -> Stopwatch {
        Stopwatch {
            #[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
            since: std::time::Instant::now(),
        }
    }

    /// How long it has been running; `None` where there is no clock.
    pub fn elapsed(&self) -> Option<Duration> {
        #[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
        return Some(self.since.elapsed());
        #[cfg(all(target_family = "wasm", target_os = "unknown"))]
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopwatch_never_goes_back() {
        let stopwatch = Stopwatch::start();
        let first = stopwatch.elapsed();
        assert!(first.is_some() && stopwatch.elapsed() >= first);
    }
}

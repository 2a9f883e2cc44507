//! The clock of a measurement: `PEERS_CLOCK` in the environment says which.

use std::time::{Duration, Instant};

/// What times are taken by.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Clock {
    /// Time that passes.
    Wall,
    /// CPU time of all threads of the process.
    Cpu,
}

impl Clock {
    /// The one that the environment asks for; wall time where it asks for none.
    pub(crate) fn asked() -> Result<Clock, String> {
        match std::env::var("PEERS_CLOCK").as_deref() {
            Err(_) | Ok("wall") => Ok(Clock::Wall),
            Ok("cpu") if cfg!(unix) => Ok(Clock::Cpu),
            Ok(other) => Err(format!("PEERS_CLOCK: there is no clock `{other}` here")),
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Clock::Wall => "wall",
            Clock::Cpu => "cpu",
        }
    }

    /// Seconds that work takes.
    pub(crate) fn seconds(self, work: impl FnOnce()) -> f64 {
        let start = (Instant::now(), cpu_time());
        work();
        match self {
            Clock::Wall => start.0.elapsed(),
            Clock::Cpu => cpu_time() - start.1,
        }
        .as_secs_f64()
    }
}

#[cfg(unix)]
fn cpu_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    let [seconds, nanoseconds] =
        [time.tv_sec, time.tv_nsec].map(|part| u64::try_from(part).unwrap_or(0));
    Duration::from_secs(seconds) + Duration::from_nanos(nanoseconds)
}

#[cfg(not(unix))]
fn cpu_time() -> Duration {
    Duration::ZERO
}

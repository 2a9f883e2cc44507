//! For how long a process has worked, or waited by its own choice.
//!
//! A driver that compiles on a busy machine may take many times as long as on an idle one, and none the less do its work. So the
//! time in which a process could have run, but others did, does not count. Where the system does not say, all time counts.

use std::time::Duration;

use super::clock::Instant;

/// Least time between two looks at the system's accounts, whose unit is 10 ms.
const BETWEEN: Duration = Duration::from_millis(50);
/// A limit of time ends after this many times as long whatever the machine was doing. A driver that needs half of the limit on an idle
/// machine is then given up only where it gets less than a thirtieth of one processor's time.
const LONGEST: u32 = 15;

/// The time that counts, since it was made.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    process: String,
    started: Instant,
    seen: Instant,
    /// Time on processors when it was last seen.
    ran: Option<Duration>,
    spent: Duration,
}

impl Stopwatch {
    /// For this process.
    pub(crate) fn own() -> Stopwatch {
        Stopwatch::of("self".into())
    }

    /// For a process by its number.
    pub(crate) fn of(process: String) -> Stopwatch {
        let (now, ran) = (Instant::now(), time_on_processors(&process));
        Stopwatch { process, started: now, seen: now, ran, spent: Duration::ZERO }
    }

    /// As if it had last been asked so long ago.
    #[cfg(test)]
    pub(crate) fn unseen_for(self, time: Duration) -> Stopwatch {
        Stopwatch { seen: self.seen.checked_sub(time).expect("a clock that old"), ..self }
    }

    /// Leaves out what has passed since it was asked last. What threads did meanwhile is not known, and what they do now does not tell.
    #[cfg_attr(target_family = "wasm", allow(dead_code, reason = "nothing is waited for there"))]
    pub(crate) fn resume(&mut self) {
        (self.seen, self.ran) = (Instant::now(), time_on_processors(&self.process));
    }

    /// Whether a limit is exceeded. To be asked several times a second, since it looks at what threads are doing when it is asked.
    pub(crate) fn is_over(&mut self, limit: Duration) -> bool {
        let elapsed = self.seen.elapsed();
        if elapsed >= BETWEEN || elapsed >= limit {
            let ran = time_on_processors(&self.process);
            let more = match (self.ran, ran) {
                (Some(before), Some(now)) => Some(now.saturating_sub(before)),
                _ => None,
            };
            self.spent += counted(elapsed, more, || is_ready(&self.process));
            (self.seen, self.ran) = (self.seen + elapsed, ran);
        }
        self.spent >= limit || self.started.elapsed() >= limit.saturating_mul(LONGEST)
    }
}

/// The longest that a limit of time can last.
pub(crate) fn longest(limit: Duration) -> Duration {
    limit.saturating_mul(LONGEST)
}

/// What counts of some time, in which a process has run for so long, as far as that is known, and after which it is ready to run or not.
fn counted(elapsed: Duration, ran: Option<Duration>, is_ready: impl FnOnce() -> bool) -> Duration {
    match ran {
        Some(ran) if ran < elapsed && is_ready() => ran,
        // It ran all the time, perhaps on several processors; or it waited for something other than a processor.
        _ => elapsed,
    }
}

/// How long all threads of a process have run; `None` where the system does not say. Linux does.
fn time_on_processors(process: &str) -> Option<Duration> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = after_name(&stat)?.split_ascii_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<u64>().ok();
    let (user, system) = (ticks()?, ticks()?);
    // The unit of what Linux tells programs is a hundredth of a second.
    Some(Duration::from_millis(user.checked_add(system)?.checked_mul(10)?))
}

/// Whether a thread of a process, besides the one that asks, runs or waits for a processor.
fn is_ready(process: &str) -> bool {
    let asks = std::fs::read_link("/proc/thread-self").ok();
    let asks = asks.as_deref().and_then(std::path::Path::file_name);
    let Ok(threads) = std::fs::read_dir(format!("/proc/{process}/task")) else { return false };
    threads.flatten().filter(|thread| Some(thread.file_name().as_os_str()) != asks).any(|thread| {
        let stat = std::fs::read_to_string(thread.path().join("stat"));
        stat.is_ok_and(|stat| after_name(&stat).is_some_and(|rest| rest.starts_with('R')))
    })
}

/// The fields from the state on: a name may hold anything.
fn after_name(stat: &str) -> Option<&str> {
    Some(stat.rsplit_once(')')?.1.trim_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_took_does_not_count() {
        let [second, part] = [1000, 200].map(Duration::from_millis);
        // Ready to run, but others did.
        assert_eq!(counted(second, Some(part), || true), part);
        // Asleep most of the time.
        assert_eq!(counted(second, Some(part), || false), second);
        // On several processors, or on one all the time.
        assert_eq!(counted(second, Some(3 * second), || true), second);
        // Nobody says.
        assert_eq!(counted(second, None, || true), second);
    }

    /// Between two pipelines of an opening a device builds and traces, for which others have limits.
    #[test]
    fn what_passes_before_it_is_resumed_does_not_count() {
        let limit = Duration::from_millis(200);
        let mut watch = Stopwatch::own();
        std::thread::sleep(2 * limit);
        watch.resume();
        assert!(watch.spent.is_zero() && watch.seen.elapsed() < watch.started.elapsed());
        // Without it, all of it would.
        let mut watch = Stopwatch { process: "no process".into(), ran: None, ..Stopwatch::own() };
        std::thread::sleep(limit);
        assert!(watch.is_over(limit));
    }

    #[test]
    fn fields_are_found_behind_any_name() {
        let stat = "12 (a) R (b) S 1 2 3 4 5 6 7 8 9 10 70 5 0";
        let rest = after_name(stat).unwrap();
        assert!(rest.starts_with('S'));
        assert_eq!(rest.split_ascii_whitespace().nth(11), Some("70"));
        assert_eq!(after_name("nothing"), None);
    }

    /// A process that sleeps is charged for all of it.
    #[test]
    #[cfg(target_os = "linux")]
    fn sleep_counts() {
        let mut child = std::process::Command::new("sleep").arg("600").spawn().expect("a process");
        let mut watch = Stopwatch::of(child.id().to_string());
        let start = Instant::now();
        while !watch.is_over(Duration::from_millis(200)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(start.elapsed() >= Duration::from_millis(200));
        let spent = watch.spent;
        child.kill().expect("a process");
        child.wait().expect("a process");
        assert!(spent >= Duration::from_millis(100), "{spent:?}");
        assert!(time_on_processors("no process").is_none() && !is_ready("no process"));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn work_counts() {
        let before = time_on_processors("self").expect("an account");
        let start = Instant::now();
        let mut sum = 0u64;
        while time_on_processors("self").expect("an account") < before + Duration::from_millis(50) {
            sum = std::hint::black_box((0..10_000).fold(sum, u64::wrapping_add));
            assert!(start.elapsed() < Duration::from_secs(600));
        }
    }

    #[test]
    fn no_limit_lasts_for_ever() {
        assert_eq!(longest(Duration::from_secs(20)), Duration::from_secs(300));
        assert_eq!(longest(Duration::MAX), Duration::MAX);
        assert!(Stopwatch::own().is_over(Duration::ZERO));
        assert!(!Stopwatch::own().is_over(Duration::MAX));
        let mut long_ago = Stopwatch::own();
        if let Some(started) = Instant::now().checked_sub(Duration::from_secs(16)) {
            long_ago.started = started;
            assert!(long_ago.is_over(Duration::from_secs(1)));
            assert!(!long_ago.is_over(Duration::from_secs(2)));
        }
    }
}

//! Trying a GPU adapter in a process of its own, which can be ended whatever its driver does.
//!
//! A driver compiles inside the process that opens a device, and nothing can end the thread in
//! which it does. So the program starts itself again: the child opens the adapter within the limits
//! and reports the outcome in one line. The parent watches its time and memory and ends it, at the
//! latest a little beyond the limits.

mod child;
mod outcome;

pub use child::answer_probe;
pub use outcome::Tried;

use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::device::adapters::Adapter;
use crate::device::bounded::{Bounds, private_memory_of};
use crate::device::stopwatch::Stopwatch;
use crate::error::DriverLimit;
use crate::options::OpenOptions;
use outcome::{MARK, parse};

/// The limits of a driver that is tried because it is unknown.
const TIME: Duration = Duration::from_secs(20);
/// The limits of any driver.
const MEMORY: u64 = 2 << 30;
/// Polling interval for the child process.
const LOOK: Duration = Duration::from_millis(20);
/// For the child to start, and to say which limit was exceeded.
const GRACE: Duration = Duration::from_secs(5);
/// For the system to end it.
const END: Duration = Duration::from_secs(1);

/// A command that opens a GPU adapter in a process of its own, reports the outcome, and ends:
/// usually the program itself, with arguments that tell it to call [`answer_probe`] and nothing
/// else.
///
/// ```no_run
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use splitplane_wgpu::probe::{Probe, answer_probe};
/// use splitplane_wgpu::{Adapters, OpenOptions};
///
/// let arguments: Vec<_> = std::env::args_os().skip(1).collect();
/// if arguments.first().is_some_and(|first| first == "try-adapter") {
///     return Ok(answer_probe(&arguments[1..], &mut std::io::stdout())?);
/// }
/// let probe = Probe {
///     program: std::env::current_exe()?,
///     arguments: vec!["try-adapter".into()],
/// };
/// for adapter in Adapters::find().list() {
///     println!("{}: {:?}", adapter.name(), probe.run(adapter, &OpenOptions::default()));
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Probe {
    /// The program.
    pub program: PathBuf,
    /// Its first arguments. Those that name the adapter and the limits follow.
    pub arguments: Vec<OsString>,
}

impl Probe {
    /// Opens and tests an adapter in a process of its own. Of the options only the driver's limits
    /// apply; when they are `None`, an unknown driver may take 20 seconds, and any driver 2 GiB. Where the system says, the time in
    /// which the child could have run, but others did, does not count, up to fifteen times the limit.
    pub fn run(&self, adapter: &Adapter, options: &OpenOptions) -> Tried {
        run(self, adapter.index(), adapter.name(), bounds(adapter, options))
    }

    /// As [`Probe::run`] for an adapter with an unknown driver ([`Adapter::is_trusted`]), once in
    /// the life of this process unless it exceeded a limit or died; `None` for the others, which
    /// need no trial.
    pub fn run_unknown(&self, adapter: &Adapter, options: &OpenOptions) -> Option<Tried> {
        static FINE: Mutex<Vec<String>> = Mutex::new(Vec::new());
        if adapter.is_trusted() {
            return None;
        }
        let info = adapter.info();
        let identity =
            format!("{:?} {} {} {}", info.backend, info.name, info.driver, info.driver_info);
        let fine = || FINE.lock().unwrap_or_else(PoisonError::into_inner);
        if fine().contains(&identity) {
            return None;
        }
        let tried = self.run(adapter, options);
        if matches!(tried, Tried::Parity(_) | Tried::Failed(_)) {
            fine().push(identity);
        }
        Some(tried)
    }
}

/// The driver's limits in the child.
fn bounds(adapter: &Adapter, options: &OpenOptions) -> Bounds {
    let time = if adapter.is_trusted() { adapter.default_driver_time() } else { TIME };
    Bounds {
        time: options.driver_time.unwrap_or(time),
        memory: options.driver_memory.unwrap_or(MEMORY),
    }
}

/// Starts the child and watches it.
fn run(probe: &Probe, index: usize, name: &str, bounds: Bounds) -> Tried {
    let Bounds { time, memory } = bounds;
    let started = Command::new(&probe.program)
        .args(&probe.arguments)
        .args([index.to_string(), name.to_owned()])
        .args([time.as_millis().to_string(), memory.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut child) = started else { return Tried::NotStarted };
    // As long as this is open, the parent waits for the child.
    let waits: Option<ChildStdin> = child.stdin.take();
    let (send, receive) = mpsc::channel();
    let output = child.stdout.take();
    let reading = thread::Builder::new().spawn(move || {
        let lines = output.into_iter().flat_map(|output| BufReader::new(output).lines());
        let said =
            lines.map_while(Result::ok).find_map(|line| parse(line.strip_prefix(MARK)?, bounds));
        // The receiver is gone if it took too long.
        let _ = send.send(said);
    });
    let tried = match reading {
        Ok(_) => watch(&child, &receive, bounds),
        Err(_) => Some(Tried::NotStarted),
    };
    let status = end(&mut child, tried.is_none());
    drop(waits);
    tried.unwrap_or_else(|| {
        Tried::Died(match status {
            Some(status) => format!("its driver ended the process that tried it ({status})"),
            None => "the process that tried it said nothing".into(),
        })
    })
}

/// What the child says; `None` if it ends without a word.
fn watch(child: &Child, said: &mpsc::Receiver<Option<Tried>>, bounds: Bounds) -> Option<Tried> {
    let Bounds { time, memory } = bounds;
    let mut spent = Stopwatch::of(child.id().to_string());
    // The child keeps the limits too, and knows better what it was doing.
    let (longest, most) = (time.saturating_add(GRACE), memory.saturating_add(memory / 4));
    let exceeded = |limit| Some(Tried::Exceeded { doing: "opening a device".into(), limit });
    loop {
        match said.recv_timeout(LOOK) {
            Ok(said) => return said,
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if private_memory_of(&child.id().to_string()).is_some_and(|bytes| bytes > most) {
            return exceeded(DriverLimit::Memory(memory));
        }
        if spent.is_over(longest) {
            return exceeded(DriverLimit::Time(time));
        }
    }
}

/// Ends the child; one that ends by itself may do so in its own way. A process that the system cannot end is left.
fn end(child: &mut Child, by_itself: bool) -> Option<ExitStatus> {
    let start = Instant::now();
    let mut killed = !by_itself && child.kill().is_ok();
    loop {
        if let Ok(Some(status)) = child.try_wait() {
            return Some(status);
        }
        if start.elapsed() >= END {
            if killed {
                return None;
            }
            killed = child.kill().is_ok();
        }
        if start.elapsed() >= 2 * END {
            return None;
        }
        thread::sleep(Duration::from_millis(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parity::Parity;

    const BOUNDS: Bounds = Bounds { time: Duration::from_secs(600), memory: u64::MAX };

    #[cfg(unix)]
    fn shell(script: &str, bounds: Bounds) -> Tried {
        let arguments = vec!["-c".into(), script.into()];
        run(&Probe { program: "sh".into(), arguments }, 3, "card", bounds)
    }

    #[test]
    #[cfg(unix)]
    fn a_child_is_given_the_adapter_and_the_limits_and_heard() {
        let script =
            "echo 'hello from a driver'; echo \"splitplane probe: structural $0 $1 $2 $3\"";
        let bounds = Bounds { memory: 1 << 40, ..BOUNDS };
        let expected = Parity::Structural("3 card 600000 1099511627776".into());
        assert_eq!(shell(script, bounds), Tried::Parity(expected));
        // It may have more to do, but nothing waits for that.
        let script = "echo 'splitplane probe: bitwise'; read forever";
        assert_eq!(shell(script, BOUNDS), Tried::Parity(Parity::Bitwise));
    }

    #[test]
    #[cfg(unix)]
    fn a_child_that_does_not_end_is_ended() {
        // Standard input stays open for as long as the parent waits.
        let bounds = Bounds { time: Duration::ZERO, ..BOUNDS };
        let limit = DriverLimit::Time(Duration::ZERO);
        let doing = "opening a device".to_owned();
        assert_eq!(shell("read forever", bounds), Tried::Exceeded { doing, limit });
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_child_that_takes_memory_without_end_is_ended() {
        let bounds = Bounds { memory: 16 << 20, ..BOUNDS };
        let script = "x=$(head -c 64000000 /dev/zero | tr '\\0' x); read forever";
        let limit = DriverLimit::Memory(16 << 20);
        let doing = "opening a device".to_owned();
        assert_eq!(shell(script, bounds), Tried::Exceeded { doing, limit });
    }

    #[test]
    #[cfg(unix)]
    fn a_child_that_a_driver_ends_says_how() {
        let died = |script: &str| match shell(script, BOUNDS) {
            Tried::Died(reason) => reason,
            other => panic!("{other:?}"),
        };
        let reason = died("kill -SEGV $$");
        assert!(
            reason.starts_with("its driver ended the process that tried it (signal: 11"),
            "{reason}"
        );
        assert!(died("echo splitplane; exit 3").contains("(exit status: 3)"));
    }

    #[test]
    fn a_child_that_cannot_be_started_tries_nothing() {
        let probe = Probe { program: "/nonexistent/program".into(), arguments: Vec::new() };
        assert_eq!(run(&probe, 0, "card", BOUNDS), Tried::NotStarted);
    }
}

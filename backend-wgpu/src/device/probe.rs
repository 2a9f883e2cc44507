//! Trying a GPU adapter in a process of its own, which can be ended whatever its driver does.
//!
//! A driver compiles inside the process that opens a device, and nothing can end the thread in
//! which it does. So the program starts itself again: the child opens the adapter within the limits
//! and reports the outcome in one line. The parent watches its time and memory and ends it, at the
//! latest a little beyond the limits.

use std::ffi::OsString;
use std::fmt::Display;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::adapters::{Adapter, Adapters};
use crate::backend::WgpuBackend;
use crate::device::bounded::{Bounds, private_memory_of};
use crate::error::{DriverLimit, GpuError, OpenError};
use crate::gpu::Gpu;
use crate::options::OpenOptions;
use crate::parity::Parity;

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
/// What the child's line begins with. Drivers may print too.
const MARK: &str = "splitplane probe: ";

/// The outcome of trying an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Tried {
    /// It was opened and tested.
    Parity(Parity),
    /// It would not open, or failed its test; in words.
    Failed(String),
    /// Its driver exceeded a limit.
    Exceeded {
        /// What it was doing.
        doing: String,
        /// The limit.
        limit: DriverLimit,
    },
    /// The child ended without a word; in words, how.
    Died(String),
    /// There is no such process: nothing was tried.
    NotStarted,
}

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
    /// apply; when they are `None`, an unknown driver may take 20 seconds, and any driver 2 GiB.
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
    let start = Instant::now();
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
        if start.elapsed() >= longest {
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

/// A line of the child's, without its mark.
fn parse(line: &str, bounds: Bounds) -> Option<Tried> {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    let exceeded = |limit| Tried::Exceeded { doing: rest.to_owned(), limit };
    Some(match word {
        "bitwise" => Tried::Parity(Parity::Bitwise),
        "structural" => Tried::Parity(Parity::Structural(rest.to_owned())),
        "failed" => Tried::Failed(rest.to_owned()),
        "time" => exceeded(DriverLimit::Time(bounds.time)),
        "memory" => exceeded(DriverLimit::Memory(bounds.memory)),
        _ => return None,
    })
}

/// The child's line. Texts of drivers may have several.
fn say(word: &str, text: impl Display) -> String {
    let text = text.to_string();
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("{MARK}{word} {text}").trim_end().to_owned() + "\n"
}

/// The work of the process that a [`Probe`] starts: opens and tests the adapter that the arguments
/// name, and writes the outcome to `out`, which is its standard output. The arguments are those
/// that follow [`Probe::arguments`]. The process must end then; if its parent ends earlier, the
/// process ends too.
///
/// # Errors
/// Arguments that are no probe's, or an output that nobody reads.
pub fn answer_probe(arguments: &[OsString], out: &mut dyn Write) -> io::Result<()> {
    let asked = Asked::parse(arguments).ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidInput, "only a probe of splitplane's asks for this")
    })?;
    // It is open for as long as the parent waits.
    thread::Builder::new().spawn(|| {
        let _ = io::stdin().read_to_end(&mut Vec::new());
        std::process::exit(0);
    })?;
    out.write_all(asked.answer().as_bytes())?;
    out.flush()
}

/// What the parent asks.
#[derive(Debug, PartialEq, Eq)]
struct Asked {
    index: usize,
    name: String,
    time: Duration,
    memory: u64,
}

impl Asked {
    fn parse(arguments: &[OsString]) -> Option<Asked> {
        let [index, name, time, memory] = arguments else { return None };
        let number = |text: &OsString| text.to_str()?.parse::<u64>().ok();
        Some(Asked {
            index: usize::try_from(number(index)?).ok()?,
            name: name.to_str()?.to_owned(),
            time: Duration::from_millis(number(time)?),
            memory: number(memory)?,
        })
    }

    fn answer(&self) -> String {
        let adapters = Adapters::find();
        let list = adapters.list();
        let same = |adapter: &&Adapter| adapter.name() == self.name;
        let adapter = list.get(self.index).filter(same).or_else(|| list.iter().find(same));
        let Some(adapter) = adapter else {
            return say("failed", format_args!("no GPU adapter is called `{}`", self.name));
        };
        let options = OpenOptions {
            timeout: Some(self.time),
            driver_time: Some(self.time),
            driver_memory: Some(self.memory),
            ..OpenOptions::default()
        };
        match adapter.open(&options) {
            Ok(gpu) => told(tested(gpu)),
            Err(OpenError::DriverLimit { doing, limit, .. }) => over(&doing, limit),
            Err(OpenError::Unusable { reason, .. }) => say("failed", reason),
            Err(error) => say("failed", error),
        }
    }
}

/// What the self-test finds.
fn tested(gpu: Gpu) -> Result<Parity, GpuError> {
    let backend = WgpuBackend::new(gpu)?;
    Ok(backend.parity().cloned().expect("`new` has tested it"))
}

fn told(tested: Result<Parity, GpuError>) -> String {
    match tested {
        Ok(Parity::Bitwise) => say("bitwise", ""),
        Ok(Parity::Structural(difference)) => say("structural", difference),
        Err(GpuError::DriverLimit { doing, limit }) => over(&doing, limit),
        Err(error) => say("failed", format_args!("its self-test did not run: {error}")),
    }
}

fn over(doing: &str, limit: DriverLimit) -> String {
    match limit {
        DriverLimit::Memory(_) => say("memory", doing),
        _ => say("time", doing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds { time: Duration::from_secs(600), memory: u64::MAX };

    #[test]
    fn what_the_child_says_comes_across() {
        let across = |line: String| parse(line.strip_prefix(MARK)?.trim_end(), BOUNDS);
        assert_eq!(across(told(Ok(Parity::Bitwise))), Some(Tried::Parity(Parity::Bitwise)));
        let structural = Parity::Structural("the quotient of 1 and 3".into());
        assert_eq!(across(told(Ok(structural.clone()))), Some(Tried::Parity(structural)));
        let refused = GpuError::Refused("line one\nsplitplane probe: bitwise".into());
        let line = told(Err(refused));
        assert_eq!(line.lines().count(), 1);
        assert!(matches!(across(line), Some(Tried::Failed(text)) if text.ends_with("bitwise")));
        for limit in [DriverLimit::Time(BOUNDS.time), DriverLimit::Memory(BOUNDS.memory)] {
            let doing = "compiling `x y`".to_owned();
            let line = told(Err(GpuError::DriverLimit { doing: doing.clone(), limit }));
            assert_eq!(across(line), Some(Tried::Exceeded { doing, limit }));
        }
        assert_eq!(parse("what a driver prints", BOUNDS), None);
    }

    #[test]
    fn what_the_parent_asks_comes_across() {
        let asked = |arguments: &[&str]| {
            Asked::parse(&arguments.iter().map(OsString::from).collect::<Vec<_>>())
        };
        let time = Duration::from_secs(20);
        let full = Asked { index: 1, name: "a b".into(), time, memory: 7 };
        assert_eq!(asked(&["1", "a b", "20000", "7"]), Some(full));
        for wrong in [&["1", "a", "2"][..], &["", "a", "2", "3"], &["1", "a", "2", "-3"], &[]] {
            assert_eq!(asked(wrong), None, "{wrong:?}");
        }
    }

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

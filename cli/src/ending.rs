//! Ends before a run is done: Ctrl-C, signals that ask it to end, and `--timeout`.
//!
//! Work that is watched ends by itself with an error. What is not (a file that is read, a frame on its way)
//! gets a moment, then the program ends without it. Either way no file is left half written, one
//! sentence says where the run was, and the code is 7.

use super::failure::{CANCELLED, Failure};
use super::output;
use clap::Args;
use indicatif::ProgressBar;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::SeqCst};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// For work that ends by itself to do so.
const GRACE: Duration = Duration::from_millis(700);

const GOES_ON: u8 = 0;
const INTERRUPTED: u8 = 1;
const TIMED_OUT: u8 = 2;

/// Why the run is to end.
static CAUSE: AtomicU8 = AtomicU8::new(GOES_ON);
/// Whether somebody has begun to end it.
static ENDING: AtomicBool = AtomicBool::new(false);
static START: OnceLock<Instant> = OnceLock::new();
static LIMIT: OnceLock<Duration> = OnceLock::new();
/// What is being done, and since when.
static DOING: Mutex<Option<Doing>> = Mutex::new(None);
/// Files that were written and are whole.
static WHOLE: AtomicU32 = AtomicU32::new(0);
/// Files that are not whole yet, and folders for them.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Held while files that belong together get their names.
static NAMING: Mutex<()> = Mutex::new(());

struct Doing {
    what: String,
    bar: ProgressBar,
    since: Instant,
}

/// `--timeout`, for every verb.
#[derive(Args, Clone, Copy, Debug)]
pub(super) struct TimeLimit {
    /// End the run with code 7 when it takes longer; fractions of seconds may be given
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    timeout: Option<Duration>,
}

impl TimeLimit {
    /// From now on the limit counts, from the start of the program.
    pub(super) fn begin(self) {
        let Some(limit) = self.timeout else { return };
        if LIMIT.set(limit).is_err() {
            return;
        }
        let left = limit.saturating_sub(START.get_or_init(Instant::now).elapsed());
        if left.is_zero() {
            end(TIMED_OUT);
        } else {
            // Where no thread can be started, what is watched ends all the same.
            let _ = thread::Builder::new().spawn(move || {
                thread::sleep(left);
                end(TIMED_OUT);
            });
        }
    }
}

/// From now on Ctrl-C ends the run, and so do SIGTERM and SIGHUP where there are signals.
pub(super) fn install() {
    START.get_or_init(Instant::now);
    if let Err(error) = ctrlc::set_handler(|| end(INTERRUPTED)) {
        output::note(&format!(
            "splitplane: Ctrl-C ends the program without its exit code: {error}"
        ));
    }
    #[cfg(unix)]
    if let Err(error) = signals::listen(|| end(INTERRUPTED)) {
        output::note(&format!(
            "splitplane: signals end the program without its exit code: {error}"
        ));
    }
}

/// Signals that ask a program to end.
#[cfg(unix)]
mod signals {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    use signal_hook::iterator::Signals;
    use std::io;
    use std::thread;

    /// Calls back at every one, on a thread of its own.
    pub(super) fn listen(mut asked: impl FnMut() + Send + 'static) -> io::Result<()> {
        // Whoever starts a program so that it outlives the terminal (nohup) has it ignore the signal.
        let wanted = [SIGTERM, SIGHUP].into_iter().filter(|signal| !is_ignored(*signal));
        let mut signals = Signals::new(wanted)?;
        let listening = move || signals.forever().for_each(|_| asked());
        thread::Builder::new().spawn(listening).map(drop)
    }

    /// Whether the program was started to ignore a signal.
    #[cfg(target_os = "linux")]
    fn is_ignored(signal: i32) -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
        mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
    }

    /// The same where the system does not tell: nohup leaves no terminal.
    #[cfg(not(target_os = "linux"))]
    fn is_ignored(signal: i32) -> bool {
        use std::io::IsTerminal;
        let terminal =
            io::stdin().is_terminal() || io::stdout().is_terminal() || io::stderr().is_terminal();
        signal == SIGHUP && !terminal
    }
}

/// Asks the run to end; without grace when Ctrl-C or a signal asks for the second time.
fn end(cause: u8) {
    if let Err(before) = CAUSE.compare_exchange(GOES_ON, cause, SeqCst, SeqCst) {
        if skips_grace(before, cause) {
            leave();
        }
    } else {
        let waiting = thread::Builder::new().spawn(|| {
            thread::sleep(GRACE);
            leave();
        });
        if waiting.is_err() {
            leave();
        }
    }
}

/// Whether a run that was asked to end is to do so at once. Not when its time is found to be up from two
/// sides.
fn skips_grace(before: u8, cause: u8) -> bool {
    before == INTERRUPTED && cause == INTERRUPTED
}

/// Ends the program here and now.
fn leave() {
    if ENDING.swap(true, SeqCst) {
        // Another thread is at it.
        return;
    }
    // Files that belong together appear together: they get their names first.
    let _undivided = undivided();
    let failure = failure();
    // The last first: files before their folder.
    for part in lock(&PARTS).drain(..).rev() {
        // It may never have been there. A folder goes when nothing lies in it.
        let _ = std::fs::remove_file(&part).or_else(|_| std::fs::remove_dir(&part));
    }
    output::report(&failure);
    std::process::exit(CANCELLED.into());
}

/// Whether the run is to end.
pub(super) fn is_due() -> bool {
    let over = || {
        let limit = LIMIT.get().zip(START.get());
        limit.is_some_and(|(limit, start)| start.elapsed() >= *limit)
    };
    if CAUSE.load(SeqCst) == GOES_ON && over() {
        end(TIMED_OUT);
    }
    CAUSE.load(SeqCst) != GOES_ON
}

/// To be asked before a file is written or takes its name.
///
/// # Errors
/// The run is to end.
pub(super) fn check() -> Result<(), Failure> {
    if is_due() { Err(failure()) } else { Ok(()) }
}

/// The last word of a run that failed: of one that was to end, where it was. `None` when another thread is about
/// to end the program.
pub(super) fn last_word(failed: Failure) -> Option<Failure> {
    if CAUSE.load(SeqCst) == GOES_ON {
        return Some(failed);
    }
    (!ENDING.swap(true, SeqCst)).then(failure)
}

/// What is being done now.
pub(super) fn doing(what: &str, bar: &ProgressBar) {
    let doing = Doing { what: what.to_owned(), bar: bar.clone(), since: Instant::now() };
    *lock(&DOING) = Some(doing);
}

/// As long as this is held, the program does not end.
pub(super) fn undivided() -> MutexGuard<'static, ()> {
    lock(&NAMING)
}

/// A file that is not whole yet, or a new folder for such.
pub(super) fn begun(part: &Path) {
    lock(&PARTS).push(part.to_owned());
}

/// A run that succeeded ends as such, though its time ran out since; unless another thread is about to end the
/// program.
pub(super) fn succeeded() {
    if ENDING.swap(true, SeqCst) {
        wait();
    }
}

/// Another thread ends the program.
pub(super) fn wait() -> ! {
    loop {
        thread::park();
    }
}

/// A file that was written and is whole: it stays, however the run ends.
pub(super) fn kept() {
    WHOLE.fetch_add(1, SeqCst);
}

/// A file that is whole, or gone; a folder likewise.
pub(super) fn done(part: &Path) {
    lock(&PARTS).retain(|other| other != part);
}

fn failure() -> Failure {
    let limit = LIMIT.get().map_or(0.0, Duration::as_secs_f64);
    let why = match CAUSE.load(SeqCst) {
        TIMED_OUT => format!("the time limit of {limit} seconds ran out"),
        _ => "cancelled".to_owned(),
    };
    let place = match &*lock(&DOING) {
        None => "before anything was done".to_owned(),
        Some(doing) => doing.describe(),
    };
    let whole = match WHOLE.load(SeqCst) {
        0 => String::new(),
        1 => "; 1 file is written and whole".to_owned(),
        files => format!("; {files} files are written and whole"),
    };
    Failure::cancelled(format!("{why} {place}{whole}"))
}

impl Doing {
    /// Where the work is, and what all of it would take at its pace.
    fn describe(&self) -> String {
        let (done, total) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let what = &self.what;
        if total == 0 {
            return format!("in: {what}");
        }
        let mut text = format!("in: {what}, {done} of {total} done");
        if done > 0 && done < total {
            let rest = self.since.elapsed().as_secs_f64() * (total - done) as f64 / done as f64;
            text += &format!("; this alone needs {rest:.1} seconds more at this pace");
        }
        text
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// `10`, `0.25`.
fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    number.ok_or_else(|| "give seconds, such as 10 or 0.25".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_second_interrupt_skips_the_grace() {
        assert!(skips_grace(INTERRUPTED, INTERRUPTED));
        assert!(!skips_grace(TIMED_OUT, TIMED_OUT));
        assert!(!skips_grace(TIMED_OUT, INTERRUPTED) && !skips_grace(INTERRUPTED, TIMED_OUT));
    }

    #[test]
    fn seconds_with_fractions() {
        assert_eq!(seconds("0"), Ok(Duration::ZERO));
        assert_eq!(seconds("1.5"), Ok(Duration::from_millis(1500)));
        for bad in ["", "-1", "NaN", "inf", "1e300", "5s"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }
}

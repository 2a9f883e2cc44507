//! What a run prints: data to standard output, everything else to standard error.

use super::failure::Failure;
use splitplane_scene::from_file::{printable, quoted_reason};
use std::io::{self, Write};

/// From this length on an error is shortened; none of ours is as long.
const LONG_ERROR: usize = 4000;

/// Prints data. A reader that went away ends the run quietly. Does not ask whether time is up: what is
/// printed is known, and files of it may be whole.
pub(super) fn data(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let written = out.write_all(printable(text).as_bytes()).and_then(|()| out.flush());
    written.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::nobody_listens(),
        _ => Failure::file(format!("cannot write to standard output: {error}")),
    })
}

/// Prints one line of what is not data. That nobody reads it is no failure.
pub(super) fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", printable(text));
}

/// Prints an error in one line.
pub(super) fn error(text: &str) {
    let line = text.replace(['\n', '\r'], " ");
    if line.len() > LONG_ERROR {
        note(&format!("splitplane: {}", quoted_reason(&line)));
    } else {
        note(&format!("splitplane: {line}"));
    }
}

/// Prints why a run ends before it is done, unless nobody listens.
pub(super) fn report(failure: &Failure) {
    if !failure.message().is_empty() {
        error(failure.message());
    }
}

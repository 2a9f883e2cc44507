//! Data to standard output, everything else to standard error, and files as a whole or not at all.

use super::failure::Failure;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Prints data. A reader that went away ends the run quietly.
pub(super) fn data(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Failure::nobody_listens(),
        _ => Failure::file(format!("cannot write to standard output: {error}")),
    })
}

/// Prints one line of what is not data. That nobody reads it is no failure.
pub(super) fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Prints an error in one line.
pub(super) fn error(text: &str) {
    note(&format!("splitplane: {}", text.replace(['\n', '\r'], " ")));
}

/// Writes a file under another name beside it, then renames it, so that a run that is cut short
/// leaves the old file or none. What is there and is no regular file (a pipe, a device) is written
/// to directly.
pub(super) fn file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let special = fs::metadata(path).is_ok_and(|about| !about.is_file());
    let written = if special {
        fs::OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(bytes))
    } else {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let part: PathBuf = path.with_file_name(name);
        let written = fs::write(&part, bytes).and_then(|()| fs::rename(&part, path));
        if written.is_err() {
            // It may never have been there; the first error is the one to tell.
            let _ = fs::remove_file(&part);
        }
        written
    };
    written.map_err(|error| {
        Failure::file(format!(
            "cannot write `{}`: {error}; check that the folder exists and may be written to",
            path.display()
        ))
    })
}

/// Whether a file's name has this ending, in upper or lower case.
pub(super) fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// Refuses names of pictures that do not end in `.png`.
#[cfg(feature = "viewer")]
pub(super) fn check_ending(path: &Path) -> Result<(), Failure> {
    if ends_in(path, "png") {
        return Ok(());
    }
    let shown = path.display();
    Err(Failure::usage(format!("`{shown}` does not end in .png; screenshots are written as PNG")))
}

/// A file that is being written under another name beside its own. Dropped before it is kept, it
/// leaves nothing behind, and the old file as it was.
pub(super) struct Part {
    part: PathBuf,
    path: PathBuf,
}

impl Part {
    /// Begins a file; what is written to the handle goes to the other name.
    pub(super) fn create(path: &Path) -> Result<(Part, fs::File), Failure> {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let part = Part { part: path.with_file_name(name), path: path.to_owned() };
        let file = fs::File::create(&part.part).map_err(|error| part.failed(&error))?;
        Ok((part, file))
    }

    /// Gives the file its own name. It must be whole.
    pub(super) fn keep(self) -> Result<(), Failure> {
        fs::rename(&self.part, &self.path).map_err(|error| self.failed(&error))
    }

    fn failed(&self, error: &io::Error) -> Failure {
        Failure::file(format!(
            "cannot write `{}`: {error}; check that the folder exists and may be written to",
            self.path.display()
        ))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // After it was kept there is nothing of this name.
        let _ = fs::remove_file(&self.part);
    }
}

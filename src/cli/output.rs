//! Data to standard output, everything else to standard error, and files as a whole or not at all.

use super::ending;
use super::failure::Failure;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Prints data. A reader that went away ends the run quietly. Does not ask whether time is up: what is
/// printed is known, and files of it may be whole.
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
    ending::check()?;
    if fs::metadata(path).is_ok_and(|about| !about.is_file()) {
        let written = fs::OpenOptions::new()
            .write(true)
            .open(path)
            .and_then(|mut file| file.write_all(bytes));
        return written.map(|()| ending::kept()).map_err(|error| unwritten(path, &error));
    }
    let (part, mut file) = Part::create(path)?;
    file.write_all(bytes).map_err(|error| unwritten(path, &error))?;
    part.keep()
}

fn unwritten(path: &Path, error: &io::Error) -> Failure {
    Failure::file(format!(
        "cannot write `{}`: {error}; check that the folder exists and may be written to",
        path.display()
    ))
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

/// A folder that a run writes to. Dropped, or when the run is ended, it is gone again if the run made it
/// and nothing lies in it.
pub(super) struct Folder {
    made: Option<PathBuf>,
}

impl Folder {
    /// Makes the folder where it is not there. To be called before anything is measured: that it cannot be
    /// made is said first.
    pub(super) fn make(path: &Path) -> Result<Folder, Failure> {
        let made = (!path.exists()).then(|| path.to_owned());
        if let Some(made) = &made {
            ending::begun(made);
        }
        let folder = Folder { made };
        fs::create_dir_all(path).map_err(|error| {
            Failure::file(format!("cannot make the folder `{}`: {error}", path.display()))
        })?;
        Ok(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if let Some(made) = &self.made {
            // What the run or others have put there keeps it.
            let _ = fs::remove_dir(made);
            ending::done(made);
        }
    }
}

/// Writes files, all of them before the first gets its name: a run that is cut short leaves the old ones or
/// none.
pub(super) fn files<'a>(
    files: impl IntoIterator<Item = (PathBuf, &'a [u8])>,
) -> Result<(), Failure> {
    let mut parts = Vec::new();
    for (path, bytes) in files {
        let (part, mut file) = Part::create(&path)?;
        file.write_all(bytes).map_err(|error| unwritten(&path, &error))?;
        parts.push(part);
    }
    parts.into_iter().try_for_each(Part::keep)
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
        ending::begun(&part.part);
        let file = fs::File::create(&part.part).map_err(|error| unwritten(path, &error))?;
        Ok((part, file))
    }

    /// Gives the file its own name. It must be whole.
    pub(super) fn keep(self) -> Result<(), Failure> {
        ending::check()?;
        fs::rename(&self.part, &self.path).map_err(|error| unwritten(&self.path, &error))?;
        ending::kept();
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // After it was kept there is nothing of this name.
        let _ = fs::remove_file(&self.part);
        ending::done(&self.part);
    }
}

//! A folder for the files that targets write.

use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

thread_local! {
    static FOLDER: TempDir = tempfile::tempdir().expect("a temporary folder");
}

/// A path in a folder that is the thread's own and goes when it ends.
pub(crate) fn path(name: &str) -> PathBuf {
    FOLDER.with(|folder| folder.path().join(name))
}

/// Writes a file into the folder.
pub(crate) fn write(name: &str, bytes: &[u8]) -> PathBuf {
    let path = path(name);
    fs::write(&path, bytes).expect("the temporary folder can be written to");
    path
}

/// Removes a file that an input before this one may have left.
pub(crate) fn remove(path: &Path) {
    // That it was never there is as well.
    let _ = fs::remove_file(path);
}

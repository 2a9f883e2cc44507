//! The program from outside.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

pub(crate) fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// The program in a folder.
pub(crate) fn program(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
    command.current_dir(folder).env_remove("RUST_BACKTRACE");
    // What the machine has must not matter: no adapter is found.
    command.env("WGPU_BACKEND", "vulkan").env_remove("WGPU_ADAPTER_NAME");
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    command
}

pub(crate) fn run(folder: &Path, arguments: &[&str]) -> Output {
    program(folder).args(arguments).output().unwrap()
}

/// Expects this exit code, and gives what is printed and what is said beside it.
#[track_caller]
pub(crate) fn ends(folder: &TempDir, code: i32, arguments: &[&str]) -> (String, String) {
    let output = run(folder.path(), arguments);
    let (out, error) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    (out, error)
}

/// Expects success, and gives what is printed.
#[track_caller]
pub(crate) fn succeed(folder: &TempDir, arguments: &[&str]) -> String {
    ends(folder, 0, arguments).0
}

/// Expects this exit code, and gives what is said.
#[track_caller]
pub(crate) fn fail(folder: &TempDir, code: i32, arguments: &[&str]) -> String {
    ends(folder, code, arguments).1
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Names of the files of a folder, in order.
pub(crate) fn files(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    names
}

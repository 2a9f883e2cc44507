//! Builds and runs a program without std on top of the core: `tests/no_std`.
//!
//! The program has its own panic handler, so it cannot be compiled if anything below it links std;
//! a build that does link std is tried too, and must be refused for that reason.

#![cfg(unix)]

use std::path::Path;
use std::process::{Command, Output};

/// Builds the program with these features, in a folder of its own: tests run side by side.
fn build(features: &str) -> (Output, std::path::PathBuf) {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/no_std/Cargo.toml");
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("no_std-{features}"));
    let output = Command::new(env!("CARGO"))
        .args(["build", "--release", "--locked", "--features", features, "--manifest-path"])
        .arg(manifest)
        .arg("--target-dir")
        .arg(&target)
        // Flags of the surrounding build, such as coverage, would bring std back in.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        // scripts/run_test.sh sets it for the harness alone.
        .env_remove("RUSTC_BOOTSTRAP")
        .output()
        .expect("cargo runs");
    (output, target.join("release/splitplane-no-std"))
}

fn builds_and_runs(features: &str) {
    let (output, program) = build(features);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "the core does not build without std:\n{errors}");
    let status = Command::new(program).status().expect("the program runs");
    assert_eq!(status.code(), Some(0), "the number of the first wrong answer");
}

#[test]
fn core_without_std_and_without_allocator() {
    builds_and_runs("");
}

#[test]
fn core_without_std_with_an_allocator() {
    builds_and_runs("alloc");
}

/// The proof can fail: with std anywhere in the graph there are two panic handlers.
#[test]
fn a_program_that_links_std_is_refused() {
    let (output, _) = build("links-std");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(errors.contains("panic_impl"), "refused for another reason:\n{errors}");
}

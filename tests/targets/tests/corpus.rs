//! Inputs that are kept, and some of chance, through the functions that fuzzers call.
//!
//! `tests/corpus/TARGET` holds, for each target, inputs that a fuzzer once broke something with and
//! some that reach far; their names say which. Whatever is added there is run.

use splitplane_fuzz_targets::{ALL, Target};
use splitplane_test_support::random::Random;
use std::collections::BTreeSet;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Inputs of chance for each target.
const RANDOM: u64 = 1500;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../corpus")
}

/// Runs a target and names the input it fails on.
fn run(name: &str, target: Target, input: &str, bytes: &[u8]) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| target(bytes))) {
        eprintln!("target {name} fails on {input}: {bytes:?}");
        std::panic::resume_unwind(panic);
    }
}

#[test]
fn kept_inputs_do_no_harm() {
    for (name, target) in ALL {
        let folder = corpus().join(name);
        let mut files: Vec<PathBuf> = fs::read_dir(&folder)
            .unwrap_or_else(|error| panic!("no corpus of {name}: {error}"))
            .map(|entry| entry.expect("a readable folder").path())
            .collect();
        files.sort();
        assert!(!files.is_empty(), "the corpus of {name} is empty");
        for file in files {
            let bytes = fs::read(&file).expect("a readable file");
            run(name, target, &file.display().to_string(), &bytes);
        }
    }
}

/// Bytes of chance get into every corner of a grammar, if not of a program.
#[test]
fn bytes_of_chance_do_no_harm() {
    for (name, target) in ALL {
        for seed in 0..RANDOM {
            let mut random = Random::new(seed);
            let length = random.below(600);
            let bytes: Vec<u8> = (0..length).map(|_| random.bits() as u8).collect();
            run(name, target, &format!("seed {seed}"), &bytes);
        }
    }
}

/// No target without a program, no program without a target, no folder of another name.
#[test]
fn targets_programs_and_folders_have_the_same_names() {
    let names = |folder: PathBuf| -> BTreeSet<String> {
        fs::read_dir(folder)
            .expect("a readable folder")
            .filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_str()?.to_owned()))
            .collect()
    };
    let targets: BTreeSet<String> = ALL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(targets, names(corpus()));
    assert_eq!(targets, names(corpus().join("../../fuzz/fuzz_targets")));
    let manifest = fs::read_to_string(corpus().join("../../fuzz/Cargo.toml")).expect("a manifest");
    for name in &targets {
        assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
    }
}

/// A target that fails is seen to fail.
#[test]
#[should_panic(expected = "a planted fault")]
fn a_failing_target_fails() {
    run("planted", |bytes| assert!(bytes.is_empty(), "a planted fault"), "one byte", &[0]);
}

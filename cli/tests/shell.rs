//! Completions and manual pages: they know every verb and every option that the help knows.

use std::path::Path;
use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
    command.args(arguments).output().expect("the program starts")
}

fn succeed(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The verbs that the help lists.
fn verbs() -> Vec<String> {
    let help = succeed(&["--help"]);
    let list = help.split("Commands:\n").nth(1).expect("a list of verbs");
    let list = list.split("\n\n").next().expect("its lines");
    let verbs: Vec<String> = list
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|verb| *verb != "help")
        .map(str::to_owned)
        .collect();
    assert!(verbs.len() > 10, "{verbs:?}");
    verbs
}

/// The long options of a verb's help.
fn options(verb: &str) -> Vec<String> {
    let help = succeed(&[verb, "--help"]);
    let long = |line: &str| {
        let start = line.trim_start();
        let dashes = start.starts_with('-').then(|| start.find("--")).flatten()?;
        let name = &start[dashes + 2..];
        let end = name.find(|c: char| !c.is_ascii_alphanumeric() && c != '-').unwrap_or(name.len());
        Some(name[..end].to_owned())
    };
    help.lines().filter_map(long).collect()
}

#[test]
fn completions_know_all_verbs_and_options() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = succeed(&["completions", shell]);
        for verb in verbs() {
            assert!(script.contains(&verb), "{shell}: {verb}");
        }
        for option in options("query") {
            assert!(script.contains(&option), "{shell}: --{option}");
        }
    }
    assert_eq!(run(&["completions", "punchcard"]).status.code(), Some(2));
}

#[test]
fn there_is_a_manual_page_for_each_verb() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_str().expect("text");
    succeed(&["man", path]);
    let read = |name: String| {
        let page = Path::new(path).join(name);
        std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{page:?}: {error}"))
    };
    let program = read("splitplane.1".to_owned());
    let verbs = verbs();
    for verb in &verbs {
        assert!(program.contains(verb.as_str()), "{verb}");
        let page = read(format!("splitplane-{verb}.1"));
        for option in options(verb) {
            // In roff a minus is written with a backslash.
            let roff = option.replace('-', "\\-");
            assert!(page.contains(&format!("\\-\\-{roff}")), "{verb}: --{option}");
        }
    }
    assert_eq!(std::fs::read_dir(path).expect("a folder").count(), verbs.len() + 1);
    let output = run(&["man", "/nowhere/at/all"]);
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
}

//! Test programs are few, since each of them links everything that it tests; and no file of tests
//! is left out of them.

use std::collections::BTreeMap;
use std::fs;

use splitplane_test_support::sources::{packages, workspace};

/// Programs of the whole workspace.
const MOST: usize = 25;

/// The texts of a package's files `tests/NAME.rs` and `tests/NAME/main.rs`, by path.
fn files(package: &str) -> BTreeMap<String, String> {
    let folder = workspace().join(package).join("tests");
    let entries = fs::read_dir(folder).into_iter().flatten();
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths
        .filter_map(|path| {
            let name = path.file_name()?.to_str()?.to_owned();
            let (name, path) = match path.is_dir() {
                true => (format!("tests/{name}/main.rs"), path.join("main.rs")),
                false => (format!("tests/{name}"), path),
            };
            let text = fs::read_to_string(path).ok()?;
            name.ends_with(".rs").then_some((name, text))
        })
        .collect()
}

/// The paths of a package's programs, and of its files that are part of none.
fn programs(manifest: &str, files: &BTreeMap<String, String>) -> (Vec<String>, Vec<String>) {
    if !manifest.contains("\nautotests = false\n") {
        return (files.keys().cloned().collect(), Vec::new());
    }
    let value = |section: &str, key: &str| {
        let line = section.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = \""));
        line.map(|rest| rest.trim_end_matches('"').to_owned())
    };
    let sections = manifest.split("[[test]]\n").skip(1);
    let sections = sections.map(|rest| rest.split("\n[").next().expect("a section"));
    let paths = sections.map(|section| {
        let name = value(section, "name").expect("a name");
        value(section, "path").unwrap_or_else(|| format!("tests/{name}.rs"))
    });
    let paths: Vec<String> = paths.collect();
    let is_module = |path: &str| {
        let name = path.trim_start_matches("tests/").trim_end_matches(".rs");
        let line = format!("mod {name};");
        paths.iter().filter_map(|path| files.get(path)).any(|root| root.lines().any(|l| l == line))
    };
    let lost = files.keys().filter(|path| !paths.contains(path) && !is_module(path));
    let lost = lost.cloned().collect();
    (paths, lost)
}

#[test]
fn programs_are_few_and_no_file_is_left_out() {
    let (mut all, mut left_out) = (Vec::new(), Vec::new());
    for package in packages() {
        let path = workspace().join(&package).join("Cargo.toml");
        let manifest = fs::read_to_string(path).expect("a manifest");
        let (programs, lost) = programs(&manifest, &files(&package));
        all.extend(programs.iter().map(|path| format!("{package}/{path}")));
        left_out.extend(lost.iter().map(|path| format!("{package}/{path}")));
    }
    assert!(all.len() <= MOST, "{} programs, of {MOST}: {all:#?}", all.len());
    assert!(all.len() > 9, "only {all:?} were found");
    assert!(left_out.is_empty(), "in no program, so they never run: {left_out:#?}");
}

#[test]
fn planted_programs_and_lost_files_are_found() {
    let file = |(path, text): (&str, &str)| (path.to_owned(), text.to_owned());
    let files = [("tests/main.rs", "mod a;\nmod c;\n"), ("tests/a.rs", ""), ("tests/b.rs", "")];
    let files: BTreeMap<_, _> = files.map(file).into_iter().collect();
    assert_eq!(programs("[package]\n", &files).0.len(), 3);
    let one =
        "[package]\nautotests = false\n\n[[test]]\nname = \"suite\"\npath = \"tests/main.rs\"\n";
    let main = vec!["tests/main.rs".to_owned()];
    assert_eq!(programs(one, &files), (main.clone(), vec!["tests/b.rs".to_owned()]));
    let two = format!("{one}\n[[test]]\nname = \"b\"\n\n[dependencies]\n");
    assert_eq!(programs(&two, &files), ([main, vec!["tests/b.rs".into()]].concat(), Vec::new()));
}

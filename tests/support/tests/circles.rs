//! Modules import one another in no circle, but for parents and children.

use std::collections::BTreeMap;

use splitplane_test_support::modules::{Circle, Crate};
use splitplane_test_support::sources::{packages, workspace};

/// The folders of the packages and the crates in them.
fn crates() -> Vec<(String, Crate)> {
    let read = |path: &str| std::fs::read_to_string(workspace().join(path)).ok();
    let mut all = Vec::new();
    for package in packages() {
        for root in ["lib.rs", "main.rs"] {
            let root = format!("{package}/src/{root}");
            let root = root.trim_start_matches('/');
            if workspace().join(root).exists() {
                all.push((package.clone(), Crate::parse(root, &read)));
            }
        }
    }
    all
}

#[test]
fn no_modules_import_one_another_in_a_circle() {
    let mut found = String::new();
    for (package, one) in crates() {
        for Circle { parent, children, imports } in one.circles() {
            found += &format!("{package}, in `{parent}`: {children:?}\n");
            imports.iter().for_each(|import| found += &format!("    {import}\n"));
        }
    }
    assert!(found.is_empty(), "modules import one another in circles:\n{found}");
}

/// The sources are read, and imports are found in them.
#[test]
fn imports_of_the_workspace_are_found() {
    let crates = crates();
    assert!(crates.len() > 10);
    let (_, cpu) = crates.iter().find(|(package, _)| package == "backend-cpu").expect("a package");
    let imports = cpu.imports();
    let import = |from: &str, to: &str| {
        let path = |text: &str| text.split("::").map(str::to_owned).collect::<Vec<_>>();
        imports.contains(&(path(from), path(to)))
    };
    assert!(import("trace::step", "layout::wide_node"), "in braces");
    assert!(import("backend", "simd::instruction_set"), "behind a re-export");
    assert!(import("build", "build::twin::executor"), "of a child's child");
    assert!(!import("layout::wide_node", "trace::step") && !import("cancel", "memory"));
    assert!(imports.len() > 300, "{}", imports.len());
}

/// What is found in a crate of these files.
fn found(files: &[(&str, &str)]) -> Vec<(String, Vec<String>)> {
    let files: BTreeMap<&str, &str> = files.iter().copied().collect();
    let read = |path: &str| files.get(path).map(|&text| text.to_owned());
    let circles = Crate::parse("src/lib.rs", &read).circles();
    circles.into_iter().map(|circle| (circle.parent, circle.children)).collect()
}

#[test]
fn planted_circles_are_found() {
    let pair = |parent: &str, one: &str, other: &str| {
        vec![(parent.to_owned(), vec![one.to_owned(), other.to_owned()])]
    };
    // Two files, one of which names a path in its code.
    let root = ("src/lib.rs", "mod a;\nmod b;\n");
    let a = ("src/a.rs", "use crate::b::B;\npub struct A;\n");
    let b = ("src/b.rs", "pub struct B;\nfn f() -> super::a::A { crate::a::A }\n");
    assert_eq!(found(&[root, a, b]), pair("", "a", "b"));
    // One way alone is none; nor is what tests and comments import.
    let b =
        "// use crate::a::A;\npub struct B;\n#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}\n";
    assert_eq!(found(&[root, a, ("src/b.rs", b)]), []);
    // Behind a re-export of their parent.
    let root = ("src/lib.rs", "mod c;\n");
    let parent = ("src/c/mod.rs", "mod a;\nmod b;\npub use a::A;\npub use b::*;\n");
    let a = ("src/c/a.rs", "use super::B;\npub struct A;\n");
    let b = ("src/c/b.rs", "use crate::c::{self, A};\npub struct B;\n");
    assert_eq!(found(&[root, parent, a, b]), pair("c", "a", "b"));
    // Folders, though no two files do.
    let root = ("src/lib.rs", "mod c;\nmod d;\n");
    let c = ("src/c.rs", "pub mod a;\npub mod b;\n");
    let d = ("src/d.rs", "pub mod a;\npub mod b;\n");
    let files = [
        ("src/c/a.rs", "use crate::d::a::A;\n"),
        ("src/c/b.rs", "pub struct B;\n"),
        ("src/d/a.rs", "pub struct A;\n"),
        ("src/d/b.rs", "use crate::c::b::B as C;\n"),
    ];
    assert_eq!(found(&[&[root, c, d], &files[..]].concat()), pair("", "c", "d"));
    // Inline modules, through a third.
    let root = "mod a {\n    use super::b::B;\n}\nmod b {\n    use crate::c::C;\n    pub struct B;\n}\n\
                mod c {\n    use crate::a;\n    pub struct C;\n}\n";
    let three = ["a", "b", "c"].map(str::to_owned).to_vec();
    assert_eq!(found(&[("src/lib.rs", root)]), [(String::new(), three)]);
}

#[test]
fn parents_and_children_may_import_one_another() {
    let root = ("src/lib.rs", "mod a;\nuse a::b::B;\npub struct R;\n");
    let a = ("src/a.rs", "pub mod b;\nuse b::B;\npub struct A(B);\n");
    let b = ("src/a/b.rs", "use super::A;\nuse crate::R;\npub struct B;\n");
    assert_eq!(found(&[root, a, b]), []);
}

//! Which modules of a crate import which others, and where they do so in a circle.
//!
//! A module is a file or an inline block. A path that begins with `crate`, `self` or `super` is an import of
//! the module in which its item is defined; re-exports are followed, so nothing hides behind one. Tests may import what they
//! like and do not count.
//!
//! Parent and child may import one another. Beyond that modules form no circle, and neither do folders: among the children
//! of one module, a child imports another where any module within the one imports any module within the other.

use std::collections::{BTreeMap, BTreeSet};

use crate::sources::{code, without_tests};

/// The modules of a crate, by path from its root; the root's is empty.
#[derive(Debug, Default)]
pub struct Crate {
    modules: BTreeMap<Vec<String>, Module>,
}

#[derive(Debug, Default)]
struct Module {
    /// The code without tests and without inline modules.
    code: String,
    children: BTreeSet<String>,
    /// Names that `use` brings here, and the paths they stand for.
    names: BTreeMap<String, Vec<String>>,
    /// Paths of modules all of whose items are brought here.
    globs: Vec<Vec<String>>,
}

/// Children of one module that import one another in a circle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Circle {
    /// The module whose children they are, from the crate's root; empty for the root.
    pub parent: String,
    /// Their names, in order.
    pub children: Vec<String>,
    /// One import for each pair of them, as `from -> to`.
    pub imports: Vec<String>,
}

impl Crate {
    /// The modules below a root file. `read` gives the text of a file by its path, with `/`.
    ///
    /// # Panics
    /// If there is no such root, or a declared module has no file.
    pub fn parse(root: &str, read: &dyn Fn(&str) -> Option<String>) -> Crate {
        let mut all = Crate::default();
        let text = read(root).unwrap_or_else(|| panic!("no file {root}"));
        let folder = root.rsplit_once('/').map_or("", |(folder, _)| folder).to_owned();
        all.add(Vec::new(), &without_tests(&code(&text)), &folder, read);
        let paths: Vec<_> = all.modules.keys().cloned().collect();
        for path in paths {
            let uses = uses(&all.modules[&path].code);
            for (tree, name) in uses {
                let Some(target) = all.absolute(&path, &tree) else { continue };
                let module = all.modules.get_mut(&path).expect("a module of this crate");
                match name.as_str() {
                    "*" => module.globs.push(target),
                    "_" => {}
                    _ => {
                        module.names.insert(name, target);
                    }
                }
            }
        }
        all
    }

    fn add(
        &mut self,
        path: Vec<String>,
        text: &str,
        folder: &str,
        read: &dyn Fn(&str) -> Option<String>,
    ) {
        let (mut own, mut children) = (text.to_owned(), BTreeSet::new());
        let mut from = 0;
        while let Some((at, name, body)) = next_module(&own, from) {
            let mut child = path.clone();
            child.push(name.clone());
            children.insert(name.clone());
            let below = format!("{folder}/{name}");
            if let Some(body) = body {
                let inner = own[body.0..body.1].to_owned();
                own.replace_range(body.0..body.1, &" ".repeat(inner.len()));
                self.add(child, &inner, &below, read);
                from = body.1;
            } else {
                let attributes = own[..at].rsplit([';', '}']).next().unwrap_or_default();
                if attributes.contains("#[path") {
                    // A file of another crate, which it is checked with.
                    from = at;
                    continue;
                }
                let file = [format!("{below}.rs"), format!("{below}/mod.rs")];
                let text = file.iter().find_map(|file| read(file.trim_start_matches('/')));
                let text = text.unwrap_or_else(|| panic!("no file for {below}"));
                self.add(child, &without_tests(&code(&text)), &below, read);
                from = at;
            }
        }
        self.modules.insert(path, Module { code: own, children, ..Module::default() });
    }

    /// A path from the root, of one that stands in a module and begins with `crate`, `self`, `super` or a child.
    fn absolute(&self, from: &[String], path: &[String]) -> Option<Vec<String>> {
        let mut at = from.to_vec();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|first| first == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            child if self.modules.get(from)?.children.contains(child) => {}
            _ => return None,
        }
        at.extend_from_slice(rest);
        Some(at)
    }

    /// The module in which the item of a path from the root is defined.
    fn home(&self, path: &[String], depth: usize) -> Option<Vec<String>> {
        let length = (0..=path.len()).rev().find(|&n| self.modules.contains_key(&path[..n]))?;
        let (at, rest) = path.split_at(length);
        let module = &self.modules[at];
        let Some(name) = rest.first().filter(|_| depth < 16) else { return Some(at.to_vec()) };
        if let Some(target) = module.names.get(name) {
            let target = [target, &rest[1..]].concat();
            return self.home(&target, depth + 1);
        }
        if !defines(&module.code, name) {
            for glob in &module.globs {
                let target = [&glob[..], rest].concat();
                let found = self.home(&target, depth + 1)?;
                if found != at && defines(&self.modules[&found].code, name) {
                    return Some(found);
                }
            }
        }
        Some(at.to_vec())
    }

    /// Which modules import which, by path from the root; the root's is empty.
    pub fn imports(&self) -> BTreeSet<(Vec<String>, Vec<String>)> {
        let mut imports = BTreeSet::new();
        for (from, module) in &self.modules {
            for path in paths(&module.code) {
                let Some(target) = self.absolute(from, &path) else { continue };
                let Some(home) = self.home(&target, 0) else { continue };
                imports.insert((from.clone(), home));
            }
        }
        imports
    }

    /// All circles but those of parents and children.
    pub fn circles(&self) -> Vec<Circle> {
        let imports = self.imports();
        let mut circles = Vec::new();
        for (parent, module) in &self.modules {
            let mut edges: BTreeMap<&str, BTreeMap<&str, String>> = BTreeMap::new();
            for (from, to) in &imports {
                let child = |path: &'_ [String]| -> Option<String> {
                    path.starts_with(parent).then(|| path.get(parent.len()).cloned()).flatten()
                };
                let (Some(one), Some(other)) = (child(from), child(to)) else { continue };
                let (Some(one), Some(other)) =
                    (module.children.get(&one), module.children.get(&other))
                else {
                    continue;
                };
                if one != other {
                    let import = format!("{} -> {}", from.join("::"), to.join("::"));
                    edges.entry(one).or_default().entry(other).or_insert(import);
                }
            }
            circles.extend(components(&edges).into_iter().map(|children| {
                Circle {
                    parent: parent.join("::"),
                    imports: children
                        .iter()
                        .flat_map(|one| edges[one.as_str()].iter())
                        .filter(|(other, _)| children.iter().any(|child| child == *other))
                        .map(|(_, import)| import.clone())
                        .collect(),
                    children,
                }
            }));
        }
        circles
    }
}

/// Sets of more than one name from each of which there is a way to all others.
fn components(edges: &BTreeMap<&str, BTreeMap<&str, String>>) -> Vec<Vec<String>> {
    let reached = |from: &str| {
        let (mut reached, mut open) = (BTreeSet::new(), vec![from.to_owned()]);
        while let Some(at) = open.pop() {
            for &to in edges.get(at.as_str()).into_iter().flat_map(BTreeMap::keys) {
                if reached.insert(to.to_owned()) {
                    open.push(to.to_owned());
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&str, _> = edges.keys().map(|&from| (from, reached(from))).collect();
    let both = |one: &str, other: &str| {
        let reaches = |a: &str, b: &str| reached.get(a).is_some_and(|reached| reached.contains(b));
        reaches(one, other) && reaches(other, one)
    };
    let mut out: Vec<Vec<String>> = Vec::new();
    for &name in reached.keys() {
        if both(name, name) && !out.iter().flatten().any(|known| known == name) {
            out.push(reached.keys().filter(|&&o| both(name, o)).map(|&o| o.to_owned()).collect());
        }
    }
    out
}

/// A declaration of a module: where it ends, its name, and where its block is, if it has one.
type Declaration = (usize, String, Option<(usize, usize)>);

/// The next declaration of a module from a place on.
fn next_module(code: &str, from: usize) -> Option<Declaration> {
    let mut at = from;
    loop {
        at += code[at..].find("mod ")?;
        let before = code[..at].chars().next_back();
        at += "mod ".len();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let name: String = word(&code[at..]).to_owned();
        let rest = code[at + name.len()..].trim_start();
        let end = code.len() - rest.len();
        if rest.starts_with(';') {
            return Some((end, name, None));
        }
        if rest.starts_with('{') {
            let mut depth = 0;
            let close = rest.char_indices().find_map(|(i, c)| {
                depth += i32::from(c == '{') - i32::from(c == '}');
                (depth == 0).then_some(i)
            })?;
            return Some((end, name, Some((end + 1, end + close))));
        }
    }
}

/// The word that a text begins with.
fn word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// Whether an item of this name is defined in a module.
fn defines(code: &str, name: &str) -> bool {
    let kinds =
        ["fn", "struct", "enum", "trait", "type", "const", "static", "union", "macro_rules!"];
    kinds.iter().any(|kind| {
        code.match_indices(kind).any(|(at, _)| {
            let rest = code[at + kind.len()..].trim_start();
            rest.len() < code.len() - at - kind.len() && word(rest) == name
        })
    })
}

/// All paths in some code: those of `use`, and all others that begin with `crate`, `self` or `super`.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut all: Vec<Vec<String>> = uses(code).into_iter().map(|(path, _)| path).collect();
    for start in ["crate::", "self::", "super::"] {
        for (at, _) in code.match_indices(start) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                continue;
            }
            let mut path = Vec::new();
            let mut rest = &code[at..];
            loop {
                let segment = word(rest);
                if segment.is_empty() {
                    break;
                }
                path.push(segment.to_owned());
                match rest[segment.len()..].strip_prefix("::") {
                    Some(more) => rest = more,
                    None => break,
                }
            }
            all.push(path);
        }
    }
    all
}

/// The paths of all `use` declarations, each with the name it brings: `*` for all that a module has.
fn uses(code: &str) -> Vec<(Vec<String>, String)> {
    let mut out = Vec::new();
    for (at, _) in code.match_indices("use ") {
        let before = code[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + 4..];
        let Some(end) = rest.find(';') else { continue };
        tree(&rest[..end], &mut Vec::new(), &mut out);
    }
    out
}

/// Goes through a tree of `use`.
fn tree(text: &str, prefix: &mut Vec<String>, out: &mut Vec<(Vec<String>, String)>) {
    let text = text.trim();
    let length = prefix.len();
    let mut rest = text;
    loop {
        if let Some(group) = rest.strip_prefix('{') {
            let group = group.trim_end().strip_suffix('}').unwrap_or(group);
            let (mut depth, mut start) = (0, 0);
            for (i, c) in group.char_indices() {
                depth += i32::from(c == '{') - i32::from(c == '}');
                if c == ',' && depth == 0 {
                    tree(&group[start..i], prefix, out);
                    start = i + 1;
                }
            }
            if !group[start..].trim().is_empty() {
                tree(&group[start..], prefix, out);
            }
            break;
        }
        if rest.starts_with('*') {
            out.push((prefix.clone(), "*".to_owned()));
            break;
        }
        let segment = word(rest);
        if segment.is_empty() {
            break;
        }
        rest = rest[segment.len()..].trim_start();
        if segment != "self" || prefix.is_empty() {
            prefix.push(segment.to_owned());
        }
        if let Some(more) = rest.strip_prefix("::") {
            rest = more.trim_start();
            continue;
        }
        let name =
            rest.strip_prefix("as ").map_or(prefix.last().map_or("", |s| s), |s| word(s.trim()));
        out.push((prefix.clone(), name.to_owned()));
        break;
    }
    prefix.truncate(length);
}

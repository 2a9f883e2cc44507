//! Names: tables, folders and the core say the same; every file says what it does.

use std::collections::BTreeSet;
use std::path::Path;

use splitplane_shaders::Shader;

/// Names of the files with an ending in a folder, relative to this package; none when it is missing.
pub(crate) fn files(folder: &str, ending: &str) -> BTreeSet<String> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders")).join(folder);
    let Ok(entries) = std::fs::read_dir(folder) else { return BTreeSet::new() };
    entries
        .filter_map(|entry| {
            let name = entry.ok()?.file_name().into_string().ok()?;
            Some(name.strip_suffix(ending)?.to_owned())
        })
        .collect()
}

/// Names in one list and not in the other.
pub(crate) fn differences<'a>(
    what: &str,
    a: impl IntoIterator<Item = &'a str>,
    b: impl IntoIterator<Item = &'a str>,
) -> Vec<String> {
    let (a, b): (BTreeSet<_>, BTreeSet<_>) = (a.into_iter().collect(), b.into_iter().collect());
    a.symmetric_difference(&b).map(|name| format!("{what}: {name}")).collect()
}

/// The files that shaders of a table are named for: their last parts.
pub(crate) fn own_files(table: &[Shader]) -> BTreeSet<String> {
    let own = table.iter().filter_map(|shader| shader.parts.last());
    own.map(|part| part.name.to_owned()).collect()
}

/// What a kernel's text does not say in the comment it begins with.
pub(crate) fn header_faults(text: &str) -> Vec<String> {
    let header: Vec<_> = text.lines().take_while(|line| line.starts_with("//")).collect();
    ["// One ", "// Reads:", "// Writes:"]
        .iter()
        .filter(|start| !header.iter().any(|line| line.starts_with(**start)))
        .map(|start| format!("no line `{start}` in the header"))
        .collect()
}

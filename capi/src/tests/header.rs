//! The header is what cbindgen makes of the sources.

use std::path::Path;

/// In the order of the header: what is used comes first.
const SOURCES: [&str; 19] = [
    "status",
    "entry",
    "handle",
    "record",
    "options",
    "mesh",
    "ray",
    "batch",
    "backend",
    "tree",
    "tree_query",
    "scene",
    "opacity",
    "shapes",
    "scene_query",
    "lazy",
    "volumes",
    "casts",
    "points",
];

/// The header of the sources, and of another one that is planted.
fn made(planted: Option<&str>) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = cbindgen::Config::from_file(root.join("cbindgen.toml")).unwrap();
    config.after_includes =
        Some(format!("\n#define SPLITPLANE_VERSION \"{}\"", env!("CARGO_PKG_VERSION")));
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in SOURCES.into_iter().chain(["lists"]) {
        builder = builder.with_src(root.join(format!("src/{source}.rs")));
    }
    let file = planted.map(|text| {
        let name = format!("splitplane-header-{}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, text).unwrap();
        path
    });
    if let Some(path) = &file {
        builder = builder.with_src(path);
    }
    let mut bytes = Vec::new();
    builder.generate().unwrap().write(&mut bytes);
    if let Some(path) = file {
        std::fs::remove_file(path).unwrap();
    }
    // Notes to Rust's callers say what the text says in other words.
    let (text, mut out, mut skips) = (String::from_utf8(bytes).unwrap(), String::new(), false);
    for line in text.lines() {
        let comment = line.trim_start().strip_prefix("//");
        match comment.map(str::trim) {
            Some("# Safety") => {
                skips = true;
                while out.ends_with("//\n") {
                    out.truncate(out.len() - "//\n".len());
                }
                continue;
            }
            Some(_) if skips => continue,
            _ => skips = false,
        }
        out.push_str(line.trim_end());
        out.push('\n');
    }
    out
}

#[test]
fn the_header_is_what_the_sources_say() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/splitplane.h");
    let made = made(None);
    if std::env::var_os("SPLITPLANE_UPDATE").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &made).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = made.lines().zip(kept.lines()).position(|(made, kept)| made != kept);
    assert!(
        made == kept,
        "include/splitplane.h differs from the sources at line {:?}; SPLITPLANE_UPDATE=1 makes it anew",
        differs.map(|line| line + 1)
    );
}

#[test]
fn a_call_that_is_new_changes_the_header() {
    let planted = "#[unsafe(no_mangle)] pub extern \"C\" fn splitplane_planted(number: u32) -> u32 { number }";
    let (with, without) = (made(Some(planted)), made(None));
    assert!(with.contains("uint32_t splitplane_planted(uint32_t number);") && with != without);
}

/// Every source with functions is in the list, so none is left out of the header.
#[test]
fn no_function_is_left_out() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let header = made(None);
    let mut found = 0;
    for file in std::fs::read_dir(root).unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        for part in text.split("extern \"C\" fn splitplane_").skip(1) {
            let name = format!("splitplane_{}(", part.split('(').next().unwrap());
            assert!(header.contains(&name), "{name}");
            found += 1;
        }
    }
    assert_eq!(header.matches("\nsplitplane_status splitplane_").count() + 3, found);
}

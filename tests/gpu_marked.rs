//! Every test of this folder that opens a device is in a file `gpu_*.rs`, and is marked, so that it is ignored,
//! with the reason, where there is no adapter; tests of real scenes likewise where there are no scenes.

use std::fs;
use std::path::Path;

const NO_GPU: &str = "#[cfg_attr(no_gpu, ignore = \
                      \"no Vulkan adapter and none could be installed\")]";
const NO_SCENES: &str = "#[cfg_attr(no_scenes, ignore = \
                         \"no scenes folder; set SPLITPLANE_SCENES\")]";
/// What a file has that opens a device.
const OPENING: [&str; 4] =
    ["crate::device", "Gpu::open(", "BackendKind::Wgpu", "WgpuBackend::new("];

/// The files of tests, by name.
fn files() -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let entries = fs::read_dir(folder).expect("the folder of the tests");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let rust = paths.filter(|path| path.extension().is_some_and(|ending| ending == "rs"));
    rust.map(|path| {
        let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
        (name, fs::read_to_string(&path).expect("text"))
    })
    .filter(|(name, _)| name != "gpu_marked")
    .collect()
}

/// The attributes of each test of a text, and its lines to the brace that closes it.
fn tests(text: &str) -> Vec<(Vec<&str>, String)> {
    let mut lines = text.lines();
    let mut tests = Vec::new();
    while lines.by_ref().any(|line| line == "#[test]") {
        let attributes = lines.by_ref().take_while(|line| !line.starts_with("fn ")).collect();
        let body: Vec<&str> = lines.by_ref().take_while(|line| *line != "}").collect();
        tests.push((attributes, body.join("\n")));
    }
    tests
}

#[test]
fn tests_that_need_a_device_are_marked() {
    let mut found = 0;
    for (name, text) in files() {
        if !name.starts_with("gpu_") {
            let opening = OPENING.iter().find(|opening| text.contains(**opening));
            assert_eq!(opening, None, "{name} opens a device: call it gpu_{name}");
            continue;
        }
        for (attributes, _) in tests(&text) {
            assert!(attributes.contains(&NO_GPU), "{name}: add {NO_GPU}");
            found += 1;
        }
    }
    assert!(found >= 10, "only {found} tests were found");
}

#[test]
fn tests_of_real_scenes_on_a_device_are_marked() {
    let mut found = 0;
    for (name, text) in files().into_iter().filter(|(name, _)| name.starts_with("gpu_")) {
        for (attributes, body) in tests(&text) {
            if body.contains("scenes::real(") {
                assert!(attributes.contains(&NO_SCENES), "{name}: add {NO_SCENES}");
                found += 1;
            }
        }
    }
    assert!(found > 0, "no such test was found");
}

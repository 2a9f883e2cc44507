//! Scenes of many objects in the program: files, built-in ones, and verbs that take a single mesh.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

const SCENE: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 3,
  "materials": [{"name": "red", "diffuse": [0.8, 0.1, 0.1]}],
  "geometries": [
    {"name": "floor", "positions": [[-5,0,-5],[-5,0,5],[5,0,5],[5,0,-5]], "triangles": [[0,1,2],[0,2,3]]},
    {"name": "part", "obj": "part.obj", "group": "top", "material": "red"}
  ],
  "instances": [
    {"geometry": "floor"},
    {"geometry": "part", "translate": [0, 1, 0], "scale": 2},
    {"geometry": "part", "keys": [{"frame": 0, "translate": [-2, 1, 0]}, {"frame": 2, "translate": [-2, 3, 0]}]}
  ],
  "cameras": [{"eye": [0, 3, 9], "at": [0, 1, 0]}],
  "lights": [{"sun": {"towards": [1, 2, 1], "irradiance": [3, 3, 3]}}]
}"#;

const PART: &str = "g top\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\ng rest\nf 1 2 4\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.json"), SCENE).unwrap();
    fs::write(folder.path().join("part.obj"), PART).unwrap();
    folder
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
    command.current_dir(folder).args(arguments).env_remove("RUST_BACKTRACE");
    // What the machine has must not matter: no adapter is found.
    command.env("WGPU_BACKEND", "vulkan").env_remove("WGPU_ADAPTER_NAME");
    command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
    command.output().unwrap()
}

#[track_caller]
fn ends(folder: &TempDir, code: i32, arguments: &[&str]) -> (String, String) {
    let output = run(folder.path(), arguments);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, error) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    (out, error)
}

const SMALL: [&str; 4] = ["--size", "32x20", "--samples", "1"];

#[test]
fn a_file_is_rendered_and_counted() {
    let folder = folder();
    let output = ["-o", "one.png", "--json"];
    let (out, _) = ends(&folder, 0, &[&["render", "scene.json"], &SMALL[..], &output].concat());
    let report: Value = serde_json::from_str(&out).unwrap();
    let counted = ["geometries", "instances", "triangles", "instanced_triangles"];
    assert_eq!(counted.map(|name| report[name].as_u64()), [2, 3, 4, 6].map(Some), "{report}");
    // One thread or two, the same picture; another place of an instance, another one.
    let again = ["-o", "two.png", "--threads", "1", "--quiet"];
    ends(&folder, 0, &[&["render", "scene.json"], &SMALL[..], &again].concat());
    let picture = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(picture("one.png") == picture("two.png"));
    fs::write(
        folder.path().join("moved.json"),
        SCENE.replace("[0, 1, 0], \"scale\"", "[1, 1, 0], \"scale\""),
    )
    .unwrap();
    let moved = ["-o", "moved.png", "--quiet"];
    ends(&folder, 0, &[&["render", "moved.json"], &SMALL[..], &moved].concat());
    assert!(picture("one.png") != picture("moved.png"));
}

#[test]
fn instances_move_from_frame_to_frame() {
    let folder = folder();
    let movie = ["--out", "frames", "--quiet"];
    ends(&folder, 0, &[&["animate", "scene.json"], &SMALL[..], &movie].concat());
    let mut frames: Vec<_> = fs::read_dir(folder.path().join("frames"))
        .unwrap()
        .map(|entry| fs::read(entry.unwrap().path()).unwrap())
        .collect();
    assert_eq!(frames.len(), 3);
    frames.sort();
    frames.dedup();
    assert_eq!(frames.len(), 3, "frames that are equal");
    ends(
        &folder,
        0,
        &[&["animate", "builtin:flock:12"], &SMALL[..], &["--count", "2", "--quiet"]].concat(),
    );
    let forest = ["-o", "forest.png", "--quiet"];
    ends(&folder, 0, &[&["render", "builtin:forest:40"], &SMALL[..], &forest].concat());
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let folder = folder();
    let broken = SCENE
        .replace("\"geometry\": \"part\", \"translate\"", "\"geometry\": \"port\", \"translate\"");
    fs::write(folder.path().join("broken.json"), broken).unwrap();
    let (_, error) = ends(&folder, 3, &["render", "broken.json", "-o", "x.png"]);
    for words in ["broken.json", "line 10, column 18", "instances[1].geometry", "`port`"] {
        assert!(error.contains(words), "{words}: {error}");
    }
    assert!(!folder.path().join("x.png").exists());
    let (_, error) = ends(&folder, 2, &["render", "builtin:forest:3", "-o", "x.png"]);
    assert!(error.contains("objects from 10"), "{error}");
    // Other verbs take a single mesh, and say so.
    for verb in ["build", "stats", "verify"] {
        let (_, error) = ends(&folder, 2, &[verb, "builtin:forest"]);
        assert!(error.contains("many objects; render and animate"), "{verb}: {error}");
        let output = run(folder.path(), &[verb, "scene.json"]);
        assert!([2, 3].contains(&output.status.code().unwrap()), "{verb}");
    }
}

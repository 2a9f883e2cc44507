//! Meshes in PLY, STL and glTF files in the program: read by every verb, written by `convert`, refused by their place.

use crate::common::ends;
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

/// The digest of the tree over all of a scene as one mesh.
fn digest(folder: &TempDir, scene: &str) -> String {
    let (out, _) = ends(folder, 0, &["stats", scene, "--json", "--quiet", "--rays", "10"]);
    let report: Value = serde_json::from_str(&out).unwrap();
    report["digest"].as_str().unwrap().to_owned()
}

/// The same tree from the built-in scene and from every file that it is written to.
#[test]
fn what_is_written_gives_the_same_tree() {
    let folder = tempfile::tempdir().unwrap();
    let built_in = digest(&folder, "builtin:cornell");
    for (numbers, output) in [("ascii", "a.ply"), ("little", "l.ply"), ("big", "B.PLY")] {
        ends(&folder, 0, &["convert", "builtin:cornell", output, "--numbers", numbers]);
        assert_eq!(digest(&folder, output), built_in, "{numbers}");
    }
    ends(&folder, 0, &["convert", "builtin:forest:20", "forest.glb"]);
    ends(&folder, 0, &["convert", "forest.glb", "forest.ply"]);
    assert_eq!(digest(&folder, "forest.glb"), digest(&folder, "forest.ply"));
    ends(&folder, 0, &["build", "forest.glb"]);
    let small = ["--size", "32x20", "--samples", "1", "--quiet", "--json"];
    for scene in ["forest.glb", "forest.ply"] {
        let (out, _) = ends(&folder, 0, &[&["render", scene], &small[..]].concat());
        assert!(out.contains("splitplane-forest.png"), "{out}");
    }
    ends(&folder, 0, &["convert", "builtin:flock:10", "flock.glb", "--quiet"]);
    let (out, _) =
        ends(&folder, 0, &["animate", "flock.glb", "--count", "2", "--size", "32x20", "--json"]);
    let report: Value = serde_json::from_str(&out).unwrap();
    assert!(report.is_object(), "{out}");
}

#[test]
fn an_stl_file_is_a_mesh_for_every_verb() {
    let folder = tempfile::tempdir().unwrap();
    let facet = "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    fs::write(folder.path().join("a.stl"), format!("solid\n{facet}endsolid\n")).unwrap();
    let (out, _) = ends(&folder, 0, &["build", "a.stl", "--json"]);
    assert!(out.contains("\"triangles\":1,"), "{out}");
    ends(&folder, 0, &["verify", "a.stl", "--rays", "50"]);
    ends(&folder, 0, &["stats", "a.stl", "--rays", "50"]);
    fs::write(folder.path().join("cut.stl"), format!("solid\n{}", &facet[..40])).unwrap();
    let (_, error) = ends(&folder, 3, &["build", "cut.stl"]);
    assert!(error.contains("`cut.stl`, line 4: ") && error.contains("a vertex"), "{error}");
    let (_, error) = ends(&folder, 4, &["build", "a.stl", "--max-file", "20"]);
    assert!(error.contains("; --max-file allows more"), "{error}");
    fs::write(
        folder.path().join("b.gltf"),
        "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":3}]}",
    )
    .unwrap();
    for verb in ["build", "render"] {
        let (_, error) = ends(&folder, 3, &[verb, "b.gltf"]);
        assert!(error.contains("`b.gltf`, nodes[0].mesh: "), "{error}");
    }
    let (_, error) = ends(&folder, 2, &["convert", "a.stl", "a.obj"]);
    assert!(error.contains("does not end in .ply or .glb"), "{error}");
}

//! Scenes of many objects in the program: files, built-in ones, and verbs that take a single mesh.

use crate::common::ends;
use serde_json::Value;
use std::fs;
use std::path::Path;
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

/// The same with normals, none of them across its triangle.
const SMOOTH_PART: &str = "g top\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvn 3 0 4\nvn 0 3 4\nvn 1 1 0\nf 1//1 2//2 3//3\nf 1//4 3//3 4//2\ng rest\nf 1 2 4\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.json"), SCENE).unwrap();
    fs::write(folder.path().join("part.obj"), PART).unwrap();
    folder
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
    for arguments in [
        &["stats"][..],
        &["trade", "--out", "trade", "--quick"],
        &["paper", "--out", "paper", "--quick", "--scene"],
    ] {
        for scene in ["builtin:forest", "scene.json", "saved.scene"] {
            let (_, error) = ends(&folder, 2, &[arguments, &[scene]].concat());
            assert!(error.contains("one mesh is asked for; render, animate"), "{scene}: {error}");
        }
    }
    let (_, error) = ends(&folder, 2, &["build", "scene.json", "-o", "x.tree"]);
    assert!(error.contains("does not end in .scene"), "{error}");
    fs::write(folder.path().join("none.scene"), b"splitsc\nnothing").unwrap();
    let (_, error) = ends(&folder, 3, &["query", "none.scene", "--rays", "no.f32"]);
    assert!(error.contains("no.f32"), "{error}");
    let (_, error) = ends(&folder, 3, &["build", "none.scene"]);
    assert!(error.contains("none.scene`: the"), "{error}");
    let (_, error) = ends(&folder, 3, &["build", "missing.scene"]);
    assert!(error.contains("missing.scene"), "{error}");
}

/// Rays and points in the form of users' files.
fn numbers(path: &Path, rows: &[&[f32]]) {
    let bytes: Vec<u8> = rows.iter().flat_map(|row| *row).flat_map(|x| x.to_le_bytes()).collect();
    fs::write(path, bytes).unwrap();
}

fn words(path: &Path, columns: usize) -> Vec<Vec<u32>> {
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes.len() % (4 * columns), 0, "{path:?}");
    let words: Vec<u32> =
        bytes.chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    words.chunks(columns).map(<[u32]>::to_vec).collect()
}

#[test]
fn rays_and_points_are_answered_with_geometry_instance_and_id() {
    let folder = folder();
    let scene = SCENE.replace("\"scale\": 2", "\"scale\": 2, \"id\": 77, \"mask\": 2");
    fs::write(folder.path().join("scene.json"), scene).unwrap();
    let at = |name: &str| folder.path().join(name);
    // Through the part of twice the size and on to the floor, down on the floor, and beside it.
    let ray =
        |from: [f32; 3], z: f32| [from[0], from[1], from[2], 0.0, -1.0, z, 0.0, f32::INFINITY];
    let rays = [ray([0.5, 2.5, 1.0], -1.0), ray([4.0, 9.0, 4.0], 0.0), ray([40.0, 9.0, 4.0], 0.0)];
    numbers(&at("rays.f32"), &rays.each_ref().map(|ray| &ray[..]));
    numbers(&at("points.f32"), &[&[0.25, 1.25, 0.25], &[4.0, 1.0, 4.0]]);
    let ask = |scene: &str, more: &[&str]| {
        let hits = ["--hits", "hits.f32", "--backend", "cpu", "--json"];
        let (out, _) = ends(&folder, 0, &[&["query", scene], more, &hits[..]].concat());
        serde_json::from_str::<Value>(&out).unwrap()
    };
    let rays = ["--rays", "rays.f32"];
    // From the file, and from what was built of it: the same answers.
    ends(&folder, 0, &["build", "scene.json", "-o", "saved.scene", "--backend", "cpu", "--quiet"]);
    for scene in ["scene.json", "saved.scene"] {
        let report = ask(scene, &rays);
        assert_eq!((report["rays"].as_u64(), report["hits"].as_u64()), (Some(3), Some(2)));
        assert_eq!(report["digest"].as_str().unwrap().len(), 16);
        let hits = words(&at("hits.f32"), 7);
        let names: Vec<_> = hits.iter().map(|hit| &hit[4..]).collect();
        assert_eq!(names, [&[1, 1, 77][..], &[0, 0, 0], &[u32::MAX; 3]]);
        assert_eq!([0, 1].map(|ray| f32::from_bits(hits[ray][0])), [1.0, 9.0]);
        // Without the second instance's bit the first ray reaches the floor.
        ask(scene, &[&rays[..], &["--mask", "0xfffffffd"]].concat());
        assert_eq!(words(&at("hits.f32"), 7)[0][4..], [0, 0, 0]);
        ask(scene, &[&rays[..], &["--kind", "any"]].concat());
        assert_eq!(fs::read(at("hits.f32")).unwrap(), [1, 1, 0]);
        ask(scene, &[&rays[..], &["--kind", "all"]].concat());
        let crossings = words(&at("hits.f32"), 8);
        let starts = words(&at("hits.starts.f32"), 2);
        let of = |ray: usize| starts[ray][0] as usize..starts[ray + 1][0] as usize;
        assert_eq!(crossings[of(0)].last().unwrap()[5..], [0, 0, 0]);
        assert_eq!(crossings[of(0)][0][5..], [1, 1, 77]);
        assert_eq!((of(1).len(), of(2).len()), (1, 0));
        let points = ["--points", "points.f32", "--kind"];
        ask(scene, &[&points[..], &["closest-point"]].concat());
        let closest = words(&at("hits.f32"), 10);
        assert_eq!((closest[0][8], closest[1][8]), (1, 0));
        assert_eq!(f32::from_bits(closest[1][0]), 1.0);
        ask(scene, &[&points[..], &["inside"]].concat());
        assert_eq!(fs::read(at("hits.f32")).unwrap().len(), 2);
    }
    let (first, second) = (ask("scene.json", &rays), ask("saved.scene", &rays));
    assert_eq!(first["digest"], second["digest"]);
    assert!(second["preset"].is_null());
    // What does not fit together is said.
    let query = ["query", "scene.json", "--rays", "rays.f32"];
    ends(&folder, 2, &[&query[..], &["--undecided", "flag"]].concat());
    let (_, error) = ends(&folder, 2, &["query", "part.obj", "--rays", "rays.f32", "--mask", "1"]);
    assert!(error.contains("many objects"), "{error}");
    let (_, error) = ends(&folder, 2, &[&query[..], &["--mask", "0x1ffffffff"]].concat());
    assert!(error.contains("32 bits"), "{error}");
}

#[test]
fn scenes_are_built_and_verified() {
    let folder = folder();
    let check = ["--rays", "2000", "--backend", "cpu", "--json"];
    for scene in ["scene.json", "builtin:flock:12"] {
        ends(&folder, 0, &["build", scene, "-o", "saved.scene", "--backend", "cpu", "--quiet"]);
        for scene in [scene, "saved.scene"] {
            let (out, _) = ends(&folder, 0, &[&["verify", scene], &check[..]].concat());
            let report: Value = serde_json::from_str(&out).unwrap();
            assert_eq!(report["rays"].as_u64(), Some(2000), "{report}");
            assert!(report["hits"].as_u64() > Some(400), "{report}");
            assert_eq!((&report["different"], &report["unexplained"]), (&0.into(), &0.into()));
        }
    }
    let (text, _) = ends(&folder, 0, &["build", "scene.json", "--backend", "cpu"]);
    assert!(text.contains("3 instances of 2 geometries"), "{text}");
    // One changed byte is found.
    let path = folder.path().join("saved.scene");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).unwrap();
    let (_, error) = ends(&folder, 3, &["verify", "saved.scene"]);
    assert!(error.contains("checksum"), "{error}");
}

const ROUND: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 3,
  "materials": [{"name": "red", "diffuse": [0.8, 0.1, 0.1]}, {"name": "glass", "glass": {"index": 1.5}}],
  "geometries": [
    {"name": "floor", "positions": [[-5,0,-5],[-5,0,5],[5,0,5],[5,0,-5]], "triangles": [[0,1,2],[0,2,3]]},
    {"name": "balls", "spheres": [{"centre": [0, 1, 0], "radius": 1}, {"centre": [2, 1, 0], "radius": 0.5}], "material": "red"},
    {"name": "rods", "capsules": [{"ends": [[-2, 0.5, 0], [-2, 2, 0]], "radius": 0.5}]}
  ],
  "instances": [
    {"geometry": "floor"},
    {"geometry": "balls"},
    {"geometry": "rods", "material": "glass", "keys": [{"frame": 0}, {"frame": 2, "translate": [0, 1, 0]}]}
  ],
  "cameras": [{"eye": [0, 3, 9], "at": [0, 1, 0]}],
  "lights": [{"sun": {"towards": [1, 2, 1], "irradiance": [3, 3, 3]}}]
}"#;

#[test]
fn spheres_and_capsules_are_rendered_and_move() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("round.json"), ROUND).unwrap();
    let cpu = ["--backend", "cpu"];
    let output = ["-o", "one.png", "--json", "--aov", "depth,normal,triangle,instance,nodes,tests"];
    let (out, _) =
        ends(&folder, 0, &[&["render", "round.json"], &SMALL[..], &cpu, &output].concat());
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((report["shapes"].as_u64(), report["triangles"].as_u64()), (Some(3), Some(2)));
    let instances = image::open(path("one.instance.png")).unwrap().to_rgb8();
    let colours: std::collections::HashSet<_> = instances.pixels().map(|pixel| pixel.0).collect();
    // Three instances, and what is behind them.
    assert_eq!(colours.len(), 4);
    for name in ["depth", "normal", "triangle", "nodes", "tests"] {
        assert!(path(&format!("one.{name}.png")).exists(), "{name}");
    }
    let heat = ["-o", "heat.png", "--heatmap", "triangles"];
    let (text, _) =
        ends(&folder, 0, &[&["render", "round.json"], &SMALL[..], &cpu, &heat].concat());
    assert!(text.contains("triangles tested a ray") && text.contains("3 spheres"), "{text}");
    // Red where the ball is: its front is lit by the sun.
    let picture = image::open(path("one.png")).unwrap().to_rgb8();
    let [r, g, b] = picture.get_pixel(16, 9).0;
    assert!(i32::from(r) > 50 + i32::from(g).max(i32::from(b)), "{r} {g} {b}");
    let movie = ["--out", "frames", "--quiet", "--count", "3"];
    ends(&folder, 0, &[&["animate", "round.json"], &SMALL[..], &cpu, &movie].concat());
    let frames: Vec<_> = fs::read_dir(path("frames")).unwrap().collect();
    assert_eq!(frames.len(), 3);
    // What is built is saved, checked, and shown in grey.
    ends(
        &folder,
        0,
        &[&["build", "round.json", "-o", "round.scene", "--quiet"], &cpu[..]].concat(),
    );
    let (out, _) = ends(
        &folder,
        0,
        &[&["verify", "round.scene", "--rays", "500", "--json"], &cpu[..]].concat(),
    );
    let report: Value = serde_json::from_str(&out).unwrap();
    assert!(report["different"] == 0 && report["hits"].as_u64() > Some(100), "{report}");
    let grey = ["-o", "grey.png", "--quiet"];
    ends(&folder, 0, &[&["render", "round.scene"], &SMALL[..], &cpu, &grey].concat());
    let broken = ROUND.replace("\"radius\": 0.5}]}", "\"radius\": 0}]}");
    fs::write(path("broken.json"), broken).unwrap();
    let (_, error) = ends(&folder, 3, &["render", "broken.json", "-o", "x.png"]);
    for words in ["line 7, column", "geometries[2].capsules[0].radius", "at least 1e-37"] {
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// A mesh alone shows the holes of its materials as a scene file with it does, and light comes through them.
#[test]
fn a_mesh_alone_shows_its_holes() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let leaf = "mtllib leaf.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                usemtl leaf\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    fs::write(at("leaf.obj"), leaf).unwrap();
    fs::write(at("leaf.mtl"), "newmtl leaf\nKd 0 1 0\nmap_d leaf.png\n").unwrap();
    // Open in the upper left and the lower right quarter.
    let alpha = |x: u32, y: u32| [0, 0, 0, if (x < 4) == (y < 4) { 0 } else { 255 }];
    image::RgbaImage::from_fn(8, 8, |x, y| image::Rgba(alpha(x, y))).save(at("leaf.png")).unwrap();
    let scene = r#"{"format": "splitplane-scene", "version": 1, "geometries": [{"name": "leaf", "obj": "leaf.obj"}],
        "instances": [{"geometry": "leaf"}]}"#;
    fs::write(at("leaf.json"), scene).unwrap();
    let picture = |scene: &str, output: &str, more: &[&str]| {
        let camera = ["--camera-eye", "0,0,3", "--camera-at", "0,0,0", "--fov", "60"];
        let light = ["--sun", "0,0,1", "--environment", "0,0,1", "--size", "16x16", "-o", output];
        ends(&folder, 0, &[&["render", scene], &camera[..], &light, more].concat());
        fs::read(at(output)).unwrap()
    };
    let one = ["--samples", "1"];
    let alone = picture("leaf.obj", "alone.png", &one);
    assert!(alone == picture("leaf.json", "scene.png", &one), "another picture");
    let closed = picture("leaf.obj", "closed.png", &["--no-textures", "--samples", "1"]);
    let [alone, closed] =
        [alone, closed].map(|file| image::load_from_memory(&file).unwrap().to_rgb8());
    for (x, y, is_open) in [(5, 5, true), (10, 5, false), (5, 10, false), (10, 10, true)] {
        let is_green = |picture: &image::RgbImage| picture.get_pixel(x, y).0[1] > 0;
        assert!(is_green(&closed) && is_green(&alone) != is_open, "{x} {y}");
    }
    // Costs are those of the mesh itself.
    let (out, _) = ends(
        &folder,
        0,
        &["render", "leaf.obj", "--heatmap", "nodes", "--size", "8x8", "-o", "h.png", "--json"],
    );
    assert!(out.contains("\"triangles\":2") && !out.contains("instances"), "{out}");
    // Camera and lights are placed as for any mesh, and photons go through the holes too.
    ends(
        &folder,
        0,
        &[
            "render",
            "leaf.obj",
            "--transport",
            "photons",
            "--photons",
            "64",
            "--size",
            "8x8",
            "-o",
            "p.png",
        ],
    );
}

/// A floor, four parts in places that are exact, one of them reflected and one moved, and a ball; three parts are baked.
const BAKED: &str = r#"{
  "format": "splitplane-scene", "version": 1, "frames": 3,
  "materials": [{"name": "red", "diffuse": [0.8, 0.1, 0.1]}],
  "geometries": [
    {"name": "ball", "spheres": [{"centre": [4, 1, 2], "radius": 1}]},
    {"name": "part", "obj": "part.obj", "group": "top", "material": "red"},
    {"name": "floor", "positions": [[-8,0,-8],[-8,0,8],[8,0,8],[8,0,-8]], "triangles": [[0,1,2],[0,2,3]]}
  ],
  "instances": [
    {"geometry": "ball"},
    {"geometry": "part", "translate": [0, 1, 0], "scale": 2, "id": 5, "bake": "parts"},
    {"geometry": "floor", "id": 9, "bake": "ground"},
    {"geometry": "part", "keys": [{"frame": 0, "translate": [-2, 1, 0]}, {"frame": 2, "translate": [-2, 3, 0]}]},
    {"geometry": "part", "translate": [4, 0.5, 0], "scale": [-1, 2, 1], "id": 5, "bake": "parts"},
    {"geometry": "part", "translate": [-4, 0.5, 0], "id": 5, "bake": "parts", "material": "red"}
  ],
  "cameras": [{"eye": [0, 3, 9], "at": [0, 1, 0]}],
  "lights": [{"sun": {"towards": [1, 2, 1], "irradiance": [3, 3, 3]}}]
}"#;

/// Answers of a baked scene have the names of the file: those of the scene whose instances are not baked.
#[test]
fn baked_instances_keep_their_names() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("baked.json"), BAKED).unwrap();
    let plain = BAKED.replace(", \"bake\": \"parts\"", "").replace(", \"bake\": \"ground\"", "");
    assert!(!plain.contains("bake"));
    fs::write(path("plain.json"), plain).unwrap();
    let cpu = ["--backend", "cpu"];
    // Rays down on everything, and from the front.
    let mut rays: Vec<[f32; 8]> = Vec::new();
    for i in 0..40u8 {
        for j in 0..12u8 {
            let (x, z) = (0.25 * f32::from(i) - 4.875, 0.25 * f32::from(j) - 0.625);
            rays.push([x, 6.0, z, 0.0, -1.0, 0.0, 0.0, f32::INFINITY]);
            let y = 0.5625 + 0.25 * f32::from(j);
            rays.push([x, y, 6.0, 0.0, 0.0, -1.0, 0.0, 20.0]);
        }
    }
    numbers(&path("rays.f32"), &rays.iter().map(|ray| &ray[..]).collect::<Vec<_>>());
    let points: Vec<[f32; 3]> = rays.iter().map(|ray| [ray[0], 1.5, ray[2]]).collect();
    numbers(&path("points.f32"), &points.iter().map(|point| &point[..]).collect::<Vec<_>>());
    let ask = |scene: &str, hits: &str, more: &[&str]| {
        let hits = ["--hits", hits, "--json"];
        let (out, _) = ends(&folder, 0, &[&["query", scene], more, &cpu, &hits].concat());
        serde_json::from_str::<Value>(&out).unwrap()
    };
    for (kind, given, columns) in [
        ("closest", ["--rays", "rays.f32"], 7),
        ("all", ["--rays", "rays.f32"], 8),
        ("closest-point", ["--points", "points.f32"], 10),
    ] {
        let more = [&given[..], &["--kind", kind]].concat();
        let baked = ask("baked.json", "baked.f32", &more);
        let plain = ask("plain.json", "plain.f32", &more);
        assert_eq!((&baked["instances"], &plain["instances"]), (&4.into(), &6.into()));
        assert_eq!(baked["instanced_triangles"], plain["instanced_triangles"]);
        assert_eq!(baked["hits"], plain["hits"]);
        let records = words(&path("baked.f32"), columns);
        let place = if kind == "closest" { 4 } else { columns - 3 };
        let instances: std::collections::BTreeSet<u32> =
            records.iter().map(|record| record[place + 1]).collect();
        assert!((0..6).all(|instance| instances.contains(&instance)), "{kind}: {instances:?}");
        assert!(records == words(&path("plain.f32"), columns), "{kind}");
    }
    // A file of what is built does not know the names: the comparison notices.
    ends(
        &folder,
        0,
        &[&["build", "baked.json", "-o", "baked.scene", "--quiet"], &cpu[..]].concat(),
    );
    ask("baked.scene", "saved.f32", &["--rays", "rays.f32"]);
    ask("plain.json", "plain.f32", &["--rays", "rays.f32"]);
    let named =
        |name: &str| words(&path(name), 7).into_iter().map(|hit| hit[5]).collect::<Vec<_>>();
    let (saved, file) = (named("saved.f32"), named("plain.f32"));
    assert!(saved.contains(&1) && !saved.contains(&4) && saved != file);
    // Pictures of what is seen where; of light they differ by roundings of normals.
    for scene in ["baked", "plain"] {
        let (file, picture) = (format!("{scene}.json"), format!("{scene}.png"));
        let output = ["-o", &picture, "--json", "--aov", "triangle,instance"];
        let (out, _) = ends(&folder, 0, &[&["render", &file], &SMALL[..], &cpu, &output].concat());
        let report: Value = serde_json::from_str(&out).unwrap();
        let counted = ["instances", "geometries", "triangles", "instanced_triangles"];
        let expected = if scene == "baked" { [4, 4, 10, 10] } else { [6, 3, 4, 10] };
        assert_eq!(counted.map(|name| report[name].as_u64()), expected.map(Some), "{report}");
        let movie = ["--out", scene, "--quiet"];
        ends(&folder, 0, &[&["animate", &file], &SMALL[..], &cpu, &movie].concat());
        assert_eq!(fs::read_dir(path(scene)).unwrap().count(), 3);
        let glb = format!("{scene}.glb");
        ends(&folder, 0, &["convert", &file, &glb, "--quiet"]);
    }
    let read = |name: &str| fs::read(path(name)).unwrap();
    let pixels = |name: &str| image::open(path(name)).unwrap().to_rgb8();
    for aov in ["triangle", "instance"] {
        let of = |scene: &str| pixels(&format!("{scene}.{aov}.png"));
        assert!(of("baked") == of("plain"), "{aov}");
    }
    let (baked, plain) = (pixels("baked.png"), pixels("plain.png"));
    let far = |a: &image::Rgb<u8>, b: &image::Rgb<u8>| (0..3).any(|k| a.0[k].abs_diff(b.0[k]) > 2);
    assert!(!baked.pixels().zip(plain.pixels()).any(|(a, b)| far(a, b)));
    // Files for other programs have instances.
    assert!(read("baked.glb") == read("plain.glb"));
    let (out, _) = ends(
        &folder,
        0,
        &[&["verify", "baked.json", "--rays", "500", "--json"], &cpu[..]].concat(),
    );
    let report: Value = serde_json::from_str(&out).unwrap();
    assert!(report["different"] == 0 && report["unexplained"] == 0, "{report}");
    // Of smooth normals too, under the reflection.
    fs::write(path("part.obj"), SMOOTH_PART).unwrap();
    let [smooth, plain] = ["baked", "plain"].map(|scene| {
        let (file, picture) = (format!("{scene}.json"), format!("smooth-{scene}.png"));
        let output = ["-o", &picture, "--quiet"];
        ends(&folder, 0, &[&["render", &file], &SMALL[..], &cpu, &output].concat());
        pixels(&picture)
    });
    assert!(smooth.pixels().zip(baked.pixels()).any(|(a, b)| far(a, b)), "no normal is seen");
    assert!(!smooth.pixels().zip(plain.pixels()).any(|(a, b)| far(a, b)));
    // A limit of memory: the text counts, and its entries.
    let length = BAKED.len();
    for (limit, place) in [(length - 1, "baked.json`: "), (length, "line 3, column ")] {
        let limit = limit.to_string();
        let limited = ["build", "baked.json", "-o", "x.scene", "--max-memory", &limit];
        let (_, error) = ends(&folder, 4, &[&limited[..], &cpu].concat());
        for words in [place, &format!("more than the limit of {limit}")] {
            assert!(error.contains(words), "{words}: {error}");
        }
    }
    let broken = BAKED.replace(
        "\"id\": 5, \"bake\": \"parts\", \"material\"",
        "\"bake\": \"parts\", \"material\"",
    );
    fs::write(path("broken.json"), broken).unwrap();
    let (_, error) = ends(&folder, 3, &["render", "broken.json", "-o", "x.png"]);
    for words in ["line 15, column", "instances[5].bake", "another number than instance 1"] {
        assert!(error.contains(words), "{words}: {error}");
    }
}

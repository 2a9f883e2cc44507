//! OBJ files, broken in every way, and the built-in scenes.

use proptest::prelude::*;
use splitplane::core::tree::digest::Xxh64;
use splitplane::scene::obj::{Element, ObjProblem, parse, read};
use splitplane::scene::{Scene, SceneError};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

fn problem(text: &str) -> (Option<u64>, ObjProblem) {
    let error = parse(text, "test.obj").unwrap_err();
    (error.line, error.problem)
}

fn indices(text: &str) -> Vec<[u32; 3]> {
    parse(text, "test.obj").unwrap().indices
}

#[test]
fn corners_in_every_form_give_the_same_triangle() {
    for face in
        ["1 2 3", "1/1 2/2 3/3", "1//1 2//2 3//3", "1/1/1 2/2/2 3/3/3", "-3 -2 -1", "+1 2 3"]
    {
        let others = "vt 0 0\nvt 1\nvt 0 1 0\nvn 0 0 1\nvn 0 0 2\nvn 0 1 0\n";
        assert_eq!(indices(&format!("{TRIANGLE}{others}f {face}\n")), [[0, 1, 2]], "{face}");
    }
}

#[test]
fn faces_become_fans_in_the_order_of_the_file() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 5 4 3 2 1\n";
    assert_eq!(indices(text), [[0, 1, 2], [0, 2, 3], [4, 3, 2], [4, 2, 1], [4, 1, 0]]);
}

#[test]
fn vertices_are_neither_merged_nor_moved() {
    let text = "v 9 9 9\nv 0 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\ng a\nf 3 4 5\ng b\nf 2 4 5\n";
    let scene = parse(text, "test.obj").unwrap();
    assert_eq!(scene.positions.len(), 5);
    assert_eq!(scene.positions[0], [9.0; 3]);
    assert_eq!(scene.indices, [[2, 3, 4], [1, 3, 4]]);
}

#[test]
fn faces_before_their_vertices_and_joined_lines_are_fine() {
    assert_eq!(indices(&format!("f 1 \\\n 2 \\\r\n3\n{TRIANGLE}")), [[0, 1, 2]]);
    assert_eq!(indices(&format!("\u{feff}{TRIANGLE}f 1 2 3 # done")), [[0, 1, 2]]);
    assert_eq!(indices(&format!("{TRIANGLE}f 1 2 3").replace('\n', "\r")), [[0, 1, 2]]);
}

#[test]
fn points_and_lines_are_skipped_and_counted() {
    let scene = parse(&format!("{TRIANGLE}f 1\nf 1 2\nf\np 1\nl 1 2\nf 1 2 3\n"), "x").unwrap();
    assert_eq!(scene.indices.len(), 1);
    assert_eq!(scene.notes.skipped_elements, 5);
    assert_eq!(scene.notes.sentences().len(), 1);
}

#[test]
fn vertices_that_are_not_finite_are_kept_and_counted() {
    let scene = parse("v nan 0 0\nv 1e39 0 0\nv 0 1 -inf\nv 1 1 1\nf 1 2 3\n", "x").unwrap();
    assert_eq!(scene.notes.non_finite_vertices, 3);
    assert_eq!(scene.indices.len(), 1);
    assert!(scene.bounds().is_empty());
}

#[test]
fn unknown_keywords_are_a_warning_and_freeform_is_counted() {
    let scene = parse(&format!("{TRIANGLE}hello\ncurv 0 1 1 2\nf 1 2 3\n"), "x").unwrap();
    assert_eq!(scene.notes.skipped_freeform, 1);
    assert!(scene.notes.warnings[0].contains("line 4: `hello`"), "{:?}", scene.notes);
}

#[test]
fn every_bad_line_is_named() {
    let after = |line: &str| problem(&format!("{TRIANGLE}{line}\nf 1 2 3\n"));
    let few = |of, found| ObjProblem::FewNumbers { of, found };
    assert_eq!(after("v 1 2"), (Some(4), few(Element::Vertex, 2)));
    assert_eq!(after("vn 1 2"), (Some(4), few(Element::Normal, 2)));
    assert_eq!(after("vt"), (Some(4), few(Element::TextureCoordinate, 0)));
    for keyword in ["v", "vn", "vt"] {
        let line = format!("{keyword} 1 x 2");
        assert_eq!(after(&line), (Some(4), ObjProblem::BadNumber("x".into())));
    }
    let ends = |of, index| (Some(4), ObjProblem::PastEnd { of, index, count: 3 });
    let starts = |of, index| (Some(4), ObjProblem::PastStart { of, index, count: 3 });
    let others = "vt 0 0\nvt 0 0\nvt 0 0\nvn 0 0 1\nvn 0 0 1\nvn 0 0 1\n";
    let corners = |word: &str, index: i64| {
        let face = word.replace('?', &index.to_string());
        problem(&format!("{TRIANGLE}f 1 2 3\n{others}f 1 2 {face}\n"))
    };
    let line = |(_, problem)| (Some(11), problem);
    let kinds =
        [(Element::Vertex, "?"), (Element::TextureCoordinate, "1/?"), (Element::Normal, "1//?")];
    for (of, word) in kinds {
        assert_eq!(corners(word, 0), (Some(11), ObjProblem::ZeroIndex(of)));
        let huge = 4_294_967_296 + 1;
        for index in [4, 9, huge] {
            assert_eq!(corners(word, index), line(ends(of, index as u64)));
        }
        for index in [-4, i64::MIN] {
            assert_eq!(corners(word, index), line(starts(of, index)));
        }
    }
    for corner in ["99999999999999999999", "x", "1.5", "/1", "1/2/3/4", "1/x", "1//x", "1/-"] {
        assert_eq!(
            after(&format!("f 1 2 {corner}")),
            (Some(4), ObjProblem::BadCorner(corner.into()))
        );
    }
    let past = ObjProblem::PastStart { of: Element::Vertex, index: -1, count: 0 };
    assert_eq!(problem("f -1 -1 -1\n"), (Some(1), past));
    // The first line at fault, although a later one is further out.
    let past = ObjProblem::PastEnd { of: Element::Vertex, index: 4, count: 3 };
    assert_eq!(problem(&format!("f 1 2 3\nf 1 2 4\nf 1 2 9\n{TRIANGLE}")), (Some(2), past));
    // Of several kinds too.
    let past = ObjProblem::PastEnd { of: Element::Normal, index: 1, count: 0 };
    assert_eq!(problem(&format!("f 1 2 3//1\nf 1 2 4\n{TRIANGLE}")), (Some(1), past));
}

#[test]
fn normals_and_texture_coordinates_keep_their_own_indices() {
    let n = Scene::NONE;
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nvt 0 0\nvt 1 0.5 9\nvt 7\n\
                vn 0 0 3\nvn 0 -2 0\nf 1/1/1 2/2/-1 3/3 4\nf -4//2 -3//2 -2//2\nf 1 2 4\n";
    let scene = parse(text, "x").unwrap();
    assert_eq!(scene.indices.len(), 5);
    assert_eq!(scene.texcoords, [[0.0, 0.0], [1.0, 0.5], [7.0, 0.0]]);
    assert_eq!(scene.normals, [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]);
    assert_eq!(scene.texcoord_indices, [[n; 3], [0, 1, 2], [0, 2, n], [n; 3], [n; 3]]);
    assert_eq!(scene.normal_indices, [[n; 3], [0, 1, n], [0, n, n], [1; 3], [n; 3]]);
    // Given, but used by no face: no indices.
    let scene = parse(&format!("{TRIANGLE}vn 0 0 1\nvt 0 0\nf 1 2 3\n"), "x").unwrap();
    assert!(scene.normal_indices.is_empty() && scene.texcoord_indices.is_empty());
}

#[test]
fn normals_without_a_direction_are_left_out_and_counted() {
    let n = Scene::NONE;
    let text = format!(
        "{TRIANGLE}f 1/1/1 2/2/2 3/1/4\nvn 0 0 0\nvn 0 nan 1\nvn inf 0 0\nvn 0 3e38 0\n\
         vt 0 0\nvt 1e99 0\n"
    );
    let scene = parse(&text, "x").unwrap();
    assert_eq!((scene.notes.unusable_normals, scene.notes.unusable_texcoords), (3, 1));
    assert_eq!(scene.notes.sentences().len(), 2);
    assert_eq!(scene.normal_indices, [[n, n, 3]]);
    assert_eq!(scene.texcoord_indices, [[0, n, 0]]);
    assert_eq!(scene.normals[3], [0.0, 1.0, 0.0]);
}

#[test]
fn nothing_to_hit_is_an_error() {
    for text in ["", "# only a comment\n", "v 0 0 0\n", "v 0 0 0\nf 1 1\n", "\u{0}\u{1}\u{2}"] {
        assert_eq!(problem(text), (None, ObjProblem::NoTriangles), "{text:?}");
    }
}

#[test]
fn files_that_are_no_text_or_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("latin.obj");
    fs::write(&path, b"v 0 0 0\n# caf\xe9\n").unwrap();
    let error = read(&path).unwrap_err();
    assert_eq!((error.line, error.problem.clone()), (Some(2), ObjProblem::NotUtf8));
    assert!(error.to_string().contains("latin.obj`, line 2: "), "{error}");
    assert_eq!(read(folder.path()).unwrap_err().problem, ObjProblem::Folder);
    assert_eq!(read(Path::new("no/such.obj")).unwrap_err().problem, ObjProblem::Missing);
    let unknown = Scene::open("scene.fbx").unwrap_err();
    assert!(matches!(unknown, SceneError::UnknownFormat(_)), "{unknown}");
}

#[test]
fn materials_come_from_mtl_files_and_may_be_missing() {
    let folder = tempfile::tempdir().unwrap();
    let obj = folder.path().join("a.obj");
    let text = format!(
        "mtllib the colours.mtl\nf 1 2 3\nusemtl red\n{TRIANGLE}f 1 2 3\nusemtl chrome\nf 1 2 3\nusemtl red\nf 1 2 3\nusemtl none\nf 1 2 3\n"
    );
    fs::write(&obj, text).unwrap();
    let scene = read(&obj).unwrap();
    assert_eq!(scene.material_of, [0, 1, 2, 1, 3]);
    assert!(scene.notes.warnings.iter().any(|w| w.contains("no such file")), "{:?}", scene.notes);
    let mtl = "newmtl red\nKd 1 0 0\nnewmtl chrome\nKd 0 0 0\nKs 0.8 0.8 0.8\n";
    fs::write(folder.path().join("the colours.mtl"), mtl).unwrap();
    let scene = read(&obj).unwrap();
    let colours: Vec<[f32; 3]> = scene.materials.iter().map(|m| m.diffuse).collect();
    assert_eq!(colours[1..3], [[1.0, 0.0, 0.0], [0.0; 3]]);
    assert_eq!(scene.materials[2].mirror, [0.8; 3]);
    assert_eq!(scene.notes.warnings, ["1 materials have no colour, the first is `none`"]);
    // A broken one is a warning as well.
    fs::write(folder.path().join("the colours.mtl"), b"newmtl red\nKd x y\n\xff").unwrap();
    let warnings = read(&obj).unwrap().notes.warnings;
    assert!(warnings[0].contains("1 lines left out, the first is line 2: `x`"), "{warnings:?}");
    assert!(warnings[1].contains("UTF-8"), "{warnings:?}");
}

/// Where test scenes may lie; they are not part of the repository.
fn shared(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("SPLITPLANE_SCENES").map(PathBuf::from);
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    let path = folder.unwrap_or(beside).join(name);
    if !path.is_file() {
        println!("skipped: there is no {}", path.display());
        return None;
    }
    Some(path)
}

/// Counts as in the scenes' own description, and the same triangles as another reader finds.
#[test]
fn real_files_have_their_triangles() {
    let counts = [
        ("horse.obj", 16_843, 8_431),
        ("bunny.obj", 69_451, 35_947),
        ("robots.obj", 71_708, 52_200),
        ("kitchen.obj", 110_561, 58_382),
        ("stadium.obj", 143_914, 72_418),
        ("dragon.obj", 202_520, 100_250),
        ("sponza.obj", 279_163, 153_523),
        ("bathroom.obj", 1_016_615, 513_444),
    ];
    for (name, triangles, vertices) in counts {
        let Some(path) = shared(name) else { continue };
        let scene = read(&path).unwrap();
        assert_eq!((scene.indices.len(), scene.positions.len()), (triangles, vertices), "{name}");
        // Thin plastics of robots; everything else is as written.
        let odd = (name == "robots.obj").then_some(
            "5 materials are more opaque than clear and are drawn opaque, the first is `m26`",
        );
        assert_eq!(scene.notes.sentences(), odd.as_slice(), "{name}");
        let ours: Vec<[[f32; 3]; 3]> = scene.triangles().collect();
        assert!(ours == by_tobj(&path), "{name} differs from what tobj reads");
    }
}

fn by_tobj(path: &Path) -> Vec<[[f32; 3]; 3]> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(path, &options).unwrap();
    let mut triangles = Vec::new();
    for mesh in models.into_iter().map(|model| model.mesh) {
        let corner = |&i: &u32| -> [f32; 3] {
            mesh.positions[3 * i as usize..3 * i as usize + 3].try_into().unwrap()
        };
        let (faces, _) = mesh.indices.as_chunks::<3>();
        triangles.extend(faces.iter().map(|face| face.each_ref().map(corner)));
    }
    triangles
}

fn digest(scene: &Scene) -> String {
    let mut state = Xxh64::new(0);
    for position in &scene.positions {
        state.write_words(&position.map(f32::to_bits));
    }
    for corners in &scene.indices {
        state.write_words(corners);
    }
    state.write_words(&scene.material_of);
    format!("{:016x}", state.finish())
}

#[test]
fn built_in_scenes_are_the_same_everywhere() {
    let mut lines = Vec::new();
    for name in
        ["cornell", "spheres", "stadium", "gallery", "carousel", "city", "city:1000", "city:50000"]
    {
        let scene = Scene::open(format!("builtin:{name}")).unwrap();
        assert_eq!(scene.material_of.len(), scene.indices.len());
        assert!(scene.mesh().is_ok() && scene.camera.is_some() && scene.is_lit());
        let counts =
            format!("{} triangles, {} vertices", scene.indices.len(), scene.positions.len());
        lines.push(format!("{name}: {counts}, {}", digest(&scene)));
    }
    insta::assert_snapshot!(lines.join("\n"));
}

#[test]
fn built_in_names_and_sizes_are_checked() {
    for bad in ["town", "city:", "city:999", "city:10000001", "city:many", "cornell:5", ""] {
        let error = Scene::open(format!("builtin:{bad}")).unwrap_err();
        assert!(matches!(error, SceneError::Builtin(_)), "{bad}: {error}");
    }
}

#[test]
fn a_city_has_about_as_many_triangles_as_asked_for() {
    for size in [1_000, 3_000, 10_000, 100_000, 1_000_000] {
        let scene = Scene::open(format!("builtin:city:{size}")).unwrap();
        let off = scene.indices.len().abs_diff(size) as f64 / size as f64;
        assert!(off < if size < 10_000 { 0.15 } else { 0.02 }, "{size}: {}", scene.indices.len());
    }
}

/// Every edge of a sphere, and of the knot, is passed once in each direction.
#[test]
fn closed_surfaces_are_closed() {
    for (name, open) in [("spheres", "ground"), ("stadium", "")] {
        let scene = Scene::open(format!("builtin:{name}")).unwrap();
        let mut edges: HashMap<[u32; 2], i32> = HashMap::new();
        let mut triangles = 0;
        for (i, &[a, b, c]) in scene.indices.iter().enumerate() {
            let material = scene.material(i).name;
            if material == open || (name == "stadium" && material != "copper") {
                continue;
            }
            triangles += 1;
            for [from, to] in [[a, b], [b, c], [c, a]] {
                assert!(from != to);
                *edges.entry([from.min(to), from.max(to)]).or_default() +=
                    if from < to { 1 } else { -1 };
            }
        }
        assert!(triangles > 10_000, "{name}");
        assert!(edges.values().all(|&sum| sum == 0), "{name}");
        // Closed: three edges for two triangles.
        assert_eq!(edges.len() * 2, triangles * 3, "{name}");
    }
}

/// Bodies light goes through have their outside where the corners run counter-clockwise, and so
/// have gears and knots; water is open below.
#[test]
fn bodies_face_outwards() {
    let mut bodies = 0;
    for name in ["spheres", "gallery", "carousel"] {
        let scene = Scene::open(format!("builtin:{name}")).unwrap();
        for (number, material) in scene.materials.iter().enumerate() {
            let solid = ["bronze", "red lead", "steel"].contains(&material.name.as_str());
            if material.dielectric.is_none() && !solid {
                continue;
            }
            let triangles = scene.triangles().zip(&scene.material_of);
            let (mut volume, mut up) = (0.0, 0.0);
            for (corners, _) in triangles.filter(|(_, of)| **of as usize == number) {
                let [a, b, c] = corners.map(|p| p.map(f64::from));
                let minor = |i: usize, j: usize| {
                    (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i])
                };
                let normal = [minor(1, 2), minor(2, 0), minor(0, 1)];
                volume += (0..3).map(|k| a[k] * normal[k]).sum::<f64>() / 6.0;
                up += normal[1] / 2.0;
            }
            bodies += 1;
            match material.name.as_str() {
                "water" => assert!(up > 3.0, "{up}"),
                // Counted exactly: 0.9 by 1.148 by 0.4.
                "green glass" => assert!((volume - 0.41328).abs() < 1e-5, "{volume}"),
                other => assert!(volume > 0.05, "{other} of {name}: {volume}"),
            }
        }
    }
    assert_eq!(bodies, 9);
}

#[test]
fn normals_and_texture_coordinates_of_built_in_scenes_fit() {
    for (name, textures) in [("spheres", 0), ("gallery", 3), ("carousel", 0), ("stadium", 0)] {
        let scene = Scene::open(format!("builtin:{name}")).unwrap();
        assert_eq!(scene.textures.len(), textures, "{name}");
        assert_eq!(scene.normal_indices.is_empty(), name == "stadium");
        for (i, (corners, named)) in scene.triangles().zip(&scene.normal_indices).enumerate() {
            let [a, b, c] = corners.map(|p| p.map(f64::from));
            let minor =
                |i: usize, j: usize| (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
            let face = [minor(1, 2), minor(2, 0), minor(0, 1)];
            for &normal in named.iter().filter(|normal| **normal != Scene::NONE) {
                let normal = scene.normals[normal as usize].map(f64::from);
                let length = normal.iter().map(|x| x * x).sum::<f64>();
                assert!((length - 1.0).abs() < 1e-5);
                let along: f64 = normal.iter().zip(face).map(|(n, f)| n * f).sum();
                assert!(along > 0.0, "{name}, triangle {i}: {normal:?} {face:?}");
            }
        }
        for (i, material) in scene.materials.iter().enumerate() {
            let of = |t: &usize| scene.material_of[*t] as usize == i;
            let mut triangles = (0..scene.indices.len()).filter(of);
            let placed = |t: usize| !scene.texcoord_indices[t].contains(&Scene::NONE);
            if material.texture.is_some() {
                assert!(triangles.all(placed), "{}", material.name);
            }
        }
    }
}

#[test]
fn the_stadium_is_ten_thousand_times_its_knot() {
    let scene = Scene::open("builtin:stadium").unwrap();
    let mut knot = splitplane::Aabb::EMPTY;
    for (i, corners) in scene.triangles().enumerate() {
        if scene.material(i).name == "copper" {
            knot = knot.union(&splitplane::Aabb::of_points(&corners));
        }
    }
    assert!(scene.bounds().diagonal() / knot.diagonal() >= 1e4);
}

/// Lines that look like OBJ, with every kind of mistake.
fn line() -> impl Strategy<Value = String> {
    let number = prop_oneof![
        any::<f32>().prop_map(|x| x.to_string()),
        any::<i64>().prop_map(|x| x.to_string()),
        (-5i64..9).prop_map(|x| x.to_string()),
        "[-+0-9.eE/naif\\\\#]{0,6}",
        "-?[0-4](/-?[0-4]?(/-?[0-4]?)?)?",
    ];
    let keyword = prop_oneof![
        Just("v"),
        Just("f"),
        Just("f"),
        Just("vn"),
        Just("vt"),
        Just("l"),
        Just("p"),
        Just("usemtl"),
        Just("mtllib"),
        Just("#"),
        Just("x"),
        Just("surf"),
    ];
    let ending = prop_oneof![Just("\n"), Just("\r\n"), Just("\\\n"), Just("\r"), Just("")];
    (keyword, prop::collection::vec(number, 0..6), ending)
        .prop_map(|(keyword, words, ending)| format!("{keyword} {}{ending}", words.join(" ")))
}

proptest! {
    #[test]
    fn text_like_obj_never_panics(lines in prop::collection::vec(line(), 0..40)) {
        if let Ok(scene) = parse(&lines.concat(), "any.obj") {
            prop_assert!(scene.mesh().is_ok());
            let triangles = scene.indices.len();
            prop_assert_eq!(triangles, scene.material_of.len());
            prop_assert!([0, triangles].contains(&scene.normal_indices.len()));
            prop_assert!([0, triangles].contains(&scene.texcoord_indices.len()));
            let exists = |count: usize| move |&i: &u32| i == Scene::NONE || (i as usize) < count;
            let normals = scene.normal_indices.as_flattened();
            prop_assert!(normals.iter().all(exists(scene.normals.len())));
            let texcoords = scene.texcoord_indices.as_flattened();
            prop_assert!(texcoords.iter().all(exists(scene.texcoords.len())));
            for &normal in normals.iter().filter(|&&normal| normal != Scene::NONE) {
                let length = scene.normals[normal as usize].iter().map(|x| x * x).sum::<f32>();
                prop_assert!((length - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn no_text_panics(text in any::<String>()) {
        let _ = parse(&text, "any.obj");
    }

    #[test]
    fn what_we_read_is_what_tobj_reads(
        vertices in prop::collection::vec(prop::array::uniform3(-1e3f32..1e3), 3..9),
        faces in prop::collection::vec(prop::collection::vec(-3i64..3, 3..6), 1..9),
    ) {
        // Indices that exist: 0 stands for the first vertex.
        let corner = |&i: &i64| if i < 0 { i } else { i + 1 };
        let mut text: String =
            vertices.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        for face in &faces {
            let words: Vec<String> = face.iter().map(|i| corner(i).to_string()).collect();
            text += &format!("f {}\n", words.join(" "));
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        fs::write(&path, text).unwrap();
        let ours: Vec<[[f32; 3]; 3]> = read(&path).unwrap().triangles().collect();
        prop_assert_eq!(ours, by_tobj(&path));
    }
}

//! Frames from files, broken in every way, and the built-in scene that moves.

use splitplane::core::tree::digest::Xxh64;
use splitplane::scene::animation::NpyError;
use splitplane::scene::obj::ObjProblem;
use splitplane::scene::{
    Animation, AnimationError, CameraError, Change, Scene, SceneError, SceneOptions,
};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn open(scene: &str, frames: Option<&Path>) -> Result<(Scene, Animation), AnimationError> {
    Animation::open(scene, frames, &SceneOptions::default())
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// A folder with a scene of one triangle and raw frames of it, frame `i` raised by `i`.
fn raw(frames: u32, json: &str) -> (TempDir, String, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("a.obj");
    fs::write(&scene, format!("{TRIANGLE}f 1 2 3\n")).unwrap();
    let bytes: Vec<u8> = (0..frames)
        .flat_map(|i| {
            let y = i as f32;
            [0.0, y, 0.0, 1.0, y, 0.0, 0.0, y + 1.0, 0.0]
        })
        .flat_map(f32::to_le_bytes)
        .collect();
    let bin = folder.path().join("a.frames.bin");
    fs::write(&bin, bytes).unwrap();
    fs::write(folder.path().join("a.frames.json"), json).unwrap();
    (folder, scene.to_str().unwrap().to_owned(), bin)
}

fn raised(y: f32) -> Vec<[f32; 3]> {
    vec![[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y + 1.0, 0.0]]
}

#[test]
fn raw_frames_come_in_any_order_and_in_the_same_memory() {
    let json = r#"{"vertices": 3, "frames": 4, "times_s": [0, 0.5, 1, 2.5], "other": [],
        "fov_y_deg": 30, "camera_per_frame": [
        {"eye": [0, 0, 9], "dir": [0, 0, -2], "up": [0, 1, 0]},
        {"eye": [0, 0, 8], "dir": [0, 0, -1], "up": [0, 1, 0]},
        {"eye": [0, 0, 0], "dir": [1, 0, 0], "up": [0, 1, 0]},
        {"eye": [0, 0, 6], "dir": [0, 0, -1], "up": [0, 1, 0]}]}"#;
    let (folder, scene, bin) = raw(4, json);
    // The description names the frames as well as they do.
    for frames in [bin, folder.path().join("a.frames.json")] {
        let (mut scene, mut animation) = open(&scene, Some(&frames)).unwrap();
        assert_eq!(animation.frames(), 4);
        assert_eq!(scene.positions, raised(0.0));
        let (memory, capacity) = (scene.positions.as_ptr(), scene.positions.capacity());
        assert_eq!(animation.set(0, &mut scene).unwrap(), Change::Nothing);
        for frame in [3, 1, 1, 2, 0, 3] {
            let before = scene.positions.clone();
            let change = animation.set(frame, &mut scene).unwrap();
            assert_eq!(scene.positions, raised(frame as f32));
            let same = before == scene.positions;
            assert_eq!(change, if same { Change::Nothing } else { Change::Positions });
        }
        assert_eq!((scene.positions.as_ptr(), scene.positions.capacity()), (memory, capacity));
        assert_eq!((animation.time(3), animation.time(4)), (Some(2.5), None));
        let camera = animation.camera(1).unwrap();
        assert_eq!((camera.eye(), camera.fov_degrees()), ([0.0, 0.0, 8.0], 30.0));
        assert_eq!(animation.camera(2).unwrap().look_at(), [1.0, 0.0, 0.0]);
        assert!(animation.camera(4).is_none());
        let past = animation.set(4, &mut scene).unwrap_err();
        assert!(matches!(past, AnimationError::NoSuchFrame { frame: 4, frames: 4 }), "{past}");
        let another = animation.set(1, &mut Scene::default()).unwrap_err();
        assert!(
            matches!(another, AnimationError::AnotherScene { expected: 3, found: 0 }),
            "{another}"
        );
    }
}

#[test]
fn descriptions_that_do_not_fit_are_refused() {
    let bad = [
        "",
        "[]",
        "{\"vertices\": 3}",
        "{\"vertices\": -3, \"frames\": 2}",
        "{\"vertices\": 3, \"frames\": 0}",
        "{\"vertices\": 0, \"frames\": 2}",
        "{\"vertices\": 3, \"frames\": 2, \"times_s\": [1]}",
        "{\"vertices\": 3, \"frames\": 2, \"camera_per_frame\": []}",
        "{\"vertices\": 3, \"frames\": 2, \"camera_per_frame\": [1, 2]}",
        "{\"vertices\": 3, \"frames\": 18446744073709551615}",
    ];
    for json in bad {
        let (_folder, scene, bin) = raw(2, json);
        let error = open(&scene, Some(&bin)).unwrap_err();
        assert!(matches!(error, AnimationError::BadDescription { .. }), "{json}: {error}");
        assert!(error.to_string().contains("a.frames.json"), "{error}");
    }
    let (_folder, scene, bin) = raw(2, r#"{"vertices": 4, "frames": 2}"#);
    let error = open(&scene, Some(&bin)).unwrap_err();
    assert!(matches!(error, AnimationError::VertexCount { frame: 4, scene: 3, .. }), "{error}");
    let (_folder, scene, bin) = raw(2, r#"{"vertices": 3, "frames": 3}"#);
    let error = open(&scene, Some(&bin)).unwrap_err();
    let sizes = |error: &AnimationError| match *error {
        AnimationError::WrongSize { expected, found, .. } => Some((expected, found)),
        _ => None,
    };
    assert_eq!(sizes(&error), Some((108, 72)), "{error}");
    assert!(error.to_string().contains("a.frames.bin` has 72 bytes"), "{error}");
    for (pose, want) in [
        (r#""eye": [0,0,0], "dir": [0,0,0], "up": [0,1,0]"#, CameraError::NoDirection),
        (r#""eye": [0,0,0], "dir": [1,0,0], "up": [0,0,0]"#, CameraError::NoUp),
        (r#""eye": [1e300,0,0], "dir": [1,0,0], "up": [0,1,0]"#, CameraError::NotFinite),
    ] {
        let json = format!(
            r#"{{"vertices": 3, "frames": 2, "camera_per_frame": [
            {{"eye": [0,0,1], "dir": [0,0,-1], "up": [0,1,0]}}, {{{pose}}}]}}"#
        );
        let (_folder, scene, bin) = raw(2, &json);
        let error = open(&scene, Some(&bin)).unwrap_err();
        let is_it =
            matches!(&error, AnimationError::Camera { frame: 1, error, .. } if *error == want);
        assert!(is_it, "{error}");
    }
    let json = r#"{"vertices": 3, "frames": 1, "fov_y_deg": 180, "camera_per_frame": [
        {"eye": [0,0,1], "dir": [0,0,-1], "up": [0,1,0]}]}"#;
    let (_folder, scene, bin) = raw(1, json);
    let error = open(&scene, Some(&bin)).unwrap_err();
    assert!(error.to_string().contains("field of view"), "{error}");
}

#[test]
fn frames_that_are_not_there_are_refused() {
    let (folder, scene, bin) = raw(2, r#"{"vertices": 3, "frames": 2}"#);
    let path = |name: &str| folder.path().join(name);
    let error = open(&scene, None).unwrap_err();
    assert!(matches!(error, AnimationError::NoFrames(_)), "{error}");
    let error = open("builtin:city", None).unwrap_err();
    assert!(matches!(error, AnimationError::NoFrames(_)), "{error}");
    let error = open("builtin:town", None).unwrap_err();
    assert!(matches!(error, AnimationError::Scene(SceneError::Builtin(_))), "{error}");
    let error = open("no/such.obj", Some(&bin)).unwrap_err();
    assert!(matches!(error, AnimationError::Scene(SceneError::Obj(_))), "{error}");
    for name in ["missing.bin", "missing.txt", "missing"] {
        let error = open(&scene, Some(&path(name))).unwrap_err();
        assert!(matches!(error, AnimationError::Unreadable { .. }), "{name}: {error}");
        assert!(error.to_string().contains("no such file"), "{error}");
    }
    let error = open(&scene, Some(Path::new(&scene))).unwrap_err();
    assert!(matches!(error, AnimationError::NotFrames(_)), "{error}");
    fs::create_dir(path("empty")).unwrap();
    fs::write(path("empty/readme.txt"), "no frames").unwrap();
    let error = open(&scene, Some(&path("empty"))).unwrap_err();
    assert!(matches!(error, AnimationError::EmptyFolder(_)), "{error}");
    // A file that shrinks while it is open.
    let (mut opened, mut animation) = open(&scene, Some(&bin)).unwrap();
    fs::write(&bin, [0; 40]).unwrap();
    let error = animation.set(1, &mut opened).unwrap_err();
    assert!(matches!(error, AnimationError::Unreadable { .. }), "{error}");
}

/// An .npy file of this type, order and shape.
fn npy(version: u8, kind: &str, order: &str, shape: &str, numbers: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY".to_vec();
    bytes.extend([version, 0]);
    match version {
        1 => bytes.extend((text.len() as u16).to_le_bytes()),
        _ => bytes.extend((text.len() as u32).to_le_bytes()),
    }
    bytes.extend(text.bytes());
    bytes.extend(numbers);
    bytes
}

#[test]
fn frames_of_arrays_come_in_any_order() {
    let (folder, scene, bin) = raw(4, "{}");
    let numbers = fs::read(bin).unwrap();
    let (narrow, _) = numbers.as_chunks::<4>();
    // Not all f64 are f32.
    let wide: Vec<u8> = narrow
        .iter()
        .flat_map(|x| (f64::from(f32::from_le_bytes(*x)) * (1.0 + 1e-12)).to_le_bytes())
        .collect();
    let path = folder.path().join("a.npy");
    for (version, kind, numbers) in
        [(1, "'<f4'", &numbers), (2, "'<f8'", &wide), (3, "\"<f4\"", &numbers)]
    {
        fs::write(&path, npy(version, kind, "False", "(4, 3, 3)", numbers)).unwrap();
        let (mut scene, mut animation) = open(&scene, Some(&path)).unwrap();
        assert_eq!((animation.frames(), scene.positions.clone()), (4, raised(0.0)));
        for frame in [3, 1, 2, 0] {
            assert_eq!(animation.set(frame, &mut scene).unwrap(), Change::Positions);
            assert_eq!(scene.positions, raised(frame as f32));
        }
        assert!(animation.time(0).is_none() && animation.camera(0).is_none());
        let past = animation.set(4, &mut scene).unwrap_err();
        assert!(matches!(past, AnimationError::NoSuchFrame { frame: 4, frames: 4 }), "{past}");
        // A file that shrinks while it is open.
        fs::write(&path, [0; 40]).unwrap();
        let error = animation.set(1, &mut scene).unwrap_err();
        assert!(matches!(error, AnimationError::Unreadable { .. }), "{error}");
    }
}

#[test]
fn arrays_that_are_no_frames_are_refused() {
    let (folder, scene, bin) = raw(2, "{}");
    let numbers = fs::read(bin).unwrap();
    let path = folder.path().join("a.NPY");
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = open(&scene, Some(&path)).unwrap_err();
        assert!(error.to_string().contains("a.NPY`"), "{error}");
        error
    };
    let of =
        |kind, order, shape, numbers: &[u8]| match refused(&npy(1, kind, order, shape, numbers)) {
            AnimationError::Array { error, .. } => error,
            other => panic!("{other}"),
        };
    let (good, shape) = (&numbers[..], "(2, 3, 3)");
    assert_eq!(of("'>f4'", "False", shape, good), NpyError::Type(">f4".into()));
    assert_eq!(of("'<i4'", "False", shape, good), NpyError::Type("<i4".into()));
    assert_eq!(of("'<f4'", "True", shape, good), NpyError::Fortran);
    for shape in ["(6, 3)", "(2, 3, 2)", "(2, 3, 3, 1)", "(18,)", "()", "(0, 3, 3)", "(2, 0, 3)"] {
        let error = of("'<f4'", "False", shape, good);
        let expected = "(frames, vertices, 3)";
        assert_eq!(error, NpyError::Shape { found: shape.into(), expected });
    }
    let length = |promised, found| NpyError::Length { promised, found };
    assert_eq!(of("'<f4'", "False", "(3, 3, 3)", good), length(108, 72));
    assert_eq!(of("'<f8'", "False", shape, good), length(144, 72));
    assert_eq!(of("'<f4'", "False", shape, &good[..71]), length(72, 71));
    let many = "(9223372036854775807, 3, 3)";
    assert_eq!(of("'<f4'", "False", many, good), NpyError::Header);
    let other = refused(&npy(1, "'<f4'", "False", "(3, 2, 3)", good));
    let expected = matches!(other, AnimationError::VertexCount { frame: 2, scene: 3, .. });
    assert!(expected, "{other}");
    let whole = npy(1, "'<f4'", "False", shape, good);
    for cut in 0..whole.len() {
        let error = refused(&whole[..cut]);
        assert!(matches!(error, AnimationError::Array { .. }), "{cut}: {error}");
    }
    // A head that says it is longer than any is read.
    let mut long = b"\x93NUMPY\x02\x00".to_vec();
    long.extend(u32::MAX.to_le_bytes());
    let error = refused(&long);
    assert!(matches!(error, AnimationError::Array { error: NpyError::Header, .. }), "{error}");
}

/// A roof of two faces with a sharp ridge, whose normals the file shares between vertices.
#[test]
fn normals_follow_the_positions_and_edges_stay_sharp() {
    let (folder, scene, bin) = raw(1, r#"{"vertices": 6, "frames": 2}"#);
    let points = "v 0 1 0\nv 0 1 1\nv 1 0 0\nv 1 0 1\nv -1 0 0\nv -1 0 1\n";
    let faces = "vn 1 1 0\nvn -1 1 0\nf 1//1 2//1 4//1 3//1\nf 1//2 5//2 6//2 2//2\n";
    fs::write(&scene, format!("{points}{faces}")).unwrap();
    let low = [
        0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, -1.0, 0.0, 0.0, -1.0, 0.0, 1.0,
    ];
    // The right side falls to the depth of the ridge's height.
    let mut steep: [f32; 18] = low;
    steep[7] = -1.0;
    steep[10] = -1.0;
    let bytes: Vec<u8> = [low, steep].as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(&bin, bytes).unwrap();
    let (mut scene, mut animation) = open(&scene, Some(&bin)).unwrap();
    assert_eq!(scene.normals.len(), 8);
    let normals = |scene: &Scene, triangle: usize| {
        scene.normal_indices[triangle].map(|normal| scene.normals[normal as usize])
    };
    let near = |found: [[f32; 3]; 3], want: [f32; 3]| {
        let length = want.iter().map(|x| x * x).sum::<f32>().sqrt();
        let close = |(a, b): (&f32, f32)| (a - b / length).abs() < 1e-6;
        assert!(found.iter().all(|n| n.iter().zip(want).all(close)), "{found:?} {want:?}");
    };
    near(normals(&scene, 0), [1.0, 1.0, 0.0]);
    near(normals(&scene, 2), [-1.0, 1.0, 0.0]);
    let memory = scene.normals.as_ptr();
    animation.set(1, &mut scene).unwrap();
    near(normals(&scene, 0), [2.0, 1.0, 0.0]);
    near(normals(&scene, 1), [2.0, 1.0, 0.0]);
    near(normals(&scene, 3), [-1.0, 1.0, 0.0]);
    assert_eq!(memory, scene.normals.as_ptr());
    drop(folder);
}

#[test]
fn frames_of_a_folder_come_in_natural_order() {
    let (folder, scene, _) = raw(1, "");
    let frames = folder.path().join("frames");
    fs::create_dir(&frames).unwrap();
    let library = "mtllib ../m.mtl\nusemtl m\n";
    for i in 1..=12 {
        let text = format!("{library}v 0 {i} 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        fs::write(frames.join(format!("frame{i}.obj")), text).unwrap();
    }
    fs::write(frames.join("readme.txt"), "not a frame").unwrap();
    fs::write(folder.path().join("m.mtl"), "newmtl m\nKd 1 0 0\n").unwrap();
    // The last two differ in triangles.
    let more = format!("{library}{TRIANGLE}v 0 0 1\nf 1 2 3\nf 1 2 4\n");
    fs::write(frames.join("frame13.obj"), &more).unwrap();
    fs::write(frames.join("frame14.OBJ"), more.replace("f 1 2 4", "f 1 4 2")).unwrap();
    let (mut scene, mut animation) = open(&scene, Some(&frames)).unwrap();
    assert_eq!((animation.frames(), scene.name.as_str()), (14, "a.obj"));
    assert_eq!(scene.positions[0][1], 1.0);
    for frame in [11, 3, 9, 0] {
        assert_eq!(animation.set(frame, &mut scene).unwrap(), Change::Positions);
        assert_eq!(scene.positions[0][1], (frame + 1) as f32);
        assert_eq!(scene.materials[0].diffuse, [1.0, 0.0, 0.0]);
    }
    assert_eq!(animation.set(12, &mut scene).unwrap(), Change::Everything);
    assert_eq!(scene.indices.len(), 2);
    assert_eq!(animation.set(13, &mut scene).unwrap(), Change::Everything);
    assert_eq!(scene.indices[1], [0, 3, 1]);
    // After two rounds every frame has found memory of its size, and needs no other.
    let capacities: Vec<Vec<usize>> = (0..6)
        .map(|_| {
            let frame = |frame: usize| {
                animation.set(frame, &mut scene).unwrap();
                [scene.positions.capacity(), scene.indices.capacity(), scene.material_of.capacity()]
            };
            (0..14).flat_map(frame).collect()
        })
        .collect();
    assert_eq!(capacities[2], capacities[4]);
    // A frame that breaks later.
    fs::write(frames.join("frame5.obj"), format!("{TRIANGLE}f 1 2 9\n")).unwrap();
    let before = scene.clone();
    let error = animation.set(4, &mut scene).unwrap_err();
    let AnimationError::Frame { frame: 4, error } = error else { panic!("{error}") };
    assert_eq!(error.line, Some(4));
    assert_eq!(scene, before);
    fs::remove_file(frames.join("frame5.obj")).unwrap();
    let error = animation.set(4, &mut scene).unwrap_err();
    let AnimationError::Frame { error, .. } = &error else { panic!("{error}") };
    assert_eq!(error.problem, ObjProblem::Missing);
    assert_eq!(animation.set(5, &mut scene).unwrap(), Change::Everything);
    assert_eq!(scene.positions[0][1], 6.0);
}

#[test]
fn real_frames_begin_with_their_scene() {
    let Some(folder) = splitplane_test_support::scenes::folder() else { return };
    for (name, frames, times) in [("robots", 16, true), ("horse", 24, false)] {
        let path = folder.join(format!("{name}.obj"));
        let bin = folder.join(format!("{name}.frames.bin"));
        let alone = Scene::open(path.to_str().unwrap()).unwrap();
        let (mut scene, mut animation) = open(path.to_str().unwrap(), Some(&bin)).unwrap();
        assert_eq!(animation.frames(), frames);
        let near = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(scene.positions.iter().zip(&alone.positions).all(|(a, b)| near(a, b)), "{name}");
        assert_eq!(scene.indices, alone.indices);
        let memory = (scene.positions.as_ptr(), scene.positions.capacity());
        assert_eq!(animation.set(frames - 1, &mut scene).unwrap(), Change::Positions);
        assert!(scene.positions != alone.positions);
        assert_eq!(memory, (scene.positions.as_ptr(), scene.positions.capacity()));
        assert_eq!(animation.time(1), times.then_some(3.0));
        let camera = animation.camera(0).map(|camera| (camera.eye(), camera.fov_degrees().round()));
        assert_eq!(camera, times.then_some(([-3.5, 2.0, -203.0], 37.0)));
    }
}

fn digest(scene: &Scene) -> String {
    let mut state = Xxh64::new(0);
    for position in scene.positions.iter().chain(&scene.normals) {
        state.write_words(&position.map(f32::to_bits));
    }
    format!("{:016x}", state.finish())
}

#[test]
fn the_carousel_is_the_same_everywhere_and_has_no_seam() {
    let (mut scene, mut animation) = open("builtin:carousel", None).unwrap();
    let frames = animation.frames();
    assert_eq!((frames, animation.time(24)), (120, Some(1.0)));
    assert_eq!(scene, Scene::open("builtin:carousel").unwrap());
    let first = scene.clone();
    let memory = (scene.positions.as_ptr(), scene.normals.as_ptr());
    let mut lines = Vec::new();
    let mut steps: Vec<f32> = Vec::new();
    let mut before = scene.positions.clone();
    // A round, and the step back to the first frame last.
    for frame in (1..frames).chain([0]) {
        assert_eq!(animation.set(frame, &mut scene).unwrap(), Change::Positions);
        let moved = |(a, b): (&[f32; 3], &[f32; 3])| {
            a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        steps.push(scene.positions.iter().zip(&before).map(moved).fold(0.0, f32::max));
        before.clone_from(&scene.positions);
        assert!(scene.normals.iter().flatten().all(|x| x.is_finite()));
        if frame % 40 == 7 || frame == 0 {
            lines.push(format!("{frame}: {}", digest(&scene)));
        }
    }
    assert_eq!(scene, first);
    assert_eq!(memory, (scene.positions.as_ptr(), scene.normals.as_ptr()));
    let seam = steps[frames - 1];
    let most = steps[..frames - 1].iter().copied().fold(0.0, f32::max);
    assert!(seam > 0.0 && seam <= 1.01 * most, "{seam} {most}");
    insta::assert_snapshot!(lines.join("\n"));
}

#[test]
fn a_carousel_has_about_as_many_triangles_as_asked_for() {
    for size in [4_000, 10_000, 40_000, 300_000] {
        let (scene, mut animation) = open(&format!("builtin:carousel:{size}"), None).unwrap();
        let off = scene.indices.len().abs_diff(size) as f64 / size as f64;
        assert!(off < if size < 40_000 { 0.2 } else { 0.03 }, "{size}: {}", scene.indices.len());
        let mut scene = scene;
        animation.set(60, &mut scene).unwrap();
        assert!(scene.mesh().is_ok() && scene.positions.iter().flatten().all(|x| x.is_finite()));
    }
    for bad in ["3999", "10000001", "x", ""] {
        let error = open(&format!("builtin:carousel:{bad}"), None).unwrap_err();
        assert!(matches!(error, AnimationError::Scene(SceneError::Builtin(_))), "{bad}: {error}");
    }
}

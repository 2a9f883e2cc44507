//! The verbs `points` and `distances` from outside: files, reports, exit codes.

use crate::common::program;
use serde_json::Value;
use std::fs;
use std::process::{Command, Output};
use tempfile::TempDir;

fn run(folder: &TempDir, arguments: &[&str]) -> Output {
    let mut command = program(folder.path());
    command.env("SPLITPLANE_ISA", "portable").args(arguments).output().unwrap()
}

fn succeed(folder: &TempDir, arguments: &[&str]) -> [String; 2] {
    let output = run(folder, arguments);
    let [out, error] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {error}");
    [out, error]
}

fn fail(folder: &TempDir, code: i32, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked") && output.stdout.is_empty(), "{error}");
    error
}

fn json(folder: &TempDir, arguments: &[&str]) -> Value {
    let [out, _] = succeed(folder, &[arguments, &["--json"]].concat());
    serde_json::from_str(&out).unwrap()
}

fn floats(folder: &TempDir, name: &str) -> Vec<f32> {
    let bytes = fs::read(folder.path().join(name)).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// A grid of 6 x 6 points on the plane z = 1, one point far above it, two that are left out.
fn cloud() -> (TempDir, Vec<[f32; 3]>) {
    let folder = tempfile::tempdir().unwrap();
    let mut points: Vec<[f32; 3]> =
        (0..36).map(|i| [(i % 6) as f32, (i / 6) as f32, 1.0]).collect();
    points.push([2.0, 2.0, 9.0]);
    points.push([f32::NAN, 0.0, 0.0]);
    points.push([0.0, f32::INFINITY, 0.0]);
    let line = |point: &[f32; 3]| format!("{} {} {} 200 100 0\n", point[0], point[1], point[2]);
    let text: String = points.iter().map(line).collect();
    fs::write(folder.path().join("cloud.xyz"), format!("# a grid\n{text}")).unwrap();
    (folder, points)
}

#[test]
fn a_cloud_has_statistics_and_says_what_it_left_out() {
    let (folder, points) = cloud();
    let [out, error] = succeed(&folder, &["points", "cloud.xyz"]);
    assert!(
        error.contains("note: 2 points were left out: a coordinate is NaN or infinite"),
        "{error}"
    );
    assert!(out.contains("39 points, 2 left out") && out.contains("0 0 1 to 5 5 9"), "{out}");
    let report = json(&folder, &["points", "cloud.xyz", "--axes", "cycle", "-q"]);
    assert_eq!(report["points"], points.len());
    assert_eq!((report["left_out"].as_u64(), report["nodes"].as_u64()), (Some(2), Some(2)));
    assert_eq!(report["axes"], "cycle");
    let spacing = &report["spacing"];
    assert_eq!((spacing["least"].as_f64(), spacing["median"].as_f64()), (Some(1.0), Some(1.0)));
    assert_eq!(
        (spacing["greatest"].as_f64(), spacing["coincident"].as_u64()),
        (Some(8.0), Some(0))
    );
    // The same cloud in other files is the same tree.
    for name in ["cloud.npy", "cloud.ply"] {
        let thin = ["points", "cloud.xyz", "--thin", name, "--spacing", "0.5", "-q"];
        succeed(&folder, &thin);
        let same = json(&folder, &["points", name, "-q"]);
        assert_eq!((same["points"].as_u64(), same["left_out"].as_u64()), (Some(37), Some(0)));
        assert_eq!(same["spacing"], report["spacing"]);
    }
}

#[test]
fn a_backend_is_chosen_by_name() {
    let (folder, _) = cloud();
    let report = json(&folder, &["points", "cloud.xyz", "-q"]);
    assert_eq!(
        (report["backend"].as_str(), report["reason"].as_str()),
        (Some("cpu"), Some("asked for"))
    );
    let report = json(&folder, &["points", "cloud.xyz", "-q", "--backend", "auto"]);
    assert_eq!(report["backend"], "cpu");
    assert!(report["reason"].as_str().unwrap().starts_with("auto: the CPU, since"), "{report}");
    let error = fail(&folder, 5, &["points", "cloud.xyz", "--backend", "wgpu"]);
    assert!(error.contains("no GPU adapter was found"), "{error}");
    fail(&folder, 2, &["points", "cloud.xyz", "--backend", "gpu"]);
    fail(&folder, 2, &["points", "cloud.xyz", "--backend", "cpu", "--adapter", "0"]);
}

/// A device, software included, writes the CPU's bytes.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
#[cfg(feature = "wgpu")]
fn a_device_writes_the_same_files() {
    let (folder, _) = cloud();
    let mut digests = Vec::new();
    for backend in ["cpu", "wgpu"] {
        let [near, within, normals] =
            ["near", "within", "normals"].map(|name| format!("{backend}-{name}.bin"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
        command.env("NODEVICE_SELECT", "1").current_dir(folder.path());
        command.args(["points", "cloud.xyz", "--json", "--k", "4", "--radius", "1.5"]);
        command.args(["--backend", backend, "--nearest", &near, "--within", &within]);
        let output = command.args(["--normals", &normals]).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{error}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["backend"], backend);
        digests.push(report["digest"].clone());
    }
    assert_eq!(digests[0], digests[1]);
    for name in ["near.bin", "within.bin", "within.starts.bin", "normals.bin"] {
        let [cpu, wgpu] = ["cpu", "wgpu"]
            .map(|backend| fs::read(folder.path().join(format!("{backend}-{name}"))).unwrap());
        assert!(!cpu.is_empty() && cpu == wgpu, "{name}");
    }
}

#[test]
fn neighbours_normals_outliers_and_a_thinner_cloud_are_written() {
    let (folder, points) = cloud();
    let queries: Vec<u8> = [[0.1f32, 0.0, 1.0], [9.0, 9.0, 9.0]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    fs::write(folder.path().join("queries.bin"), queries).unwrap();
    let near = ["--queries", "queries.bin", "--nearest", "near.bin", "--k", "3"];
    let within = ["--within", "within.bin", "--radius", "1.1"];
    let report = json(&folder, &[&["points", "cloud.xyz", "-q"][..], &near, &within].concat());
    let near = floats(&folder, "near.bin");
    assert_eq!(near.len(), 2 * 3 * 2);
    let numbers: Vec<u32> = near.iter().skip(1).step_by(2).map(|x| x.to_bits()).collect();
    assert_eq!(numbers[..3], [0, 1, 6]);
    assert!((near[0] - 0.1).abs() < 1e-6 && (near[2] - 0.9).abs() < 1e-6);
    assert_eq!(report["nearest"]["found"], 6);
    assert_eq!(report["within"]["found"], 3, "the query's own three, and none of the far one");
    let starts = fs::read(folder.path().join("within.starts.bin")).unwrap();
    assert_eq!(starts.as_chunks::<8>().0.iter().map(|x| x[0]).collect::<Vec<_>>(), [0, 3, 3]);
    // Left out are those that are not finite; only the point above the plane is far from the others.
    let all = ["--normals", "normals.bin", "--outliers", "outliers.bin", "--k", "5"];
    let report = json(&folder, &[&["points", "cloud.xyz", "-q"][..], &all].concat());
    let outliers = fs::read(folder.path().join("outliers.bin")).unwrap();
    let expected: Vec<u8> =
        (0..39).map(|i| [0, 1, 2][usize::from(i > 35) + usize::from(i > 36)]).collect();
    assert_eq!(outliers, expected);
    assert_eq!(report["outliers"]["found"], 1);
    let normals = floats(&folder, "normals.bin");
    for index in 0..36 {
        let own = &normals[4 * index..][..4];
        assert!(own[2] > 0.999_999 && own[3] < 1e-6, "{index}: {own:?}");
    }
    assert_eq!(normals[4 * 37..], [0.0; 8]);
    assert_eq!(report["without_normal"], 2);
    let below = ["--normals", "normals.bin", "--viewpoint=0,0,-5", "--k", "5", "-q"];
    succeed(&folder, &[&["points", "cloud.xyz"][..], &below].concat());
    assert!(floats(&folder, "normals.bin")[2] < -0.999_999);
    let thin =
        ["--thin", "thin.xyz", "--spacing", "1.5", "--picture", "cloud.png", "--size", "200x160"];
    let report = json(&folder, &[&["points", "cloud.xyz", "-q"][..], &thin].concat());
    let text = fs::read_to_string(folder.path().join("thin.xyz")).unwrap();
    let kept: Vec<Vec<f32>> = text
        .lines()
        .map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect())
        .collect();
    assert_eq!(report["thinned"]["kept"], kept.len());
    let far = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>() >= 1.5 * 1.5
    };
    for (place, point) in kept.iter().enumerate() {
        assert!(kept[..place].iter().all(|other| far(point, other)), "{point:?}");
    }
    for point in points.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
        assert!(kept.iter().any(|other| !far(point, other)), "{point:?} has nobody near");
    }
    let picture = image::open(folder.path().join("cloud.png")).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (200, 160));
    let paper = *picture.get_pixel(0, 0);
    assert!(picture.pixels().filter(|pixel| **pixel != paper).count() > 37);
}

#[test]
fn wrong_usage_bad_clouds_and_limits_have_their_codes() {
    let (folder, _) = cloud();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("bad.xyz"), "1 2 3\n4 five 6\n").unwrap();
    fs::write(path("none.xyz"), "nan 0 0\n").unwrap();
    fs::write(path("bad.npy"), b"\x93NUMPY\x01\x00").unwrap();
    fs::write(path("bad.ply"), "ply\nformat ascii 1.0\nelement vertex 9\nend_header\n").unwrap();
    assert!(fail(&folder, 3, &["points", "bad.xyz"]).contains("line 2: `five` is no number"));
    assert!(fail(&folder, 3, &["points", "bad.npy"]).contains("bad.npy"));
    assert!(fail(&folder, 3, &["points", "bad.ply"]).contains("bad.ply"));
    fail(&folder, 3, &["points", "missing.xyz"]);
    fail(&folder, 3, &["points", "none.xyz", "-q", "--picture", "none.png"]);
    let report = json(&folder, &["points", "none.xyz", "-q"]);
    assert_eq!((report["left_out"].as_u64(), report["spacing"].is_null()), (Some(1), true));
    fail(&folder, 2, &["points", "cloud.xyz", "--picture", "cloud.jpg"]);
    fail(&folder, 2, &["points", "cloud.xyz", "--queries", "cloud.npy"]);
    fail(&folder, 2, &["points", "cloud.xyz", "--thin", "thin.xyz"]);
    fail(&folder, 2, &["points", "cloud.xyz", "--within", "within.bin"]);
    // What is asked for is not passed over, and no file is written twice, or over what is read.
    for unused in [
        ["--radius", "1"],
        ["--spacing", "1"],
        ["--deviations", "1"],
        ["--viewpoint", "0,0,1"],
        ["--max-distance", "1"],
        ["--size", "9x9"],
    ] {
        fail(&folder, 2, &[&["points", "cloud.xyz"][..], &unused].concat());
    }
    let twice = ["points", "cloud.xyz", "--normals", "a.bin", "--outliers", "./a.bin"];
    assert!(fail(&folder, 2, &twice).contains("`./a.bin` is written already"));
    let over = ["points", "cloud.xyz", "--normals", "./cloud.xyz"];
    assert!(fail(&folder, 2, &over).contains("`./cloud.xyz` is read already"));
    assert!(fs::read_to_string(path("cloud.xyz")).unwrap().starts_with("# a grid"));
    assert!(
        fail(&folder, 4, &["points", "cloud.xyz", "-q", "--max-memory", "100"]).contains("100")
    );
    assert!(fail(&folder, 4, &["points", "cloud.xyz", "--max-file", "20"]).contains("--max-file"));
    let within = ["points", "cloud.xyz", "-q", "--within", "w.bin", "--radius", "99"];
    fail(&folder, 4, &[&within[..], &["--max-memory", "8k"]].concat());
    assert!(!path("w.bin").exists());
    fail(&folder, 7, &["points", "cloud.xyz", "-q", "--timeout", "0.000001"]);
}

#[test]
fn distances_on_a_grid_are_those_of_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    // A cube of side 2.
    let mut text = String::new();
    for corner in 0..8 {
        let at = [0, 1, 2].map(|axis| 2 * (corner >> axis & 1));
        text += &format!("v {} {} {}\n", at[0], at[1], at[2]);
    }
    text += "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    fs::write(folder.path().join("cube.obj"), text).unwrap();
    let grid = ["distances", "cube.obj", "--backend", "cpu", "-q", "--out", "grid.npy"];
    let asked = [&grid[..], &["--steps", "4", "--margin", "0.5", "--signed"]].concat();
    let report = json(&folder, &asked);
    assert_eq!(report["shape"], serde_json::json!([9, 9, 9]));
    assert_eq!((report["step"].as_f64(), report["inside"].as_u64()), (Some(0.5), Some(27)));
    let bytes = fs::read(folder.path().join("grid.npy")).unwrap();
    let head = bytes.len() - 4 * 729;
    let text = String::from_utf8_lossy(&bytes[..head]);
    assert!(text.contains("'<f4'") && text.contains("'shape': (9, 9, 9)"), "{text}");
    let numbers: Vec<f32> =
        bytes[head..].as_chunks::<4>().0.iter().map(|x| f32::from_le_bytes(*x)).collect();
    for (number, &found) in numbers.iter().enumerate() {
        let at = [number / 81, number / 9 % 9, number % 9].map(|place| place as f64 * 0.5 - 1.0);
        let outside = at.map(|x| (-x).max(x - 2.0).max(0.0));
        let inside = at.map(|x| x.min(2.0 - x)).into_iter().fold(f64::INFINITY, f64::min);
        let length = outside.iter().map(|x| x * x).sum::<f64>().sqrt();
        let expected = if inside > 0.0 { -inside } else { length };
        assert!((f64::from(found) - expected).abs() < 1e-6, "{at:?}: {found} {expected}");
    }
    // Exactly: the same distances of the nearest triangles.
    let exact = json(&folder, &[&asked[..], &["--accuracy", "exact"]].concat());
    assert_eq!(
        (report["accuracy"].as_str(), exact["accuracy"].as_str()),
        (Some("f64"), Some("exact"))
    );
    assert_eq!(fs::read(folder.path().join("grid.npy")).unwrap(), bytes);
    // Unsigned, and not beyond a limit.
    succeed(&folder, &[&grid[..], &["--step", "1", "--max-distance", "0.5"]].concat());
    let numbers = floats(&folder, "grid.npy");
    assert!(numbers[32..].iter().all(|x| *x >= 0.0) && numbers.contains(&f32::INFINITY));
    fail(&folder, 2, &[&grid[..], &["--step", "0"]].concat());
    fail(&folder, 2, &[&grid[..], &["--step", "1e-9"]].concat());
    fail(&folder, 4, &[&grid[..], &["--steps", "200", "--max-memory", "100k"]].concat());
    // Distances of 68,921 points are 276 kB, and a slice of them with what is closest 2.9 MB more.
    let limited = [&grid[..], &["--steps", "40", "--margin", "0", "--max-memory", "1M"]].concat();
    fail(&folder, 4, &limited);
    succeed(
        &folder,
        &[&grid[..], &["--steps", "40", "--margin", "0", "--max-memory", "4M"]].concat(),
    );
}

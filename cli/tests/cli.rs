//! The program from outside: exit codes, reports, files.

use crate::common::{self, folder, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = common::program(folder);
    // Bytes of layouts depend on the width of vectors: the one that every processor has.
    command.env("SPLITPLANE_ISA", "portable");
    command.args(arguments);
    command
}

/// With one adapter, wgpu's `noop` one: it can be found and named, but it computes nothing.
fn program_with_adapter(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = program(folder, arguments);
    command.env("WGPU_BACKEND", "noop").env("WGPU_NOOP_BACKEND", "1");
    command
}

fn run(folder: &TempDir, arguments: &[&str]) -> Output {
    program(folder.path(), arguments).output().unwrap()
}

/// Runs, expects success, and gives standard output.
fn succeed(folder: &TempDir, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Runs, expects this exit code, and gives the one line that says why.
fn fail(folder: &TempDir, code: i32, arguments: &[&str]) -> String {
    fails(program(folder.path(), arguments), code, arguments)
}

fn fails(mut program: Command, code: i32, arguments: &[&str]) -> String {
    let output = program.output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked") && !error.contains("RUST_BACKTRACE"), "{error}");
    let lines: Vec<&str> = error.lines().filter(|line| line.starts_with("splitplane: ")).collect();
    assert_eq!(lines.len(), 1, "{arguments:?}: {error}");
    assert!(text(&output.stdout).is_empty() || code == 1);
    lines[0].to_owned()
}

fn json(folder: &TempDir, arguments: &[&str]) -> Value {
    let output = succeed(folder, arguments);
    assert_eq!(output.lines().count(), 1, "{output}");
    serde_json::from_str(&output).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn sorted<'a>(names: &[&'a str]) -> Vec<&'a str> {
    let mut names = names.to_vec();
    names.sort_unstable();
    names
}

const BUILD_FIELDS: [&str; 18] = [
    "scene",
    "triangles",
    "dropped",
    "snapped",
    "backend",
    "adapter",
    "preset",
    "config",
    "threads",
    "build_ms",
    "nodes",
    "leaves",
    "empty_leaves",
    "references",
    "max_depth",
    "sah_cost",
    "bytes",
    "digest",
];

/// Two triangles in the plane z = 0 that make a unit square, one with two equal corners, one with a
/// NaN.
const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv nan 0 0\nf 1 2 3 4\nf 1 1 2\nf 1 2 5\n";

fn square() -> TempDir {
    let folder = folder();
    fs::write(folder.path().join("square.obj"), SQUARE).unwrap();
    folder
}

/// Rays in the order of a file: straight down at x, y.
fn rays(points: &[[f32; 2]]) -> Vec<[f32; 8]> {
    points.iter().map(|&[x, y]| [x, y, 2.0, 0.0, 0.0, -1.0, 0.0, 9.0]).collect()
}

fn raw(rays: &[[f32; 8]]) -> Vec<u8> {
    rays.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
}

/// An .npy file of shape (n, 8), `kind` being `<f4` or `<f8`.
fn npy(kind: &str, count: usize, numbers: &[u8]) -> Vec<u8> {
    let mut head =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({count}, 8), }}");
    while (10 + head.len() + 1) % 64 != 0 {
        head.push(' ');
    }
    head.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head.bytes());
    bytes.extend(numbers);
    bytes
}

#[test]
fn help_says_what_there_is() {
    let folder = folder();
    // Defaults of the width of a terminal must not change the text.
    let help = program(folder.path(), &["--help"]).env("COLUMNS", "100").output().unwrap();
    assert_eq!(help.status.code(), Some(0));
    // The window is in builds with the feature `viewer` only.
    insta::with_settings!({filters => vec![(r"  view  [^\n]*\n", "")]}, {
        insta::assert_snapshot!("help", text(&help.stdout));
    });
    for verb in ["render", "build", "stats", "query", "verify"] {
        let help = succeed(&folder, &[verb, "--help"]);
        assert!(help.contains("--threads") && help.contains("--allow-structural"), "{verb}");
        assert!(help.contains("--bins") && help.contains("--traversal-cost"), "{verb}");
        // The summary leaves the knobs out.
        assert!(!succeed(&folder, &[verb, "-h"]).contains("--bins"), "{verb}");
    }
    assert!(succeed(&folder, &["adapters", "--help"]).contains("--json"));
    assert!(succeed(&folder, &["--version"]).starts_with("splitplane 0."));
}

#[test]
fn without_arguments_there_is_a_picture_and_a_report() {
    let folder = folder();
    let report = succeed(&folder, &["--size", "48x27"]);
    insta::with_settings!({filters => vec![
        (r"in [0-9.]+ ms", "in [time]"),
        (r"[0-9.]+ ms of it", "[time] of it"),
        (r"\([0-9.]+ million rays a second\)", "([speed])"),
        (r"\d+ threads?", "[threads]"),
        (r"digest [0-9a-f]{16}", "digest [digest]"),
        (r"tree     .*", "tree     [tree]"),
        (r"\d+ bytes", "[bytes]"),
        (r"\d+ rays in all; \d+ %", "[rays] in all; [part]"),
    ]}, { insta::assert_snapshot!("report", report); });
    let picture = image::open(folder.path().join("splitplane-city.png")).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (48, 27));
    let dark = picture.pixels().filter(|pixel| pixel.0.iter().all(|&part| part < 8)).count();
    assert!(dark < 48 * 27 / 20, "{dark} pixels are black");
    let files: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(files.len(), 1, "{files:?}");
}

/// What is measured or depends on the machine, out of a JSON report; the rest is pinned.
fn without_times(mut report: Value) -> String {
    for (name, value) in report.as_object_mut().unwrap() {
        if name.ends_with("_ms") || name == "mrays_per_s" || name == "threads" {
            assert!(value.is_number(), "{name}");
            *value = "[measured]".into();
        }
    }
    serde_json::to_string_pretty(&report).unwrap()
}

#[test]
fn reports_are_pinned() {
    let folder = folder();
    let rays: Vec<u8> = (0..64u32)
        .flat_map(|i| {
            let x = (i % 8) as f32 * 0.5 + 0.7;
            [x, (i / 8) as f32 * 0.6 + 0.3, 20.0, 0.0, 0.0, -1.0, 0.0, f32::INFINITY]
        })
        .flat_map(f32::to_le_bytes)
        .collect();
    fs::write(folder.path().join("grid.rays"), rays).unwrap();
    for (name, arguments) in [
        ("build-json", &["build", "builtin:cornell", "--json"][..]),
        (
            "stats-json",
            &["stats", "builtin:cornell", "--json", "--rays", "2000", "--block-width", "4"],
        ),
        ("query-json", &["query", "builtin:cornell", "--rays", "grid.rays", "--json"]),
        ("verify-json", &["verify", "builtin:cornell", "--rays", "200", "--json"]),
        ("render-json", &["render", "builtin:cornell", "--size", "16x16", "--json", "-o", "p.png"]),
    ] {
        insta::assert_snapshot!(name, without_times(json(&folder, arguments)));
    }
}

#[test]
fn pictures_of_equal_hits_are_equal_and_cameras_move() {
    let folder = folder();
    let picture = |name: &str, more: &[&str]| {
        let basic = ["render", "builtin:cornell", "--size", "40x40", "-q", "-o", name];
        assert_eq!(succeed(&folder, &[&basic[..], more].concat()), "");
        fs::read(folder.path().join(name)).unwrap()
    };
    let first = picture("a.png", &[]);
    assert_eq!(first, picture("b.png", &["--threads", "1"]));
    assert_ne!(first, picture("c.png", &["--camera-eye", "2.7,2.7,9", "--fov", "50"]));
    assert_ne!(first, picture("d.png", &["--camera-at=-1,2,0", "--camera-up", "1,1,0"]));
}

#[test]
fn render_reports_its_fields() {
    let folder = folder();
    let report = json(&folder, &["builtin:cornell", "--size", "20x10", "--json", "-o", "x.png"]);
    let own = [
        "width",
        "height",
        "samples",
        "lights",
        "lights_asked",
        "emitters",
        "paths",
        "photon_rays",
        "shadow_rays",
        "redone",
        "shading",
        "trace_ms",
        "render_ms",
        "output",
    ];
    let want = [&BUILD_FIELDS[..], &own].concat();
    assert_eq!(keys(&report), sorted(&want));
    assert_eq!((&report["width"], &report["height"]), (&20.into(), &10.into()));
    assert_eq!(report["output"], serde_json::json!(["x.png"]));
    assert!(report["render_ms"].as_f64().unwrap() >= report["trace_ms"].as_f64().unwrap());
    assert!(report["paths"].as_u64().unwrap() >= 4 * 200);
}

#[test]
fn build_reports_its_fields_and_writes_the_tree() {
    let folder = square();
    let report = json(&folder, &["build", "square.obj", "--json", "-o", "square.tree"]);
    assert_eq!(keys(&report), sorted(&BUILD_FIELDS));
    assert_eq!(report["scene"], "square.obj");
    assert_eq!((&report["triangles"], &report["dropped"]), (&4.into(), &2.into()));
    assert_eq!((&report["backend"], &report["adapter"]), (&"cpu".into(), &Value::Null));
    assert_eq!(report["digest"].as_str().unwrap().len(), 16);
    let bytes = fs::read(folder.path().join("square.tree")).unwrap();
    let file = splitplane::core::tree::file::TreeFile::parse(&bytes).unwrap();
    assert_eq!(file.tree.digest().to_string(), report["digest"].as_str().unwrap());
}

#[test]
fn knobs_shape_the_tree_and_are_reported() {
    let folder = folder();
    let build = |knobs: &[&str]| {
        json(&folder, &[&["build", "builtin:spheres", "--json", "-q"][..], knobs].concat())
    };
    let plain = build(&[]);
    let config = |report: &Value, field: &str| report["config"][field].clone();
    assert_eq!(config(&plain, "traversal_cost"), 1);
    assert_eq!(config(&plain, "clip"), true);
    assert_eq!(config(&plain, "bins"), Value::Null);
    for (knobs, field, value) in [
        (&["--traversal-cost", "3"][..], "traversal_cost", Value::from(3)),
        (&["--intersection-cost", "9"], "intersection_cost", 9.into()),
        (&["--block-width", "4"], "block_width", 4.into()),
        (&["--small-node-limit", "16"], "small_node_limit", 16.into()),
        (&["--empty-cutoff", "10"], "empty_cutoff", 26.into()),
        (&["--max-depth", "12"], "max_depth", 12.into()),
        (&["--no-clip"], "clip", false.into()),
        (&["--reference-cap", "2"], "references_per_triangle", 2.into()),
        (&["--node-cap", "2"], "nodes_per_triangle", 2.into()),
        (&["--preset", "balanced", "--bins", "8"], "bins", 8.into()),
    ] {
        let report = build(knobs);
        assert_eq!(config(&report, field), value, "{knobs:?}");
        assert_ne!(report["digest"], plain["digest"], "{knobs:?}");
    }
    let told =
        succeed(&folder, &["build", "builtin:spheres", "--no-clip", "--empty-cutoff", "10%"]);
    let line = "knobs    K_T 1, K_I 4, W 16, T 64, C_e 10.2 %, not clipped; at most 64 levels, \
                4 nodes, 8 references a triangle\n";
    assert!(told.contains(line), "{told}");
    // What a knob does, and not only that it is noted.
    assert!(build(&["--max-depth", "5"])["max_depth"].as_u64().unwrap() <= 5);
    let nodes = |report: Value| report["nodes"].as_u64().unwrap();
    assert!(nodes(build(&["--block-width", "1"])) > nodes(plain));
}

#[test]
fn knobs_that_a_preset_lacks_and_values_out_of_range_are_2_and_named() {
    let folder = folder();
    for (knobs, words) in [
        (&["--bins", "8"][..], "--bins is a knob of balanced only; preset fast does not have it"),
        (&["--preset", "balanced", "--empty-bonus", "5"], "--empty-bonus is a knob of best only"),
        (&["--preset", "best", "--small-node-limit", "5"], "of fast, narrow and balanced only"),
        (&["--preset", "best", "--node-cap", "5"], "of fast, narrow and balanced only"),
        (&["--bad-splits", "2"], "--bad-splits is a knob of best only"),
        (&["--traversal-cost", "0"], "--traversal-cost is 0, but must be from 1 to 1367"),
        (&["--small-node-limit", "65"], "--small-node-limit is 65, but must be from 1 to 64"),
        (&["--reference-cap", "0"], "--reference-cap is 0, but must be from 1 to 65536"),
        (&["--node-cap", "65537"], "--node-cap is 65537"),
        (&["--max-depth", "97"], "--max-depth is 97, but must be from 1 to 96"),
        (
            &["--empty-cutoff", "100"],
            "--empty-cutoff is 100 % (256/256), but must be from 0.4 % (1/256) to 99.6 % (255/256)",
        ),
        (&["--preset", "balanced", "--bins", "1"], "--bins is 1, but must be from 2 to 64"),
        (&["--intersection-cost", "400", "--block-width", "1"], "only the ratio of the two costs"),
    ] {
        for verb in [&["build", "missing.obj"][..], &["render", "missing.obj"], &["stats", "x.obj"]]
        {
            let why = fail(&folder, 2, &[verb, knobs].concat());
            assert!(why.contains(words), "{why}");
        }
    }
    for knobs in [["--empty-cutoff", "a lot"], ["--bins", "few"], ["--max-depth", "9999999999"]] {
        let output = run(&folder, &[&["build", "builtin:cornell"][..], &knobs].concat());
        assert_eq!(output.status.code(), Some(2), "{knobs:?}");
        assert!(text(&output.stderr).contains(knobs[0]), "{knobs:?}");
    }
}

#[test]
fn stats_are_told_in_columns() {
    let folder = folder();
    let fine = ["--block-width", "2", "--rays", "5000"];
    let told = succeed(&folder, &[&["stats", "builtin:spheres"][..], &fine].concat());
    insta::with_settings!({filters => vec![
        (r"in [0-9.]+ ms", "in [time]"),
        (r"\d+ threads?", "[threads]"),
    ]}, { insta::assert_snapshot!("stats", told); });
    let flat = "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n";
    fs::write(folder.path().join("line.obj"), flat).unwrap();
    let told = succeed(&folder, &["stats", "line.obj"]);
    assert!(told.contains("No line meets the bounds"), "{told}");
    assert_eq!(succeed(&folder, &["stats", "builtin:cornell", "--quiet", "--rays", "10"]), "");
}

/// What is expected is what is measured, and the figures fit one another.
#[test]
fn stats_agree_with_the_build_and_with_themselves() {
    let folder = folder();
    let scene = ["builtin:spheres", "--json", "-q"];
    let build = json(&folder, &[&["build"][..], &scene].concat());
    let stats = |more: &[&str]| json(&folder, &[&["stats"][..], &scene, more].concat());
    let one = stats(&["--rays", "3000", "--threads", "1"]);
    for field in BUILD_FIELDS.iter().filter(|field| !["build_ms", "threads"].contains(field)) {
        assert_eq!(one[field], build[field], "{field}");
    }
    let three = stats(&["--rays", "3000", "--threads", "3"]);
    for field in ["expected", "passing", "closest", "leaves_by_depth", "leaf_sizes"] {
        assert_eq!(one[field], three[field], "{field}");
    }
    let number = |value: &Value| value.as_f64().unwrap();
    for name in ["interior", "leaves", "empty_leaves", "tests", "blocks"] {
        let [mean, error] =
            ["mean", "standard_error"].map(|part| number(&one["passing"][part][name]));
        let expected = number(&one["expected"][name]);
        assert!((mean - expected).abs() < 5.0 * error, "{name}: {mean} {expected} {error}");
        assert!(number(&one["closest"]["mean"][name]) <= mean, "{name}");
    }
    let sum = |counts: Vec<&Value>| counts.into_iter().map(|n| n.as_u64().unwrap()).sum::<u64>();
    let by_depth = one["leaves_by_depth"].as_array().unwrap().iter().collect();
    let sizes = one["leaf_sizes"].as_array().unwrap();
    assert_eq!(sum(by_depth), one["leaves"].as_u64().unwrap());
    assert_eq!(sum(sizes.iter().map(|class| &class["leaves"]).collect()), one["leaves"]);
    assert_eq!(one["interior"].as_u64().unwrap() + 1, one["leaves"].as_u64().unwrap());
}

#[test]
fn the_tree_does_not_depend_on_threads() {
    let folder = folder();
    let build =
        |threads| json(&folder, &["build", "builtin:city:20000", "--json", "--threads", threads]);
    let (one, three) = (build("1"), build("3"));
    assert_eq!((&one["threads"], &three["threads"]), (&1.into(), &3.into()));
    assert_eq!(one["digest"], three["digest"]);
}

#[test]
fn what_was_left_out_is_said_on_standard_error_only() {
    let folder = square();
    let output = run(&folder, &["build", "square.obj", "--json"]);
    let notes = text(&output.stderr);
    assert!(
        notes.contains("1 vertices are not finite") && notes.contains("2 triangles left out"),
        "{notes}"
    );
    assert!(notes.contains("auto: the CPU, since no GPU adapter was found"), "{notes}");
    let quiet = run(&folder, &["build", "square.obj", "--json", "--quiet"]);
    assert_eq!(text(&quiet.stderr), "");
    assert_eq!(text(&quiet.stdout).lines().count(), 1);
}

#[test]
fn raw_rays_give_raw_hits() {
    let folder = square();
    let rays = rays(&[[0.5, 0.25], [0.25, 0.5], [3.0, 3.0]]);
    fs::write(folder.path().join("in.bin"), raw(&rays)).unwrap();
    let query = ["query", "square.obj", "--rays", "in.bin", "--json", "--repeat", "3"];
    let report = json(&folder, &[&query[..], &["--hits", "out.bin"]].concat());
    let want = [
        "rays",
        "hits",
        "kind",
        "accuracy",
        "build_ms",
        "trace_ms",
        "mrays_per_s",
        "undecided",
        "undecided_share",
        "flagged",
        "answered_by_cpu",
        "digest",
    ];
    assert_eq!(keys(&report), sorted(&want));
    assert_eq!((&report["rays"], &report["hits"]), (&3.into(), &2.into()));
    assert_eq!((&report["kind"], &report["accuracy"]), (&"closest".into(), &"watertight".into()));
    let bytes = fs::read(folder.path().join("out.bin")).unwrap();
    let records: Vec<[[u8; 4]; 4]> = bytes
        .as_chunks::<16>()
        .0
        .iter()
        .map(|r| std::array::from_fn(|i| r.as_chunks::<4>().0[i]))
        .collect();
    assert_eq!(records.len(), 3);
    let t = records.iter().map(|r| f32::from_le_bytes(r[0])).collect::<Vec<_>>();
    let triangle = records.iter().map(|r| u32::from_le_bytes(r[1])).collect::<Vec<_>>();
    assert_eq!((t, triangle), (vec![2.0, 2.0, f32::INFINITY], vec![0, 1, u32::MAX]));
    // The point (0.5, 0.25) is half of the first corner, a quarter of the second and the third.
    let weights = [f32::from_le_bytes(records[0][2]), f32::from_le_bytes(records[0][3])];
    assert!((weights[0] - 0.25).abs() < 1e-6 && (weights[1] - 0.25).abs() < 1e-6, "{weights:?}");
}

#[test]
fn numpy_rays_of_both_widths_give_the_same_numpy_hits() {
    let folder = square();
    let rays = rays(&[[0.5, 0.25], [3.0, 3.0]]);
    let wide: Vec<u8> = rays.iter().flatten().flat_map(|&x| f64::from(x).to_le_bytes()).collect();
    fs::write(folder.path().join("raw.bin"), raw(&rays)).unwrap();
    fs::write(folder.path().join("narrow.npy"), npy("<f4", 2, &raw(&rays))).unwrap();
    fs::write(folder.path().join("wide.npy"), npy("<f8", 2, &wide)).unwrap();
    let hits = |input: &str, kind: &str| {
        let query =
            ["query", "square.obj", "-q", "--rays", input, "--kind", kind, "--hits", "out.npy"];
        succeed(&folder, &query);
        fs::read(folder.path().join("out.npy")).unwrap()
    };
    let closest = hits("narrow.npy", "closest");
    assert_eq!(closest, hits("wide.npy", "closest"));
    assert_eq!(closest, hits("raw.bin", "closest"));
    assert!(closest.starts_with(b"\x93NUMPY\x01\x00"));
    let head = String::from_utf8_lossy(&closest[10..closest.len() - 32]).into_owned();
    let kind = "[('t', '<f4'), ('triangle', '<u4'), ('u', '<f4'), ('v', '<f4')]";
    assert!(head.contains(kind) && head.contains("(2,)"), "{head}");
    let any = hits("narrow.npy", "any");
    assert!(String::from_utf8_lossy(&any).contains("'|u1'"));
    assert_eq!(any[any.len() - 2..], [1, 0]);
}

#[test]
fn verify_passes_what_is_right_and_fails_what_leaks() {
    let folder = folder();
    let check = ["verify", "builtin:spheres", "--rays", "2000"];
    let report = json(&folder, &[&check[..], &["--json"]].concat());
    assert_eq!(keys(&report), sorted(&["rays", "mismatches", "misses", "phantoms", "unexplained"]));
    assert_eq!((&report["rays"], &report["unexplained"]), (&6000.into(), &0.into()));
    let why = fail(&folder, 1, &[&check[..], &["--accuracy", "fast"]].concat());
    assert!(why.contains("answers are wrong"), "{why}");
}

#[test]
fn wrong_usage_is_2() {
    let folder = folder();
    for arguments in [
        &["--nonsense"][..],
        &["build"],
        &["query", "builtin:cornell"],
        &["render", "builtin:cornell", "--size", "0x5"],
        &["render", "builtin:cornell", "--size", "99999x99999"],
        &["build", "builtin:cornell", "--threads", "0"],
        &["build", "builtin:cornell", "--max-memory", "lots"],
        &["build", "builtin:cornell", "--backend", "abacus"],
        &["build", "builtin:cornell", "--preset", "slow"],
        &["verify", "builtin:cornell", "--rays", "0"],
        &["stats", "builtin:cornell", "--rays", "0"],
    ] {
        let output = run(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", text(&output.stderr));
        assert!(output.stdout.is_empty());
    }
    for arguments in [
        &["build", "builtin:village"][..],
        &["build", "scene.txt"],
        &["frobnicate"],
        &["build", "builtin:city:5"],
        &["build", "builtin:cornell", "--backend", "cpu", "--adapter", "0"],
        &["render", "builtin:cornell", "-o", "x.jpg"],
        &["render", "builtin:cornell", "--fov", "200"],
        &["render", "builtin:cornell", "--camera-eye", "1,1,1", "--camera-at", "1,1,1"],
    ] {
        fail(&folder, 2, arguments);
    }
}

#[test]
fn bad_files_are_3() {
    let folder = square();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    write("empty.obj", b"");
    write("binary.obj", b"v 0 0 0\xff\xfe");
    write("zero.obj", b"v 0 0 0\nf 0 0 0\n");
    write("short.obj", b"v 0 0 0\nf 1 2 3\n");
    write("past.obj", b"f -1 -2 -3\n");
    write("huge.obj", b"v 0 0 0\nf 1 1 99999999999999999999999\n");
    fs::create_dir(folder.path().join("folder.obj")).unwrap();
    for (scene, words) in [
        ("empty.obj", "no faces"),
        ("binary.obj", "not UTF-8"),
        ("zero.obj", "line 2: a face names vertex 0"),
        ("short.obj", "line 2: a face names vertex 2, but the file has 1"),
        ("past.obj", "line 1: a face names vertex -1"),
        ("huge.obj", "line 2: `99999"),
        ("folder.obj", "is a folder"),
        ("missing.obj", "no such file"),
    ] {
        let why = fail(&folder, 3, &["build", scene]);
        assert!(why.contains(scene) && why.contains(words), "{why}");
    }
    write("odd.bin", &[0; 33]);
    write("cut.npy", &npy("<f4", 2, &[0; 32]));
    write("big-endian.npy", &npy(">f4", 1, &[0; 32]));
    write("no.npy", b"hello");
    for (rays, words) in [
        ("odd.bin", "33 bytes, which is not a multiple of 32"),
        ("cut.npy", "promises 64 bytes of numbers, but 32 follow"),
        ("big-endian.npy", "`>f4`"),
        ("no.npy", "does not start as an .npy file"),
        ("missing.bin", "cannot read the rays"),
    ] {
        let why = fail(&folder, 3, &["query", "square.obj", "--rays", rays]);
        assert!(why.contains(rays) && why.contains(words), "{why}");
    }
    let why = fail(&folder, 3, &["builtin:cornell", "--size", "8x8", "-o", "no/such/folder/x.png"]);
    assert!(why.contains("cannot write"), "{why}");
}

#[test]
fn a_limit_that_binds_is_4() {
    let folder = folder();
    let why = fail(&folder, 4, &["build", "builtin:city:20000", "--max-memory", "1k"]);
    assert!(why.contains("more than the limit of 1024"), "{why}");
}

#[test]
fn a_gpu_that_is_not_there_is_5_and_never_the_cpu() {
    let folder = folder();
    let scene = ["render", "builtin:cornell", "--backend"];
    for backend in [&["wgpu"][..], &["wgpu", "--adapter", "0"], &["auto", "--adapter", "radeon"]] {
        let why = fail(&folder, 5, &[&scene[..], backend].concat());
        assert_eq!(
            why,
            "splitplane: no GPU adapter was found (the environment has WGPU_BACKEND=vulkan); use \
             the backend `cpu`, or `auto` to take what there is"
        );
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_wrong_adapter_is_5_and_those_there_are_are_listed() {
    let folder = folder();
    for backend in ["wgpu", "auto"] {
        let build = ["build", "builtin:cornell", "--backend", backend];
        for wrong in ["abacus", "1"] {
            let named = [&build[..], &["--adapter", wrong]].concat();
            let mut found = vec![fails(program_with_adapter(folder.path(), &named), 5, &named)];
            if backend == "wgpu" {
                let mut by_environment = program_with_adapter(folder.path(), &build);
                by_environment.env("WGPU_ADAPTER_NAME", wrong);
                found.push(fails(by_environment, 5, &build));
            }
            for why in found {
                assert_eq!(
                    why,
                    format!(
                        "splitplane: no GPU adapter is called `{wrong}`; there are 0 `noop wgpu \
                         backend`"
                    )
                );
            }
        }
    }
}

#[test]
fn auto_passes_over_a_name_in_the_environment_that_no_adapter_has() {
    let folder = folder();
    let arguments = ["build", "builtin:cornell", "--json"];
    let mut program = program_with_adapter(folder.path(), &arguments);
    let output = program.env("WGPU_ADAPTER_NAME", "abacus").output().unwrap();
    let notes = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{notes}");
    let why = "auto: the CPU, since no GPU adapter is called `abacus` (WGPU_ADAPTER_NAME); `noop \
               wgpu backend` is software";
    assert!(notes.contains(why), "{notes}");
}

#[test]
fn parity_needs_a_gpu() {
    let folder = folder();
    let parity = ["parity", "builtin:cornell"];
    for more in [&[][..], &["--backend", "wgpu"], &["--adapter", "0"], &["--json"]] {
        let why = fail(&folder, 5, &[&parity[..], more].concat());
        assert!(why.starts_with("splitplane: no GPU adapter was found"), "{why}");
        assert!(why.contains("WGPU_BACKEND=vulkan"), "{why}");
    }
    let wrong = ["parity", "builtin:cornell", "--adapter", "abacus"];
    let why = fails(program_with_adapter(folder.path(), &wrong), 5, &wrong);
    assert!(why.contains("no GPU adapter is called `abacus`"), "{why}");
}

#[test]
fn parity_with_the_cpu_or_without_a_scene_is_wrong_usage() {
    let folder = folder();
    let why = fail(&folder, 2, &["parity", "builtin:cornell", "--preset", "best"]);
    assert!(why.contains("preset best is built on the CPU only"), "{why}");
    let why = fail(&folder, 2, &["parity", "builtin:cornell", "--backend", "cpu"]);
    assert!(why.contains("leave --backend cpu out"), "{why}");
    assert_eq!(run(&folder, &["parity"]).status.code(), Some(2));
    assert_eq!(run(&folder, &["parity", "x.obj", "--rays", "-1"]).status.code(), Some(2));
}

#[test]
fn auto_does_not_take_a_software_adapter() {
    let folder = folder();
    let arguments = ["build", "builtin:cornell", "--json"];
    let output = program_with_adapter(folder.path(), &arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let notes = text(&output.stderr);
    assert!(notes.contains("auto: the CPU, since `noop wgpu backend` is software"), "{notes}");
    let report: Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    assert_eq!(report["backend"], "cpu");
}

#[test]
fn adapters_are_listed_and_none_is_no_failure() {
    let folder = folder();
    assert_eq!(succeed(&folder, &["adapters"]), "no GPU adapter was found\n");
    assert_eq!(json(&folder, &["adapters", "--json"]), serde_json::json!({ "adapters": [] }));
    let list = |arguments: &[&str]| {
        let output = program_with_adapter(folder.path(), arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(0));
        text(&output.stdout)
    };
    let listed = list(&["adapters"]);
    assert!(listed.starts_with("0  noop wgpu backend (noop, software; "), "{listed}");
    let listed: Value = serde_json::from_str(&list(&["adapters", "--json"])).unwrap();
    let adapter = &listed["adapters"].as_array().unwrap()[0];
    let want = [
        "index",
        "name",
        "backend",
        "device_type",
        "driver",
        "driver_info",
        "max_storage_buffer_binding_size",
        "max_buffer_size",
        "max_storage_buffers_per_shader_stage",
        "max_compute_invocations_per_workgroup",
        "max_compute_workgroup_storage_size",
        "timestamps",
        "parity",
        "difference",
        "unusable",
    ];
    assert_eq!(keys(adapter), sorted(&want));
    // It computes nothing, so it cannot be equal to the CPU.
    assert_ne!(adapter["parity"], "bitwise");
}

/// Without a desktop a layer of Mesa's complains whenever Vulkan is opened. The program starts itself anew without it, with the same
/// arguments, input and output.
#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "Mesa's layer is on Linux")]
fn mesa_does_not_complain_that_there_is_no_desktop() {
    let folder = square();
    for runtime in [None, Some(""), Some("relative")] {
        for arguments in
            [&["adapters"][..], &["build", "square.obj", "--json"], &["build", "no such.obj"]]
        {
            // The machine's own drivers.
            let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
            command.current_dir(folder.path()).args(arguments);
            command.env_remove("XDG_RUNTIME_DIR").env_remove("NODEVICE_SELECT");
            if let Some(runtime) = runtime {
                command.env("XDG_RUNTIME_DIR", runtime);
            }
            let output = command.output().unwrap();
            let notes = text(&output.stderr);
            assert!(!notes.contains("XDG_RUNTIME_DIR"), "{arguments:?}: {notes}");
            let missing = arguments.contains(&"no such.obj");
            assert_eq!(output.status.code(), Some(if missing { 3 } else { 0 }), "{notes}");
            assert_eq!(
                (output.stdout.is_empty(), notes.contains("no such.obj")),
                (missing, missing)
            );
        }
    }
}

/// The adapter that computes nothing, with a driver that may take no time: the second process says so, and the
/// device is not opened in this one.
#[test]
fn a_driver_that_takes_too_long_is_passed_over() {
    let folder = square();
    let limited = |arguments: &[&str], seconds: &str| {
        let mut command = program_with_adapter(folder.path(), arguments);
        command.env("SPLITPLANE_DRIVER_SECONDS", seconds);
        command
    };
    let what = "did not finish opening a device within 0 seconds";
    for verb in [
        &["build", "square.obj", "--backend", "wgpu"][..],
        &["render", "square.obj", "-o", "out.png", "--size", "8x8", "--backend", "wgpu"],
        &["parity", "square.obj"],
        &["paper", "--quick", "--backend", "wgpu", "--out", "paper"],
        &["trade", "square.obj", "--quick", "--backend", "wgpu", "--out", "trade"],
    ] {
        let error = fails(limited(verb, "0"), 6, verb);
        assert!(error.contains("`noop wgpu backend` (wgpu)") && error.contains(what), "{error}");
    }
    let listed = limited(&["adapters"], "0").output().unwrap();
    assert_eq!(listed.status.code(), Some(0));
    let listed = text(&listed.stdout);
    assert!(listed.contains(&format!("cannot be used: its driver {what}")), "{listed}");
    // `auto` opens no software, so it asks nothing of it.
    let built = limited(&["build", "square.obj", "--json"], "0").output().unwrap();
    assert_eq!(built.status.code(), Some(0), "{}", text(&built.stderr));
    // With time it is tried, and refused for what it computes.
    let error = fails(limited(&["build", "square.obj", "--backend", "wgpu"], "60"), 5, &["60"]);
    assert!(error.contains("`noop wgpu backend`") && !error.contains("within"), "{error}");
    let error = fails(limited(&["build", "square.obj"], "soon"), 2, &["soon"]);
    assert!(error.contains("SPLITPLANE_DRIVER_SECONDS must be a whole number"), "{error}");
}

#[test]
fn the_second_process_answers_no_one_else() {
    let folder = folder();
    assert!(fail(&folder, 2, &["__probe", "card"]).contains("only a probe"));
    assert!(!succeed(&folder, &["--help"]).contains("__probe"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_is_7_and_leaves_no_file() {
    let folder = folder();
    let arguments = ["render", "builtin:city:1000000", "--size", "4096x4096", "-o", "x.png"];
    let mut child = program(folder.path(), &arguments)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // The first line on standard error comes after the handler is in place.
    let mut line = String::new();
    let mut errors = std::io::BufReader::new(child.stderr.take().unwrap());
    std::io::BufRead::read_line(&mut errors, &mut line).unwrap();
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(7));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let folder = folder();
    let mut child = program(folder.path(), &["build", "builtin:cornell", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(!text(&output.stderr).contains("splitplane: "), "{}", text(&output.stderr));
}

/// Runs, expects code 7, and gives the one line that says why.
fn ends(folder: &TempDir, arguments: &[&str]) -> String {
    let error = fail(folder, 7, arguments);
    assert!(error.contains("the time limit of"), "{arguments:?}: {error}");
    error
}

/// Names of the files in a folder.
fn files(folder: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(folder.path()).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_run_that_is_out_of_time_says_where_it_was_and_leaves_nothing() {
    let folder = square();
    let ray = raw(&rays(&[[0.5, 0.25]]));
    fs::write(folder.path().join("rays.bin"), ray).unwrap();
    let before = files(&folder);
    for verb in [
        &["build", "square.obj", "-o", "tree.bin"][..],
        &["query", "square.obj", "--rays", "rays.bin", "--hits", "hits.npy"],
        &["verify", "square.obj", "--rays", "10"],
        &["stats", "square.obj"],
        &["render", "square.obj", "-o", "out.png", "--size", "8x8"],
        &["animate", "--frames", "builtin:carousel:1000", "--out", "frames", "--count", "1"],
        &["adapters"],
        &["paper", "--quick", "--out", "paper"],
        &["parity", "square.obj"],
        &["trade", "square.obj", "--quick", "--out", "trade"],
    ] {
        let arguments = [verb, &["--timeout", "0"]].concat();
        assert!(ends(&folder, &arguments).contains("limit of 0 seconds"), "{verb:?}");
        assert_eq!(files(&folder), before, "{verb:?}");
    }
    // In the middle: the stage and how far it was. However slow the machine, at some limit it is there.
    let checks = ["verify", "builtin:cornell", "--rays", "1000000000", "--backend", "cpu"];
    let told = ["1", "4", "16", "64"].iter().any(|limit| {
        let error = ends(&folder, &[&checks[..], &["--timeout", limit]].concat());
        error.contains(" of 3000000000 done") && error.contains("seconds more")
    });
    assert!(told);
    assert_eq!(files(&folder), before);
    // With time enough all is as ever.
    let answer = ["query", "square.obj", "--rays", "rays.bin", "--hits", "hits.npy"];
    succeed(&folder, &[&answer[..], &["--timeout", "600"]].concat());
    assert!(files(&folder).contains(&"hits.npy".to_owned()));
    for bad in ["-1", "NaN", "1e300", "soon"] {
        let output = run(&folder, &["build", "square.obj", &format!("--timeout={bad}")]);
        assert_eq!(output.status.code(), Some(2), "{bad}");
    }
}

#[cfg(unix)]
fn interrupt(running: &std::process::Child) {
    let id = running.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
}

/// Ctrl-C in the middle of work that is watched, and of work that is not. Neither can be done before it comes,
/// and that the run is at work shows by its opening a pipe.
#[cfg(unix)]
#[test]
fn an_interrupted_run_ends_with_code_7_and_leaves_nothing() {
    use std::io::Write;
    let folder = square();
    let pipe = folder.path().join("pipe.bin");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let before = files(&folder);
    let rays = raw(&rays(&vec![[0.5, 0.25]; 100_000]));
    let query = ["--rays", "pipe.bin", "--hits", "hits.npy"];
    for (more, whole) in [
        // The rays never end.
        (&["query", "square.obj"][..], false),
        // They do; building and tracing take far longer than the interrupt.
        (&["query", "builtin:city:3000000", "--preset", "best"], true),
        (&["query", "square.obj", "--repeat", "10000", "--accuracy", "exact"], true),
    ] {
        let arguments = &[more, &query].concat();
        let mut running = program(folder.path(), arguments);
        running.args(["--backend", "cpu"]).stdout(Stdio::piped()).stderr(Stdio::piped());
        let running = running.spawn().unwrap();
        // Waits until the run opens it to read.
        let mut writer = fs::OpenOptions::new().write(true).open(&pipe).unwrap();
        writer.write_all(&rays).unwrap();
        let open = if whole { None } else { Some(writer) };
        interrupt(&running);
        let output = running.wait_with_output().unwrap();
        drop(open);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(7), "{arguments:?}: {error}");
        assert!(error.contains("splitplane: cancelled"), "{error}");
        assert_eq!(files(&folder), before, "{arguments:?}");
    }
}

/// A run that cannot print any more is ended with code 7, and says that its file is whole.
#[cfg(target_os = "linux")]
#[test]
fn what_is_whole_is_told_of_a_run_that_ends_behind_it() {
    use std::io::{Read, Write};
    let folder = square();
    let (mut reader, mut writer) = std::io::pipe().unwrap();
    // As much as a pipe takes.
    writer.write_all(&[b'x'; 1 << 16]).unwrap();
    let build = ["build", "square.obj", "-o", "tree.bin", "--backend", "cpu"];
    // Keeps no copy of the pipe here.
    let running =
        program(folder.path(), &build).stdout(writer).stderr(Stdio::piped()).spawn().unwrap();
    while !folder.path().join("tree.bin").exists() {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    interrupt(&running);
    let output = running.wait_with_output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(7), "{error}");
    assert!(error.contains("; 1 file is written and whole"), "{error}");
    assert_eq!(files(&folder), ["square.obj", "tree.bin"]);
    let mut printed = Vec::new();
    reader.read_to_end(&mut printed).unwrap();
    assert_eq!(printed.len(), 1 << 16);
}

#[test]
fn all_crossings_and_points_inside() {
    let folder = folder();
    // A closed tetrahedron.
    let text = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    fs::write(folder.path().join("closed.obj"), text).unwrap();
    // Through it, beside it, and straight through a vertex into it.
    let lines = [
        [0.5, 0.5, -1.0, 0.0, 0.0, 1.0, 0.0, 9.0],
        [9.0, 9.0, -1.0, 0.0, 0.0, 1.0, 0.0, 9.0],
        [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 0.0, 9.0],
    ];
    fs::write(folder.path().join("rays.bin"), raw(&lines)).unwrap();
    let query = ["query", "closed.obj", "--json", "--rays", "rays.bin", "--kind", "all"];
    let report = json(&folder, &[&query[..], &["--hits", "all.bin"]].concat());
    assert_eq!((report["rays"].as_u64(), report["hits"].as_u64()), (Some(3), Some(4)));
    assert_eq!(report["accuracy"], "exact");
    let starts = fs::read(folder.path().join("all.starts.bin")).unwrap();
    let starts: Vec<u64> =
        starts.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
    assert_eq!(starts, [0, 2, 2, 4]);
    let records = fs::read(folder.path().join("all.bin")).unwrap();
    assert_eq!(records.len(), 4 * 20);
    let words: Vec<u32> =
        records.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
    let t = |record: usize| f32::from_bits(words[5 * record]);
    assert_eq!([t(0), t(1), t(2)], [1.0, 4.0, 1.0]);
    assert_eq!([words[1], words[6]], [0, 3]);
    assert_eq!([words[4], words[9], words[14], words[19]], [1, 0, 1, 0]);
    let error = fail(&folder, 4, &[&query[..], &["--max-memory", "60"]].concat());
    assert!(error.contains("60"), "{error}");

    let points: Vec<u8> = [[1.0f32, 1.0, 1.0], [3.0, 3.0, 3.0], [0.0, 1.0, 2.0], [4.0, 0.0, 0.0]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    fs::write(folder.path().join("points.bin"), &points).unwrap();
    let query = ["query", "closed.obj", "--points", "points.bin", "--kind", "inside"];
    let answer = succeed(&folder, &[&query[..], &["--hits", "inside.bin"]].concat());
    assert!(answer.contains("4 points") && answer.contains("1 inside"), "{answer}");
    assert_eq!(fs::read(folder.path().join("inside.bin")).unwrap(), [1, 0, 2, 2]);
    fail(&folder, 2, &["query", "closed.obj", "--rays", "rays.bin", "--kind", "inside"]);
    fail(&folder, 2, &["query", "closed.obj", "--points", "points.bin"]);
    // The same points: in it, beside it, and on it.
    let query = ["query", "closed.obj", "--points", "points.bin", "--kind", "closest-point"];
    let answer = succeed(&folder, &[&query[..], &["--signed", "--hits", "near.bin"]].concat());
    assert!(answer.contains("4 points") && answer.contains("4 with a closest point"), "{answer}");
    let records = fs::read(folder.path().join("near.bin")).unwrap();
    let words = records.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
    let words: Vec<u32> = words.collect();
    assert_eq!(words.len(), 4 * 7);
    let record = |point: usize| {
        let row = &words[7 * point..][..7];
        (f32::from_bits(row[0]), row[1], [4, 5, 6].map(|at: usize| f32::from_bits(row[at])))
    };
    let third = 1.0 / 3.0f32.sqrt();
    assert_eq!((record(0).0, record(0).1), (-third, 3));
    assert!((record(1).0 - 5.0 * third).abs() < 1e-6 && record(1).1 == 3, "{:?}", record(1));
    assert_eq!([record(2), record(3)], [(0.0, 2, [0.0, 1.0, 2.0]), (0.0, 0, [4.0, 0.0, 0.0])]);
    let near = [&query[..], &["--max-distance", "1", "--json"]].concat();
    let report = json(&folder, &near);
    assert_eq!(
        (report["hits"].as_u64(), report["kind"].as_str()),
        (Some(3), Some("closest-point"))
    );
    assert_eq!(report["accuracy"].as_str(), Some("f64"));
    // The nearest triangle of real arithmetic: of those that are as near the lowest.
    let exact = [&query[..], &["--signed", "--accuracy", "exact", "--json", "--hits", "exact.bin"]]
        .concat();
    assert_eq!(json(&folder, &exact)["accuracy"].as_str(), Some("exact"));
    let records = fs::read(folder.path().join("exact.bin")).unwrap();
    let triangles = records.as_chunks::<28>().0.iter().map(|record| record[4]);
    assert_eq!(triangles.collect::<Vec<u8>>(), [3, 3, 2, 0]);
    // A point inside is near nothing: there is no distance to be negative.
    let none = [&query[..], &["--max-distance", "0.1", "--signed", "--hits", "none.bin"]].concat();
    succeed(&folder, &none);
    let records = fs::read(folder.path().join("none.bin")).unwrap();
    assert_eq!(f32::from_le_bytes([records[0], records[1], records[2], records[3]]), f32::INFINITY);
    for bad in ["--max-distance=-1", "--max-distance=nan", "--max-distance=near"] {
        let output = program(folder.path(), &[&query[..], &[bad]].concat()).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{bad}: {error}");
        assert!(error.contains("--max-distance <DISTANCE>"), "{error}");
    }
    fail(&folder, 2, &["query", "closed.obj", "--rays", "rays.bin", "--signed"]);
    fail(&folder, 2, &["query", "closed.obj", "--rays", "rays.bin", "--kind", "closest-point"]);
    fs::write(folder.path().join("odd.bin"), &points[..20]).unwrap();
    let odd = ["query", "closed.obj", "--points", "odd.bin", "--kind", "inside"];
    assert!(fail(&folder, 3, &odd).contains("not a multiple of 12"));
}

/// The preset that `auto` took, by the line that says so, and why.
fn chosen(folder: &TempDir, arguments: &[&str]) -> (String, String) {
    let output = run(folder, arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {error}");
    let lines: Vec<&str> = error.lines().filter(|line| line.starts_with("preset: ")).collect();
    assert_eq!(lines.len(), 1, "{arguments:?}: {error}");
    let (preset, reason) = lines[0]["preset: ".len()..].split_once(" (").unwrap();
    (preset.to_owned(), reason.strip_suffix(')').unwrap().to_owned())
}

/// Few rays take the fastest build and many another; trees and pictures are those of the preset that is named.
#[test]
fn auto_chooses_a_preset_and_says_why() {
    let folder = folder();
    let build = ["build", "builtin:city:20000", "--threads", "1", "--preset"];
    let auto = |rays| [&build[..], &["auto", "--rays", rays]].concat();
    let (few, reason) = chosen(&folder, &auto("0"));
    assert_eq!(few, "fast");
    let set = match () {
        () if cfg!(target_arch = "x86_64") => "sse2",
        () if cfg!(target_arch = "aarch64") => "neon",
        () => "portable",
    };
    let starts = &*format!("auto: with {set} on 1 thread, a build over ");
    assert!(reason.starts_with(starts), "{reason}");
    assert!(reason.contains(" triangles and 0 rays are expected to take "), "{reason}");
    let (many, reason) = chosen(&folder, &auto("18446744073709551615"));
    assert_ne!(many, "fast");
    for preset in ["fast", "narrow", "balanced", "best"] {
        assert!(reason.contains(&format!(" by {preset}")), "{reason}");
    }
    for (preset, rays) in [(&few, "0"), (&many, "18446744073709551615")] {
        let own = json(&folder, &[&auto(rays)[..], &["--json"]].concat());
        let named = json(&folder, &[&build[..], &[preset, "--json"]].concat());
        assert_eq!(own["preset"], preset.as_str());
        assert_eq!((&own["digest"], &own["config"]), (&named["digest"], &named["config"]));
        assert!(own["preset_reason"].as_str().unwrap().starts_with(starts));
        assert_eq!(keys(&named), sorted(&BUILD_FIELDS), "only where it was chosen");
    }
    // A frame announces its own rays: pixels, samples, and one light.
    let picture =
        ["render", "builtin:cornell", "--size", "40x30", "--samples", "2", "--lights", "1"];
    let file = |name: &str| fs::read(folder.path().join(name)).unwrap();
    let (preset, reason) =
        chosen(&folder, &[&picture[..], &["--preset", "auto", "-o", "auto.png"]].concat());
    assert!(reason.contains(" triangles and "), "{reason}");
    succeed(&folder, &[&picture[..], &["--preset", &preset, "-o", "named.png"]].concat());
    assert_eq!(file("auto.png"), file("named.png"));
    // So do the rays of a file, each as often as it is traced.
    fs::write(folder.path().join("rays.bin"), raw(&rays(&[[0.1, 0.1]; 7]))).unwrap();
    let query = ["query", "builtin:cornell", "--rays", "rays.bin", "--repeat", "3"];
    let (_, reason) = chosen(&folder, &[&query[..], &["--preset", "auto"]].concat());
    assert!(reason.contains(" and 21 rays "), "{reason}");
    let quiet = run(&folder, &[&auto("5")[..], &["--quiet"]].concat());
    assert!(quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
}

#[test]
fn auto_without_what_it_chooses_by_is_2() {
    let folder = folder();
    fs::write(folder.path().join("points.bin"), [0; 12]).unwrap();
    let points = ["query", "builtin:cornell", "--points", "points.bin", "--kind", "inside"];
    for (arguments, words) in [
        (&["build", "missing.obj"][..], "give --rays N"),
        (&["build", "missing.obj", "--rays", "5", "--bins", "8"], "name one to change its knobs"),
        (&["build", "missing.obj", "--rays", "5", "--no-clip"], "name one to change its knobs"),
        (&["build", "missing.obj", "--rays", "5", "--backend", "wgpu"], "of the CPU"),
        (&["build", "builtin:forest:3", "--rays", "5"], "through one mesh"),
        (&["render", "builtin:forest:3"], "through one mesh"),
        (&["distances", "missing.obj", "--out", "d.npy"], "not for distances"),
        (&["parity", "missing.obj"], "name a preset"),
        (&points, "not for points"),
    ] {
        let why = fail(&folder, 2, &[arguments, &["--preset", "auto"]].concat());
        assert!(why.contains(words), "{arguments:?}: {why}");
    }
    let why = fail(&folder, 2, &["build", "missing.obj", "--rays", "5"]);
    assert!(why.contains("leave it out"), "{why}");
    for rays in ["-1", "many", "18446744073709551616"] {
        let output = run(&folder, &["build", "a.obj", "--preset", "auto", "--rays", rays]);
        assert_eq!(output.status.code(), Some(2), "{rays}");
    }
}

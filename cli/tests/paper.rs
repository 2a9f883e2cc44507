//! The verb `paper` from outside: files, tables, figures, exit codes.

use crate::common::{files, folder, program};
use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::process::Output;
use std::sync::OnceLock;
use tempfile::TempDir;

fn run(folder: &Path, arguments: &[&str]) -> Output {
    program(folder).arg("paper").args(arguments).output().unwrap()
}

#[track_caller]
fn succeed(folder: &Path, arguments: &[&str]) -> Output {
    let output = run(folder, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {error}");
    output
}

/// Expects this exit code and one line that says why, and gives the line.
#[track_caller]
fn fail(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    assert!(output.stdout.is_empty());
    error
}

const QUICK: [&str; 3] = ["--quick", "--repeat", "3"];

/// A quick report that all tests look at, with what the program printed.
struct Made {
    folder: TempDir,
    printed: Value,
    note: String,
}

impl Made {
    fn path(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join("report").join(name)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn table(&self, name: &str) -> Vec<HashMap<String, String>> {
        let (head, rows) = csv(&self.text(&format!("{name}.csv")));
        for row in &rows {
            assert_eq!(row.len(), head.len(), "{name}: {row:?}");
        }
        rows.into_iter().map(|row| head.iter().cloned().zip(row).collect()).collect()
    }
}

fn made() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = folder();
        let arguments = [&QUICK[..], &["--threads", "2", "--out", "report", "--json"]].concat();
        let output = succeed(folder.path(), &arguments);
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text.lines().count(), 1, "one JSON object");
        let note = String::from_utf8(output.stderr).unwrap();
        Made { folder, printed: serde_json::from_str(&text).unwrap(), note }
    })
}

/// Fields of a CSV file (RFC 4180): the first line, and the others.
fn csv(text: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let (mut rows, mut row, mut field, mut quoted) = (Vec::new(), Vec::new(), String::new(), false);
    let mut characters = text.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                field.push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => row.push(std::mem::take(&mut field)),
            '\n' if !quoted => {
                row.push(std::mem::take(&mut field));
                rows.push(std::mem::take(&mut row));
            }
            c => field.push(c),
        }
    }
    assert!(field.is_empty() && row.is_empty() && !quoted, "the last line ends");
    let head = rows.remove(0);
    (head, rows)
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column}: `{}`", row[column]))
}

#[track_caller]
fn near(a: f64, b: f64) {
    assert!((a - b).abs() <= 1e-9 * a.abs().max(b.abs()), "{a} {b}");
}

const FILES: [&str; 38] = [
    "claims.csv",
    "equations.csv",
    "figure-10.png",
    "figure-10.svg",
    "figure-11-a.png",
    "figure-11-b.png",
    "figure-12.csv",
    "figure-12.png",
    "figure-12.svg",
    "figure-3.png",
    "figure-3.svg",
    "figure-4-points.png",
    "figure-4-points.svg",
    "figure-4.png",
    "figure-4.svg",
    "figure-5.png",
    "figure-5.svg",
    "figure-6.png",
    "figure-6.svg",
    "figure-7.csv",
    "figure-7.png",
    "figure-7.svg",
    "figure-8-points.png",
    "figure-8-points.svg",
    "figure-8.png",
    "figure-8.svg",
    "figure-9-points.png",
    "figure-9-points.svg",
    "figure-9.png",
    "figure-9.svg",
    "report.json",
    "report.md",
    "table-1.csv",
    "table-2.csv",
    "table-3.csv",
    "table-4.csv",
    "table-4.png",
    "table-4.svg",
];

#[test]
fn every_file_is_there_and_named() {
    let made = made();
    assert_eq!(files(&made.path("")), FILES);
    let mut named: Vec<&str> = made.printed["output"]
        .as_array()
        .unwrap()
        .iter()
        .map(|path| path.as_str().unwrap().strip_prefix("report/").unwrap())
        .collect();
    named.sort_unstable();
    assert_eq!(named, FILES);
    // The text shows every picture and has every table.
    let text = made.text("report.md");
    for name in FILES.iter().filter(|name| name.ends_with(".png")) {
        assert!(text.contains(&format!("]({name})")), "{name}");
    }
    for heading in ["## Tables 1 and 2", "## Table 3", "## Table 4", "survey's T_tree ms"] {
        assert!(text.contains(heading), "{heading}");
    }
    assert!(made.note.contains("--quick"), "why no GPU is measured: {}", made.note);
}

#[test]
fn the_json_file_is_what_is_printed() {
    let made = made();
    let file: Value = serde_json::from_str(&made.text("report.json")).unwrap();
    let mut printed = made.printed.clone();
    printed.as_object_mut().unwrap().remove("output");
    assert_eq!(file, printed);
    let mut keys: Vec<&str> = file.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    let expected = [
        "areas",
        "areas_scene",
        "claims",
        "figures",
        "format",
        "machine",
        "motions",
        "objects",
        "presets",
        "repeat",
        "scaling",
        "scenes",
        "size",
        "worked",
    ];
    assert_eq!(keys, expected);
    assert_eq!(
        (&file["format"], &file["repeat"], &file["size"]),
        (&2.into(), &3.into(), &serde_json::json!([96, 96]))
    );
    let machine = &file["machine"];
    assert!(machine["command"].as_str().unwrap().contains("paper --quick --repeat 3"));
    assert!(machine["instruction_set"].as_str().unwrap().starts_with("instruction set"));
    assert_eq!((&machine["threads"], &machine["adapter"]), (&2.into(), &Value::Null));
    let presets = file["presets"].as_array().unwrap();
    let names: Vec<&str> = presets.iter().map(|knobs| knobs["preset"].as_str().unwrap()).collect();
    assert_eq!(names, ["fast", "balanced", "best"]);
    for scene in file["scenes"].as_array().unwrap() {
        // A scene's rays do not depend on who builds, and neither does its frame.
        assert_eq!(scene["camera_rays"], 96 * 96);
        assert!(scene["frame_rays"].as_u64().unwrap() >= 96 * 96);
        assert_eq!(scene["rays"].as_str().unwrap().len(), 16);
        for row in scene["builders"].as_array().unwrap() {
            for time in ["tree_ms", "trace_ms", "rays_ms", "sah_cost"] {
                assert!(row[time].as_f64().unwrap() > 0.0, "{time}");
            }
            assert!(row["references"].as_u64().unwrap() >= scene["triangles"].as_u64().unwrap());
            assert_eq!(row["digest"].as_str().unwrap().len(), 16);
        }
    }
}

/// The surface of a box, face by face.
fn half_area(extents: &str) -> f64 {
    let sides: Vec<f64> = extents.split(" x ").map(|side| side.parse().unwrap()).collect();
    let faces = [(0, 1), (1, 2), (2, 0), (0, 1), (1, 2), (2, 0)];
    faces.map(|(a, b)| sides[a] * sides[b]).iter().sum::<f64>() / 2.0
}

#[test]
fn the_worked_example_is_right_where_the_survey_is_not() {
    let made = made();
    let table = made.table("table-1");
    assert_eq!(table.len(), 7);
    for row in &table {
        near(number(row, "computed"), half_area(&row["cell"]));
    }
    let printed: Vec<f64> = table.iter().map(|row| number(row, "printed")).collect();
    assert_eq!(printed, [300.0, 180.0, 220.0, 88.0, 152.0, 188.0, 92.0]);
    let computed: Vec<f64> = table.iter().map(|row| number(row, "computed")).collect();
    assert_eq!(computed, [300.0, 180.0, 220.0, 68.0, 152.0, 188.0, 92.0]);
    let terms: Vec<f64> = table.iter().map(|row| number(row, "printed terms come to")).collect();
    assert_eq!(terms, [300.0, 180.0, 200.0, 68.0, 152.0, 188.0, 92.0]);
    let table = made.table("table-2");
    assert_eq!(table.len(), 8);
    for (row, area) in table.iter().zip(&computed) {
        near(number(row, "computed"), number(row, "k") * area / 300.0);
    }
    near(number(&table[7], "computed"), 2.0 * (1.0 + 18.0 / 30.0 + 22.0 / 30.0));
    near(number(&table[7], "printed"), 4.67);
}

#[test]
fn ratios_follow_from_their_columns() {
    let table = made().table("table-3");
    // Offline, balanced and fast, tuned and at equal knobs, for each of two scenes.
    assert_eq!(table.len(), 12);
    for (index, scene) in table.chunks(3).enumerate() {
        let [offline, balanced, fast] = scene else { panic!("three builders") };
        assert_eq!(
            [offline, balanced, fast].map(|row| row["builder"].as_str()),
            ["best", "balanced", "fast"]
        );
        assert_eq!([offline, fast].map(|row| row["threads"].as_str()), ["1", "2"]);
        let knobs = if index % 2 == 0 { "tuned" } else { "equal" };
        assert!(scene.iter().all(|row| row["knobs"] == knobs));
        for column in [
            "build speed-up",
            "SAH ratio",
            "SAH ratio as printed",
            "block cost ratio",
            "T_trace ratio",
        ] {
            assert_eq!(offline[column], "");
        }
        for row in [balanced, fast] {
            let of = |column| (number(offline, column), number(row, column));
            let (base, own) = of("T_tree ms");
            near(number(row, "build speed-up"), base / own);
            let (base, own) = of("SAH cost");
            near(number(row, "SAH ratio"), own / base);
            let (base, own) = of("SAH cost as printed");
            near(number(row, "SAH ratio as printed"), own / base);
            let (base, own) = of("block cost");
            near(number(row, "block cost ratio"), own / base);
            let (base, own) = of("T_trace ms");
            near(number(row, "T_trace ratio"), own / base);
        }
        // The survey's, of its row of 11,000 triangles, as printed.
        assert_eq!(number(fast, "survey's triangles"), 11_000.0);
        near(number(fast, "survey's build speed-up"), 0.085 / 0.012);
        near(number(fast, "survey's SAH ratio"), 67.9 / 79.0);
        near(number(fast, "survey's T_trace ratio"), 0.018 / 0.022);
        near(number(fast, "survey's T_tree ms"), 12.0);
        near(number(offline, "survey's T_tree ms"), 85.0);
        assert_eq!(balanced["survey's T_tree ms"], "");
    }
}

#[test]
fn rates_follow_from_their_columns() {
    let table = made().table("table-4");
    assert_eq!(table.len(), 2 * 4);
    for row in &table {
        let update = number(row, "update ms");
        if row["structure"].starts_with("kd-tree") {
            near(number(row, "frames/s"), 1e3 / (update + number(row, "T_trace ms")));
        } else {
            assert_eq!((&row["frames/s"][..], &row["T_trace ms"][..]), ("", ""));
        }
        near(number(row, "frames/s, rays alone"), 1e3 / (update + number(row, "rays ms")));
    }
    let printed = ["23.5", "32", "10.5", ""];
    for (row, printed) in table.iter().zip(printed.iter().cycle()) {
        assert_eq!(row["survey's frames/s"], *printed, "{}", row["structure"]);
    }
}

#[test]
fn lines_meet_boxes_by_area() {
    let made = made();
    let table = made.table("figure-7");
    assert!(table.len() >= 24, "{}", table.len());
    assert!(["cell", "random"].iter().all(|kind| table.iter().any(|row| row["box"] == *kind)));
    let points: Vec<[f64; 2]> =
        table.iter().map(|row| [number(row, "area"), number(row, "lines that meet it")]).collect();
    // The correlation, by its definition.
    let n = points.len() as f64;
    let sum = |f: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(f).sum::<f64>();
    let (x, y) = (sum(&|p| p[0]), sum(&|p| p[1]));
    let (xx, yy, xy) = (sum(&|p| p[0] * p[0]), sum(&|p| p[1] * p[1]), sum(&|p| p[0] * p[1]));
    let correlation = (n * xy - x * y) / ((n * xx - x * x) * (n * yy - y * y)).sqrt();
    let areas = &made.printed["areas"];
    let r_squared = areas["r_squared"].as_f64().unwrap();
    assert!((r_squared - correlation * correlation).abs() < 1e-9, "{r_squared} {correlation}");
    assert!((0.97..=1.0).contains(&r_squared), "{r_squared}");
    let (slope, lines) = (areas["slope"].as_f64().unwrap(), areas["lines"].as_f64().unwrap());
    assert!((slope / lines - 1.0).abs() < 0.1, "Crofton: {slope} of {lines}");
    for row in &table {
        near(number(row, "expected"), lines * number(row, "area"));
        assert!((0.0..=1.0).contains(&number(row, "area")));
    }
}

#[test]
fn speed_ups_follow_from_times() {
    let table = made().table("figure-12");
    // One and two threads, of the largest and the smallest scene.
    assert_eq!(table.len(), 4);
    for points in table.chunks(2) {
        assert_eq!([&points[0], &points[1]].map(|row| row["processors"].as_str()), ["1", "2"]);
        assert_eq!(number(&points[0], "speed-up"), 1.0);
        let ratio = number(&points[0], "T_tree ms") / number(&points[1], "T_tree ms");
        near(number(&points[1], "speed-up"), ratio);
    }
    let printed = [&table[0], &table[2]].map(|row| number(row, "survey's greatest speed-up"));
    assert_eq!(printed, [6.0, 3.0]);
    assert!(number(&table[0], "triangles") > number(&table[2], "triangles"));
}

#[test]
fn pictures_can_be_read_and_show_something() {
    let made = made();
    for name in FILES.iter().filter(|name| name.ends_with(".png")) {
        let picture = image::open(made.path(name)).unwrap().to_rgb8();
        let (width, height) = picture.dimensions();
        let expected = if name.starts_with("figure-11") { 96 } else { 600 };
        assert!(width >= expected && height >= expected, "{name}");
        let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
        for pixel in picture.pixels() {
            *counts.entry(pixel.0).or_default() += 1;
        }
        let most = counts.values().max().unwrap();
        assert!(counts.len() > 20, "{name} has {} colours", counts.len());
        assert!(*most < picture.pixels().len() * 99 / 100, "{name} is of one colour");
    }
    for name in FILES.iter().filter(|name| name.ends_with(".svg")) {
        let text = made.text(name);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{name}");
        assert!(text.matches("<text").count() > 1, "{name}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
    }
}

/// Cell, planes and triangles of Figure 10 are in the tree: its caption and note name them.
#[test]
fn figure_10_says_which_node_it_shows() {
    let made = made();
    let svg = made.text("figure-10.svg");
    assert!(svg.contains("median split") && svg.contains("cut off, in this order"));
    assert!(svg.lines().any(|line| line.contains("node ") && line.contains("at level")));
}

/// Table 4 from the frames in the JSON file: medians, extremes and the decay of what is only refitted.
#[test]
fn every_frame_has_its_tree_and_refitted_rays_their_decay() {
    let made = made();
    let table = made.table("table-4");
    let motions = made.printed["motions"].as_array().unwrap();
    assert_eq!(motions.len(), 2);
    let mut rows = table.iter();
    for motion in motions {
        let rays: Vec<u64> =
            motion["rays"].as_array().unwrap().iter().map(|x| x.as_u64().unwrap()).collect();
        assert_eq!(rays.len(), 3, "frames of --quick");
        assert!(rays.iter().all(|count| *count >= 96 * 96));
        // Triangles that move give other shadow rays.
        assert!(rays.windows(2).any(|pair| pair[0] != pair[1]), "{rays:?}");
        assert!(motion["different"].as_u64().unwrap() <= 6, "it answers as the tree does");
        let courses = motion["courses"].as_array().unwrap();
        let kinds: Vec<(&str, &str)> = courses
            .iter()
            .map(|course| {
                (course["preset"].as_str().unwrap_or("-"), course["update"].as_str().unwrap())
            })
            .collect();
        let expected =
            [("balanced", "built"), ("fast", "built"), ("-", "refitted"), ("-", "built")];
        assert_eq!(kinds, expected);
        let times = |course: &Value, figure: &str| -> Vec<f64> {
            let frames = course["frames"].as_array().unwrap();
            frames.iter().map(|took| took[figure].as_f64().unwrap()).collect()
        };
        let decay: Vec<f64> = times(&courses[2], "rays_ms")
            .iter()
            .zip(times(&courses[3], "rays_ms"))
            .map(|(refitted, built)| refitted / built)
            .collect();
        for course in courses {
            let row = rows.next().unwrap();
            assert_eq!(row["structure"], course["structure"].as_str().unwrap());
            for (column, figure) in [("update ms", "update_ms"), ("rays ms", "rays_ms")] {
                let mut all = times(course, figure);
                all.sort_by(f64::total_cmp);
                near(number(row, column), all[1]);
                if figure == "rays_ms" {
                    near(number(row, "rays ms, least"), all[0]);
                    near(number(row, "rays ms, most"), all[2]);
                }
            }
            match course["update"].as_str().unwrap() {
                "refitted" => {
                    let worst = decay.iter().copied().fold(0.0, f64::max);
                    near(number(row, "worst over built anew"), worst);
                }
                _ => assert_eq!(row["worst over built anew"], ""),
            }
        }
        // A refit is no build.
        let update = |place: usize| times(&courses[place], "update_ms").iter().sum::<f64>();
        assert!(update(2) < update(3), "{motion}");
    }
    assert!(rows.next().is_none());
    assert!(made.text("report.md").contains("](table-4.png)"));
}

/// What Figures 5 and 6 say of boxes and the line, again by planes in f64.
#[test]
fn the_line_of_figure_5_meets_one_of_two_boxes() {
    let made = made();
    let objects = &made.printed["objects"];
    let vector =
        |value: &Value| -> [f64; 3] { std::array::from_fn(|axis| value[axis].as_f64().unwrap()) };
    let (origin, direction) = (vector(&objects["origin"]), vector(&objects["direction"]));
    let mut met = [Vec::new(), Vec::new(), Vec::new()];
    for own in objects["boxes"].as_array().unwrap() {
        let (lo, hi) = (vector(&own["lo"]), vector(&own["hi"]));
        let (mut enter, mut exit) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            if direction[axis] == 0.0 {
                if origin[axis] < lo[axis] || origin[axis] > hi[axis] {
                    exit = -1.0;
                }
                continue;
            }
            let ends = [lo[axis], hi[axis]].map(|end| (end - origin[axis]) / direction[axis]);
            enter = enter.max(ends[0].min(ends[1]));
            exit = exit.min(ends[0].max(ends[1]));
        }
        let meets = enter <= exit;
        assert_eq!(meets, !own["interval"].is_null(), "{own}");
        if meets {
            for (found, expected) in [enter, exit].into_iter().enumerate() {
                let found = own["interval"][found].as_f64().unwrap();
                assert!((found - expected).abs() <= 1e-6 * expected.abs(), "{own}");
            }
        }
        met[own["level"].as_u64().unwrap() as usize].push(meets);
    }
    assert_eq!((met[0].clone(), met[1].len()), (vec![true], 2));
    assert_ne!(met[1][0], met[1][1], "it meets one object and passes the other");
    let svg = made.text("figure-6.svg");
    let count = met.concat().iter().filter(|meets| **meets).count();
    assert!(svg.contains(&format!("meets {count} of {} boxes", met.concat().len())), "{count}");
    assert!(made.text("figure-9.svg").contains("(6, 4, 9)"), "leaves have their names");
}

#[test]
fn what_is_wrong_is_said_and_leaves_nothing() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("empty.obj"), "v 0 0 0\n").unwrap();
    fs::write(path("broken.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    fs::write(path("flat.obj"), "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n").unwrap();
    fs::write(path("file"), "").unwrap();
    let before = files(folder.path());
    for (code, scene) in [
        (3, "nothing.obj"),
        (3, "empty.obj"),
        (3, "broken.obj"),
        (3, "flat.obj"),
        (2, "builtin:nothing"),
        (2, "builtin:city:7"),
        (2, "builtin:city@9"),
        (2, "scene.xyz"),
    ] {
        // A good one before it, so that there is something to leave behind.
        let arguments = ["--quick", "-q", "--scene", "builtin:cornell", "--scene", scene];
        let error = fail(folder.path(), code, &arguments);
        assert!(!error.is_empty(), "{scene}");
        assert_eq!(files(folder.path()), before, "{scene}");
    }
    assert!(fail(folder.path(), 3, &["--quick", "--out", "file"]).contains("`file`"));
    assert!(fail(folder.path(), 3, &["--quick", "--out", "file/below"]).contains("file/below"));
    fail(folder.path(), 2, &["--quick", "--repeat", "4"]);
    fail(folder.path(), 2, &["--quick", "--size", "0x0"]);
    fail(folder.path(), 2, &["--quick", "--threads", "0"]);
    fail(folder.path(), 2, &["--quick", "--count", "1"]);
    // Frames are of one scene.
    fail(folder.path(), 2, &["--quick", "--frames", "a.frames.bin"]);
    let two = ["--scene", "builtin:cornell", "--scene", "builtin:spheres"];
    fail(folder.path(), 2, &[&two[..], &["--frames", "a.frames.bin"]].concat());
    let none = ["--quick", "--scene", "builtin:cornell", "--frames", "no.frames.bin"];
    fail(folder.path(), 3, &none);
    fail(folder.path(), 5, &["--quick", "--backend", "wgpu"]);
    fail(folder.path(), 4, &["--quick", "--max-memory", "1k"]);
    assert_eq!(files(folder.path()), before);
}

//! The verb `trade` from outside: files, figures, conclusions, comparisons, exit codes.

use crate::common;
use serde_json::Value;
use splitplane_measure::trade::bvh::Verdict;
use splitplane_measure::trade::document::conclude;
use splitplane_measure::trade::interval::Interval;
use splitplane_measure::trade::pareto::Standing;
use splitplane_measure::trade::payback::Payback;
use splitplane_measure::trade::recommend::{Wish, recommend};
use splitplane_measure::trade::row::{Aims, Row};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = common::program(folder);
    command.arg("trade").args(arguments);
    command
}

#[track_caller]
fn ends(folder: &Path, code: i32, arguments: &[&str]) -> Output {
    let output = program(folder, arguments).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    output
}

/// Expects this exit code and one line that says why, and gives the line.
#[track_caller]
fn fails(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let output = ends(folder, code, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.stdout.is_empty() || code == 1, "{arguments:?}");
    error.lines().find(|line| line.starts_with("splitplane: ")).unwrap_or(&error).to_owned()
}

/// A quick report that all tests look at.
struct Made {
    folder: TempDir,
    printed: Value,
}

const SCENE: &str = "builtin:city:1000";

fn made() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let arguments =
            [SCENE, "--quick", "--threads", "2", "--rays", "50000", "--out", "report", "--json"];
        let output = ends(folder.path(), 0, &arguments);
        let text = String::from_utf8(output.stdout).unwrap();
        assert_eq!(text.lines().count(), 1, "one JSON object");
        Made { folder, printed: serde_json::from_str(&text).unwrap() }
    })
}

impl Made {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("report").join(name)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn json(&self) -> Value {
        serde_json::from_str(&self.text("trade.json")).unwrap()
    }

    fn rows(&self) -> Vec<Row> {
        serde_json::from_value(self.json()["rows"].clone()).unwrap()
    }
}

const FILES: [&str; 11] = [
    "build-trace.png",
    "build-trace.svg",
    "error-trace.png",
    "error-trace.svg",
    "memory-quality.png",
    "memory-quality.svg",
    "total-rays.png",
    "total-rays.svg",
    "trade.csv",
    "trade.json",
    "trade.md",
];

#[test]
fn every_file_is_there_and_named() {
    let made = made();
    let names = fs::read_dir(made.path("")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, FILES);
    let listed = made.printed["output"].as_array().unwrap();
    let mut listed: Vec<&str> = listed.iter().map(|path| path.as_str().unwrap()).collect();
    listed.sort_unstable();
    assert_eq!(listed, FILES.map(|name| format!("report/{name}")));
    let text = made.text("trade.md");
    for name in FILES.iter().filter(|name| name.ends_with(".png")) {
        assert!(text.contains(&format!("]({name})")), "{name}");
    }
    assert!(text.contains("## Recommendation") && text.contains("A bounding volume hierarchy"));
}

#[test]
fn the_json_file_is_what_is_printed() {
    let mut printed = made().printed.clone();
    for only_printed in ["output", "comparison"] {
        printed.as_object_mut().unwrap().remove(only_printed);
    }
    assert_eq!(made().json(), printed);
    assert_eq!((&printed["format"], &printed["amounts"]["repeat"]), (&4.into(), &3.into()));
    assert_eq!(printed["scene"]["spec"], SCENE);
}

/// Fields of a CSV file (RFC 4180) by their headings.
fn csv(text: &str) -> Vec<HashMap<String, String>> {
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
    let head: Vec<String> = rows.remove(0);
    rows.into_iter()
        .map(|row: Vec<String>| {
            assert_eq!(row.len(), head.len(), "{row:?}");
            head.iter().cloned().zip(row).collect()
        })
        .collect()
}

#[test]
fn csv_and_json_agree() {
    let (table, rows) = (csv(&made().text("trade.csv")), made().rows());
    assert_eq!(table.len(), rows.len());
    for (line, row) in table.iter().zip(&rows) {
        let number = |column: &str| -> f64 { line[column].parse().unwrap() };
        let mut pairs = vec![
            ("row", row.number as f64),
            ("build_ms", row.build_ms),
            ("build_least_ms", row.least_build_ms),
            ("ns_per_ray", row.ns_per_ray),
            ("query_bytes", row.query_bytes as f64),
            ("peak_bytes", row.peak_bytes as f64),
            ("sah_cost", row.sah_cost),
            ("block_cost", row.block_cost),
            ("references", row.references as f64),
            ("build_low_ms", row.build_interval.low),
            ("build_high_ms", row.build_interval.high),
            ("ns_low", row.ns_interval.low),
            ("ns_high", row.ns_interval.high),
            ("measured_again", row.again as f64),
            ("errors_per_million", row.errors_per_million),
            ("rounded_per_million", row.rounded_per_million),
            ("threads", row.threads.unwrap() as f64),
        ];
        let names = ["primary_ns", "shadow_ns", "bounce_ns", "random_ns"];
        pairs.extend(names.into_iter().zip(row.trace.each().map(|trace| trace.ns.unwrap())));
        for (kind, errors) in Aims::<()>::NAMES.into_iter().zip(row.errors.each()) {
            for (what, count) in
                [("missing", errors.missing), ("wrong", errors.wrong), ("phantom", errors.phantom)]
            {
                let rate = 1e6 * count as f64 / errors.rays as f64;
                assert_eq!(number(&format!("{kind}_{what}_per_million")), rate);
            }
        }
        for (column, value) in pairs {
            // Reading a number from JSON may round its last digit.
            let apart = (number(column) - value).abs();
            assert!(apart <= 1e-12 * value.abs(), "{column} of row {}", row.number);
        }
        for (column, value) in [
            ("setting", &row.name),
            ("accuracy", &row.accuracy),
            ("backend", &row.backend),
            ("digest", &row.digest),
            ("tree", &row.tree),
            ("layout", &row.layout),
            ("field", &row.field),
        ] {
            assert_eq!(&line[column], value);
        }
        assert_eq!(line["pareto"], row.pareto.name());
        assert_eq!(line["also"], row.also.join("; "));
        for (what, apart) in [
            ("same_triangle", row.errors.each().map(|errors| errors.same)),
            ("other_triangle", row.errors.each().map(|errors| errors.other)),
            ("rounded", row.errors.each().map(|errors| errors.outline)),
            ("wrong", row.errors.each().map(|errors| errors.off)),
        ] {
            let answers: u64 = apart.iter().map(|apart| apart.answers).sum();
            let greatest = apart.iter().map(|apart| apart.greatest).fold(0.0, f64::max);
            assert_eq!(number(&format!("{what}_answers")), answers as f64);
            let apart = number(&format!("{what}_apart_greatest")) - greatest;
            assert!(apart.abs() <= 1e-12 * greatest, "{what} of row {}", row.number);
        }
        let kind = match row.payback {
            Payback::Base => "base",
            Payback::Always => "always",
            Payback::After { .. } => "after",
            Payback::Until { .. } => "until",
            Payback::Never => "never",
            Payback::Alike => "alike",
            Payback::Unknown => "unknown",
        };
        assert_eq!(line["pays_back"], kind);
    }
}

/// Every preset at every accuracy on one thread and on all; every knob once; each figure there.
#[test]
fn the_sweep_is_whole() {
    let rows = made().rows();
    let count = |find: &dyn Fn(&Row) -> bool| rows.iter().filter(|row| find(row)).count();
    for preset in ["fast", "balanced", "best"] {
        for accuracy in ["fast", "watertight", "exact"] {
            for threads in [1, 2] {
                let same = |row: &Row| {
                    row.name == preset && row.accuracy == accuracy && row.threads == Some(threads)
                };
                assert_eq!(count(&same), 1, "{preset}, {accuracy}, {threads}");
            }
        }
    }
    for knob in [
        "K_T/K_I 1/2",
        "K_T/K_I 1/8",
        "C_e 12.5 %",
        "C_e 50 %",
        "T 32",
        "W 1",
        "16 bins",
        "64 bins",
        "depth 32",
        "no clip",
        "reference cap 2",
        "compact layout",
    ] {
        let own = |row: &Row| {
            row.knob.as_deref() == Some(knob) || row.also.iter().any(|name| name.ends_with(knob))
        };
        assert!(count(&own) >= 1, "{knob}");
    }
    // Each knob once, in a row of its own or in one of the same tree; those stand in rows of all accuracies.
    let names: HashSet<&String> =
        rows.iter().flat_map(|row| row.also.iter().chain([&row.name])).collect();
    assert_eq!(names.len(), 3 + 9 + 11 + 6 + 3);
    assert!(rows.iter().any(|row| !row.also.is_empty()), "no knob leaves a tree as it is");
    for (place, row) in rows.iter().enumerate() {
        assert_eq!(row.number, place + 1);
        for trace in row.trace.each() {
            assert!(trace.rays > 100 && trace.rays <= 1024, "{trace:?}");
            assert!(trace.least_ns.unwrap() > 0.0 && trace.least_ns <= trace.ns);
        }
        assert!(row.least_build_ms > 0.0 && row.least_build_ms <= row.build_ms);
        let Interval { low, high } = row.build_interval;
        assert!(low <= row.build_ms && row.build_ms <= high && row.least_build_ms <= low);
        // What is given is the median of what the interval is of.
        let Interval { low, high } = row.ns_interval;
        assert!(0.0 < low && low <= row.ns_per_ray && row.ns_per_ray <= high, "{}", row.title());
        let sets = row.trace.each().map(|trace| trace.least_ns.unwrap());
        assert!(sets.iter().sum::<f64>() / 4.0 <= row.ns_per_ray);
        // One row each tree of a preset, layout, accuracy and number of threads.
        let twin = |other: &&Row| {
            let of =
                |row: &Row| (row.preset.clone(), row.tree.clone(), row.layout.clone(), row.threads);
            other.accuracy == row.accuracy && of(other) == of(row)
        };
        assert_eq!(rows.iter().filter(twin).count(), 1, "{}", row.title());
        assert!(row.query_bytes > 0 && row.peak_bytes > 0 && row.sah_cost > 0.0);
        // The same tree, whoever builds it and whatever is traced through it.
        let same = rows.iter().find(|other| other.name == row.name).unwrap();
        assert_eq!((&same.digest, same.references), (&row.digest, row.references));
    }
}

/// What the accuracies promise, and that the rays are of a kind to tell them apart.
#[test]
fn errors_are_those_of_the_accuracies() {
    let rows = made().rows();
    let mut of_fast = 0;
    for row in &rows {
        for (kind, errors) in Aims::<()>::NAMES.into_iter().zip(row.errors.each()) {
            // Not every pixel sees a surface, and not every surface faces a light.
            let some = ["primary", "bounce", "shadow"].contains(&kind);
            let whole = if some { 100..1001 } else { 1000..1001 };
            assert!(whole.contains(&errors.rays), "{kind}: {}", errors.rays);
            assert!(kind != "shadow" || errors.wrong == 0, "there is no place to be wrong in");
            assert_eq!(errors.off.answers, errors.wrong, "{kind}");
            if kind == "shadow" {
                assert_eq!((errors.same.answers, errors.other.answers), (0, 0), "it has no place");
            }
            let right = errors.rays - errors.missing - errors.wrong - errors.phantom;
            assert!(errors.same.answers + errors.other.answers <= right, "{kind}");
            assert!(errors.outline.answers <= errors.rounded, "{kind}");
            match row.accuracy.as_str() {
                "exact" => {
                    assert_eq!(errors.all() + errors.rounded, 0, "{}", row.title());
                    assert_eq!(errors.same.greatest.max(errors.other.greatest), 0.0, "{kind}");
                    assert_eq!(errors.other.answers, 0, "{kind}");
                }
                "watertight" => assert_eq!(errors.all(), 0, "{}", row.title()),
                _ => of_fast += errors.all(),
            }
        }
        let judged: u64 = row.errors.each().into_iter().map(|errors| errors.rays).sum();
        let rate = 1e6 * row.sum(|errors| errors.all()) as f64 / judged as f64;
        assert!((row.errors_per_million - rate).abs() < 1e-9);
    }
    let same = |row: &Row| row.errors.each().map(|errors| errors.same.greatest);
    let rounds = |name: &str| {
        rows.iter().filter(|row| row.accuracy == name).flat_map(same).fold(0.0, f64::max)
    };
    // What is right is off by roundings of f32 only, but is off.
    assert!((1e-12..1e-4).contains(&rounds("watertight")), "{}", rounds("watertight"));
    assert!((1e-12..1e-4).contains(&rounds("fast")), "{}", rounds("fast"));
    assert!(of_fast > 0, "rays at edges and vertices lose nothing at accuracy fast");
}

/// The judge is held against a reference that shares neither tree nor test with it.
#[test]
fn the_exact_answers_are_checked() {
    let made = made();
    let held = &made.printed["held"];
    let rays: u64 = made.rows()[0].errors.each().into_iter().map(|errors| errors.rays).sum();
    assert_eq!(held["checked"], rays, "few enough that all are");
    assert_eq!(held["by_brute_force"], rays, "on a mesh that is small enough");
    assert_eq!((&held["disagreements"], &held["first"]), (&0.into(), &Value::Null));
    assert!(made.text("trade.md").contains("held against an independent reference"));
}

/// The hierarchy is measured as the rows are, and what follows is reckoned from the figures in the file.
#[test]
fn a_hierarchy_is_measured_beside_the_rows() {
    let made = made();
    let verdict: Verdict = serde_json::from_value(made.printed["bvh"].clone()).unwrap();
    let hierarchy = &verdict.hierarchy;
    assert!(hierarchy.build_ms > 0.0 && hierarchy.refit_ms > 0.0, "{hierarchy:?}");
    assert_eq!(hierarchy.threads, 2);
    let rows = made.rows();
    for (its, own) in hierarchy.trace.each().into_iter().zip(rows[0].trace.each()) {
        assert_eq!(its.rays, own.rays);
        assert!(its.ns >= its.least_ns && its.least_ns > Some(0.0), "{its:?}");
    }
    let judged: u64 = rows[0].errors.each().into_iter().map(|errors| errors.rays).sum();
    assert_eq!(hierarchy.judged, judged);
    // It leaks at edges and vertices, and many of the judged rays are aimed there.
    assert!((1..judged / 20).contains(&hierarchy.otherwise), "{hierarchy:?}");
    let wish = &made.printed["recommendation"]["wish"];
    let (rays, frames) = (wish["rays"].as_f64().unwrap(), wish["frames"].as_f64().unwrap());
    let total = hierarchy.build_ms
        + (frames - 1.0) * hierarchy.refit_ms
        + frames * rays * hierarchy.ns_per_ray * 1e-6;
    assert!((verdict.total_ms / total - 1.0).abs() < 1e-9, "{verdict:?}");
    assert!(made.text("trade.md").contains(&verdict.words));
}

/// By the definition, from the numbers in the file.
#[test]
fn optimal_rows_are_those_that_none_beats() {
    let rows = made().rows();
    // -1 where the first is less beyond the noise, 1 where it is more.
    let apart = |a: Interval, b: Interval| {
        i32::from(b.high * 1.05 < a.low) - i32::from(a.high * 1.05 < b.low)
    };
    let exactly = |value: f64| Interval { low: value, high: value };
    let sign = |a: f64, b: f64| a.partial_cmp(&b).unwrap() as i32;
    let seen = |a: &Row, b: &Row| {
        let same_tree = (&a.tree, &a.layout, a.threads) == (&b.tree, &b.layout, b.threads);
        let build = sign(a.build_ms, b.build_ms);
        [
            if same_tree && a.preset == b.preset { 0 } else { build },
            if same_tree && a.accuracy == b.accuracy {
                0
            } else {
                sign(a.ns_per_ray, b.ns_per_ray)
            },
            a.query_bytes.cmp(&b.query_bytes) as i32,
            sign(a.errors_per_million, b.errors_per_million),
            sign(a.rounded_per_million, b.rounded_per_million),
        ]
    };
    let figures = |a: &Row, b: &Row| {
        let same_tree = (&a.tree, &a.layout, a.threads) == (&b.tree, &b.layout, b.threads);
        let build = apart(a.build_interval, b.build_interval);
        let ray = apart(a.ns_interval, b.ns_interval);
        let bytes = [a, b].map(|row| exactly(row.query_bytes as f64));
        let errors = a.errors_per_million.partial_cmp(&b.errors_per_million).unwrap() as i32;
        let rounded = a.rounded_per_million.partial_cmp(&b.rounded_per_million).unwrap() as i32;
        [
            if same_tree && a.preset == b.preset { 0 } else { build },
            if same_tree && a.accuracy == b.accuracy { 0 } else { ray },
            apart(bytes[0], bytes[1]),
            errors,
            rounded,
        ]
    };
    let mut marked: HashMap<&str, usize> = HashMap::new();
    for row in &rows {
        let others = || rows.iter().filter(|o| o.field == row.field && o.number != row.number);
        let beats = |other: &Row| {
            figures(other, row).iter().any(|x| *x < 0) && seen(other, row).iter().all(|x| *x <= 0)
        };
        let saved = |other: &Row| figures(row, other).iter().any(|x| *x < 0);
        let expected = match (others().any(beats), others().all(saved)) {
            (true, _) => Standing::Beaten,
            (false, true) => Standing::Optimal,
            (false, false) => Standing::Perhaps,
        };
        assert_eq!(row.pareto, expected, "row {}", row.number);
        *marked.entry(expected.name()).or_default() += 1;
        let single = row.threads == Some(1);
        assert_eq!(row.field, if single { "one thread" } else { "all" });
    }
    let unbeaten = rows.len() - marked.get("beaten").copied().unwrap_or(0);
    assert!(unbeaten > 1 && unbeaten < rows.len(), "{marked:?}");
}

#[test]
fn builds_pay_back_where_the_lines_cross() {
    let rows = made().rows();
    let total = |row: &Row, rays: f64| row.build_ms + rays * row.ns_per_ray / 1e6;
    let mut bases = 0;
    for row in &rows {
        let base = rows
            .iter()
            .find(|other| {
                other.name == "fast"
                    && other.accuracy == row.accuracy
                    && other.threads == row.threads
            })
            .unwrap();
        let less = |rays: f64| total(row, rays) - total(base, rays);
        let scale = |rays: f64| 1e-9 * total(row, rays);
        let [build, ray, ..] = row.compare(base);
        match row.payback {
            Payback::Base => {
                assert_eq!(row.number, base.number);
                bases += 1;
            }
            Payback::Alike => assert!(build.is_eq() && ray.is_eq()),
            Payback::Always => assert!(build.is_le() && ray.is_le()),
            Payback::Never => assert!(build.is_ge() && ray.is_ge()),
            Payback::After { rays, within: [low, high] } => {
                assert!(0.0 < low && low <= rays && rays <= high, "{}", row.title());
                assert!(build.is_gt() && ray.is_lt());
                assert!(less(rays).abs() <= scale(rays), "{}", row.title());
                assert!(less(0.5 * rays) > 0.0 && less(2.0 * rays) < 0.0);
            }
            Payback::Until { rays, within: [low, high] } => {
                assert!(0.0 < low && low <= rays && rays <= high, "{}", row.title());
                assert!(build.is_lt() && ray.is_gt());
                assert!(less(rays).abs() <= scale(rays), "{}", row.title());
                assert!(less(0.5 * rays) < 0.0 && less(2.0 * rays) > 0.0);
            }
            Payback::Unknown => panic!("{} has a base", row.title()),
        }
    }
    assert_eq!(bases, 3 * 2, "accuracies by threads");
}

fn wish(rays: u64, frames: u64, still: bool) -> Wish {
    Wish { rays, frames, still, least_accuracy: "watertight".into(), max_error: None }
}

/// The plainest preset of those that are not told apart from the least, for many numbers of rays and frames, and the
/// steps between them.
#[test]
fn what_is_recommended_is_least_within_the_noise() {
    let made = made();
    let rows = made.rows();
    let will_do = |row: &&Row| row.threads == Some(2) && row.accuracy != "fast";
    let plain = |row: &&Row| will_do(row) && row.knob.is_none();
    let total = |row: &Row, rays: f64| row.build_ms + rays * row.ns_per_ray / 1e6;
    for power in 0..30 {
        let rays = 3u64.pow(power);
        for (frames, still) in [(1, false), (7, false), (7, true)] {
            let found = recommend(&rows, &wish(rays, frames, still));
            let row = &rows[found.row.unwrap() - 1];
            assert!(plain(&row), "{}", row.title());
            let per_build = rays as f64 * if still { frames as f64 } else { 1.0 };
            let least = rows
                .iter()
                .filter(plain)
                .min_by(|a, b| total(a, per_build).total_cmp(&total(b, per_build)))
                .unwrap();
            assert!(!least.compare_total(row, per_build).is_lt(), "{}", found.words);
            let plainer = |other: &&Row| plain(other) && other.number < row.number;
            let passed = rows.iter().filter(plainer);
            for other in passed {
                assert!(least.compare_total(other, per_build).is_lt(), "{}", found.words);
            }
            let builds = if still { 1.0 } else { frames as f64 };
            let expected = builds * total(row, per_build);
            assert!((found.total_ms.unwrap() / expected - 1.0).abs() < 1e-9);
            if let Some(turned) = found.turned {
                let turned = &rows[turned - 1];
                assert!(turned.knob.is_some() && will_do(&turned));
                assert!(turned.compare_total(row, per_build).is_lt());
            }
            let few_builds = recommend(&rows, &wish(rays, 1, false)).row;
            if !still {
                assert_eq!(found.row, few_builds, "frames with builds change the total only");
            }
        }
    }
    let steps = made.json()["steps"].as_array().unwrap().clone();
    assert_eq!(steps[0]["from_rays"], 0.0);
    for pair in steps.windows(2) {
        let from = |step: &Value| step["from_rays"].as_f64().unwrap();
        assert!(from(&pair[0]) < from(&pair[1]) && pair[0]["row"] != pair[1]["row"], "{pair:?}");
    }
    let printed = &made.printed["recommendation"];
    assert_eq!(printed["wish"]["rays"], 50_000);
    let found = recommend(&rows, &wish(50_000, 1, false));
    assert_eq!(printed["row"], found.row.unwrap());
}

/// Two settings of one tree, measured as if they were two: whatever their times, no conclusion sets one above the other.
#[test]
fn a_planted_pair_of_equal_trees_is_never_ranked() {
    let folder = tempfile::tempdir().unwrap();
    // The file of an earlier run is repeated row by row; in it one row stands twice, and its times are far apart.
    let twice = changed("twice.json", |json| {
        let rows = json["rows"].as_array_mut().unwrap();
        let mut own = rows
            .iter()
            .find(|row| {
                row["name"] == "fast" && row["accuracy"] == "watertight" && row["threads"] == 2
            })
            .unwrap()
            .clone();
        own["number"] = 1.into();
        let mut twin = own.clone();
        twin["number"] = 2.into();
        twin["name"] = "fast, depth 63".into();
        twin["knob"] = "depth 63".into();
        twin["config"]["max_depth"] = 63.into();
        *rows = vec![own, twin];
    });
    let arguments = ["--compare", twice.to_str().unwrap(), "--threshold", "1000000", "--json"];
    let output = ends(folder.path(), 0, &arguments);
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let mut rows: Vec<Row> = serde_json::from_value(printed["rows"].clone()).unwrap();
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0].tree, rows[1].tree);
    assert_ne!(rows[0].digest, rows[1].digest, "the digest says what shaped it");
    for factor in [1.0, 0.1, 10.0] {
        let scaled = |Interval { low, high }| Interval { low: factor * low, high: factor * high };
        rows[1] = Row {
            build_ms: factor * rows[0].build_ms,
            build_interval: scaled(rows[0].build_interval),
            ns_per_ray: factor * rows[0].ns_per_ray,
            ns_interval: scaled(rows[0].ns_interval),
            ..rows[1].clone()
        };
        conclude(&mut rows);
        assert_eq!(rows.iter().map(|row| row.pareto).collect::<Vec<_>>(), [Standing::Perhaps; 2]);
        assert_eq!([rows[0].payback, rows[1].payback], [Payback::Base, Payback::Alike]);
        for rays in [1, 1 << 20, 1 << 40] {
            let found = recommend(&rows, &wish(rays, 1, false));
            assert_eq!((found.row, found.next, found.turned), (Some(1), None, None));
        }
    }
}

#[test]
fn no_leaky_row_unless_asked_for_and_none_that_errs_too_much() {
    let rows = made().rows();
    for rays in [1, 1_000_000] {
        let leaky = Wish { least_accuracy: "fast".into(), ..wish(rays, 1, false) };
        assert!(recommend(&rows, &leaky).row.is_some());
        let exact = Wish { least_accuracy: "exact".into(), ..wish(rays, 1, false) };
        let found = recommend(&rows, &exact).row.unwrap();
        assert_eq!(rows[found - 1].accuracy, "exact");
        let strict = Wish { max_error: Some(0.0), ..leaky };
        let found = recommend(&rows, &strict).row.unwrap();
        assert_eq!(rows[found - 1].errors_per_million, 0.0);
    }
}

#[test]
fn plots_can_be_read_and_say_what_they_show() {
    let made = made();
    for name in FILES.iter().filter(|name| name.ends_with(".png")) {
        let picture = image::open(made.path(name)).unwrap().to_rgb8();
        assert!(picture.width() >= 1200 && picture.height() >= 800, "{name}");
        let mut counts: HashMap<[u8; 3], usize> = HashMap::new();
        for pixel in picture.pixels() {
            *counts.entry(pixel.0).or_default() += 1;
        }
        let most = counts.values().max().unwrap();
        assert!(counts.len() > 20 && *most < picture.pixels().len() * 99 / 100, "{name}");
    }
    let says = [
        ("build-trace.svg", ["Build against trace", "milliseconds to build", "nanoseconds a ray"]),
        ("error-trace.svg", ["Errors against trace", "nanoseconds a ray", "hits a million rays"]),
        ("memory-quality.svg", ["Memory against quality", "SAH cost", "bytes that queries read"]),
        ("total-rays.svg", ["Total time against rays", "rays traced", "milliseconds"]),
    ];
    for (name, words) in says {
        let text = made.text(name);
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{name}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
        for words in words {
            assert!(text.contains(words), "{name}: {words}");
        }
        assert_eq!(overlapping(&text), Vec::<String>::new(), "{name}");
    }
}

/// Pairs of texts of an SVG whose boxes meet, letters taken as half as wide as they are high: less
/// than they are.
fn overlapping(svg: &str) -> Vec<String> {
    let attribute = |tag: &str, name: &str| -> Option<String> {
        let rest = &tag[tag.find(&format!(" {name}=\""))? + name.len() + 3..];
        Some(rest[..rest.find('"')?].to_owned())
    };
    let mut boxes: Vec<([f64; 4], String)> = Vec::new();
    for part in svg.split("<text ").skip(1) {
        let (tag, rest) = part.split_once('>').unwrap();
        let tag = format!(" {tag}");
        let words = rest[..rest.find("</text>").unwrap()].trim().to_owned();
        let number = |name| attribute(&tag, name).unwrap().parse::<f64>().unwrap();
        let (x, y, size) = (number("x"), number("y"), number("font-size"));
        let width = 0.5 * size * words.chars().count() as f64;
        let left = match attribute(&tag, "text-anchor").as_deref() {
            Some("end") => x - width,
            Some("middle") => x - 0.5 * width,
            _ => x,
        };
        // Turned text runs upwards.
        let rect = match attribute(&tag, "transform") {
            Some(turn) if turn.contains("rotate") => {
                [x, y - 0.5 * width, x + 0.6 * size, y + 0.5 * width]
            }
            _ => [left, y - 0.3 * size, left + width, y + 0.3 * size],
        };
        boxes.push((rect, words));
    }
    assert!(boxes.len() > 10, "few texts: they are not found");
    let mut out = Vec::new();
    for (i, (a, words)) in boxes.iter().enumerate() {
        for (b, others) in &boxes[..i] {
            if a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3] {
                out.push(format!("`{words}` and `{others}`"));
            }
        }
    }
    out
}

/// The report's file with changes, beside it.
fn changed(name: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut json = made().json();
    change(&mut json);
    let path = made().folder.path().join(name);
    fs::write(&path, json.to_string()).unwrap();
    path
}

/// Compared with itself all passes: answers and trees are the same, and times have ample room.
#[test]
fn nothing_is_worse_than_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = made().path("trade.json");
    let arguments = ["--compare", path.to_str().unwrap(), "--threshold", "1000000"];
    let output = ends(folder.path(), 0, &arguments);
    let words = String::from_utf8(output.stdout).unwrap();
    assert!(words.contains("0 past") && !words.contains("trees "), "{words}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written unasked");
}

/// An earlier run that was better than can be: named are the row and the figure, and all else is not.
#[test]
fn what_got_worse_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let leaky = made().rows().into_iter().find(|row| row.errors.vertex.wrong > 0).unwrap();
    let place = leaky.number - 1;
    let at_rims = made().rows().into_iter().find(|row| row.errors.edge.rounded > 0).unwrap();
    let planted = changed("planted.json", |json| {
        json["rows"][2]["least_build_ms"] = 1e-9.into();
        json["rows"][3]["trace"]["bounce"]["least_ns"] = 1e-9.into();
        json["rows"][4]["query_bytes"] = 1.into();
        json["rows"][5]["digest"] = "0123456789abcdef".into();
        json["rows"][place]["errors"]["vertex"]["wrong"] = 0.into();
        json["rows"][at_rims.number - 1]["errors"]["edge"]["rounded"] = 0.into();
        json["rows"][7]["redone_per_million"] = (-1.0).into();
    });
    let arguments = ["--compare", planted.to_str().unwrap(), "--threshold", "1000000", "--json"];
    let output = ends(folder.path(), 1, &arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(
        error.contains("6 of ") && error.contains("row 3 (") && error.contains("bounce"),
        "{error}"
    );
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let comparison = &printed["comparison"];
    let mut found: Vec<(u64, &str)> = comparison["worse"]
        .as_array()
        .unwrap()
        .iter()
        .map(|worse| (worse["row"].as_u64().unwrap(), worse["figure"].as_str().unwrap()))
        .collect();
    let mut expected = vec![
        (3, "least build ms"),
        (4, "least ns of bounce rays"),
        (5, "query bytes"),
        (leaky.number as u64, "wrong a million vertex rays"),
        (at_rims.number as u64, "rounded a million edge rays"),
        (8, "redone a million judged rays"),
    ];
    found.sort_unstable();
    expected.sort_unstable();
    assert_eq!(found, expected);
    assert_eq!(comparison["other_trees"], serde_json::json!([6]));
}

#[test]
fn files_that_are_no_earlier_run_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let whole = made().text("trade.json");
    let cut = made().folder.path().join("cut.json");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let cases: [(PathBuf, &str); 12] = [
        (cut, "damaged"),
        (folder.path().join("none.json"), "cannot be read"),
        (changed("format.json", |json| json["format"] = 9.into()), "of format 9"),
        (changed("rows.json", |json| json["rows"] = serde_json::json!([])), "has no rows"),
        (
            changed("preset.json", |json| json["rows"][1]["preset"] = "worst".into()),
            "row 2: no such preset",
        ),
        (
            changed("knob.json", |json| json["rows"][0]["config"]["block_width"] = 1000.into()),
            "block_width is 1000",
        ),
        (
            changed("level.json", |json| json["rows"][0]["accuracy"] = "sloppy".into()),
            "no such accuracy",
        ),
        (
            changed("backend.json", |json| json["rows"][0]["backend"] = "tpu".into()),
            "no such backend",
        ),
        (changed("time.json", |json| json["rows"][0]["build_ms"] = (-1).into()), "not above 0"),
        (
            changed("number.json", |json| json["rows"][0]["number"] = 7.into()),
            "row 1: is not where",
        ),
        (changed("other.json", |json| json["scene"]["triangles"] = 7.into()), "was measured on"),
        (
            changed("lost.json", |json| {
                json["rows"][3].as_object_mut().unwrap().remove("digest");
            }),
            "missing field `digest`",
        ),
    ];
    for (path, why) in cases {
        let said = fails(folder.path(), 3, &["--compare", path.to_str().unwrap()]);
        assert!(said.contains(why), "{said}");
    }
    // Other corners are found out once they are known.
    let moved = changed("moved.json", |json| json["scene"]["mesh"] = "0".into());
    let said = fails(folder.path(), 3, &["--compare", moved.to_str().unwrap()]);
    assert!(said.contains("other corners"), "{said}");
}

#[test]
fn wrong_usage_and_missing_devices_have_their_codes() {
    let folder = tempfile::tempdir().unwrap();
    for (code, arguments) in [
        (2, &[][..]),
        (2, &["builtin:nowhere", "--quick"]),
        (2, &[SCENE, "--rays", "0"]),
        (2, &[SCENE, "--max-error=-1"]),
        (2, &[SCENE, "--compare", "old.json", "--quick"]),
        (2, &[SCENE, "--quick", "--backend", "wgpu", "--presets", "best"]),
        (3, &["nowhere.obj", "--quick"]),
        (4, &[SCENE, "--quick", "--max-memory", "64"]),
        (5, &[SCENE, "--quick", "--backend", "cpu,wgpu"]),
    ] {
        ends(folder.path(), code, arguments);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "no folder is left behind");
}

/// In the middle of measuring, by the clock and by Ctrl-C: code 7, where it was, and no folder.
#[test]
fn a_sweep_that_is_cut_short_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let long = ["builtin:city:20000", "--backend", "cpu", "--seconds", "600", "--out", "report"];
    let said = fails(folder.path(), 7, &[&long[..], &["--timeout", "1.5"]].concat());
    assert!(said.contains("limit of 1.5 seconds ran out in: "), "{said}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    #[cfg(unix)]
    {
        use std::process::Stdio;
        let mut running = program(folder.path(), &long);
        let running = running.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1000));
        let id = running.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        let output = running.wait_with_output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(7), "{error}");
        assert!(error.contains("splitplane: cancelled"), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

/// Both backends beside each other, where there is a device; software Vulkan will do.
#[test]
#[cfg_attr(no_gpu, ignore = "no Vulkan adapter and none could be installed")]
fn a_device_stands_beside_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        SCENE,
        "--quick",
        "--backend",
        "cpu,wgpu",
        "--presets",
        "fast",
        "--accuracies",
        "watertight",
        "--no-knobs",
        "--threads",
        "1",
        "--repeat",
        "1",
        "--sample-rays",
        "48",
        "--error-rays",
        "20",
        "--json",
        "--out",
        "both",
    ];
    let mut command = Command::new(env!("CARGO_BIN_EXE_splitplane"));
    command.current_dir(folder.path()).arg("trade").args(arguments);
    command.env("NODEVICE_SELECT", "1").env_remove("WGPU_ADAPTER_NAME");
    let output = command.output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{error}");
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    let rows = printed["rows"].as_array().unwrap();
    let backends: Vec<&str> = rows.iter().map(|row| row["backend"].as_str().unwrap()).collect();
    assert_eq!(backends, ["cpu", "wgpu"]);
    assert_eq!(rows[0]["digest"], rows[1]["digest"], "one tree");
    assert_eq!(rows[0]["errors"], rows[1]["errors"], "the same answers");
    assert_eq!((&rows[1]["threads"], &rows[1]["payback"]["kind"]), (&Value::Null, &"base".into()));
    assert!(printed["machine"]["adapter"].is_string());
}

/// Pictures: more samples are nearer to the most, and a scene with mirrors needs its depth.
#[test]
fn pictures_lose_by_their_settings() {
    let folder = tempfile::tempdir().unwrap();
    let few = ["--quick", "--presets", "fast", "--no-knobs", "--threads", "1", "--json"];
    let of = |scene: &str, out: &str, more: &[&str]| -> Value {
        let arguments = [&[scene], &few[..], &["--out", out], more].concat();
        serde_json::from_slice(&ends(folder.path(), 0, &arguments).stdout).unwrap()
    };
    let with = |report: &Value, knob: &str| -> Vec<(f64, f64)> {
        let rows = report["picture"]["rows"].as_array().unwrap();
        let own = rows.iter().filter(|row| row["knob"] == knob);
        let number = |row: &Value, name: &str| row[name].as_f64().unwrap();
        own.map(|row| (number(row, "value"), number(row, "root_mean_square"))).collect()
    };
    let plain = of(SCENE, "plain", &[]);
    let samples = with(&plain, "samples");
    assert_eq!(samples.len(), 4);
    assert!(samples.windows(2).all(|pair| pair[0].1 > pair[1].1 && pair[1].1 > 0.0), "{samples:?}");
    for knob in ["depth", "weight"] {
        assert!(with(&plain, knob).iter().all(|(_, apart)| *apart == 0.0), "nothing mirrors");
    }
    assert!(
        fs::read_to_string(folder.path().join("plain/trade.md"))
            .unwrap()
            .contains("change no pixel")
    );
    let mirrors = of("builtin:gallery", "mirrors", &[]);
    let depths = with(&mirrors, "depth");
    assert!(depths[0].1 > 1.0, "without depth mirrors are black: {depths:?}");
    assert!(depths.last().unwrap().1 < 0.5 * depths[0].1, "{depths:?}");
    let weights = with(&mirrors, "weight");
    assert!(weights.windows(2).all(|pair| pair[0].1 >= pair[1].1), "{weights:?}");
    let again = of("builtin:gallery", "again", &[]);
    for knob in ["samples", "depth", "weight"] {
        assert_eq!(with(&mirrors, knob), with(&again, knob), "pictures depend on nothing else");
    }
    assert_eq!(of(SCENE, "none", &["--no-picture"])["picture"], Value::Null);
}

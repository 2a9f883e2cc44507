//! The verbs that make pictures, from outside: files, reports, exit codes.

use crate::common::{fail, files, folder, succeed};
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

fn json(folder: &TempDir, arguments: &[&str]) -> Value {
    serde_json::from_str(&succeed(folder, arguments)).unwrap()
}

const SMALL: [&str; 4] = ["--size", "32x20", "--samples", "1"];

#[test]
fn the_plan_of_a_frame_is_explained() {
    let folder = folder();
    let mut text = String::new();
    for options in [
        &["builtin:city:10000", "--no-lights"][..],
        &["builtin:spheres", "--lights", "2"],
        &["builtin:gallery", "--depth", "0", "--samples", "4"],
    ] {
        let arguments = [&["render", "--explain", "--size", "320x200"], options].concat();
        text += &format!("# {}\n{}\n", options.join(" "), succeed(&folder, &arguments));
    }
    insta::assert_snapshot!("explain", text);
    assert_eq!(files(folder.path()), Vec::<String>::new());
}

#[test]
fn pictures_with_further_variables() {
    let folder = folder();
    let aovs = ["--aov", "depth,normal,triangle,nodes,tests"];
    let arguments = [&["render", "builtin:spheres", "-o", "a.png"][..], &SMALL, &aovs].concat();
    succeed(&folder, &arguments);
    let expected =
        ["a.depth.png", "a.nodes.png", "a.normal.png", "a.png", "a.tests.png", "a.triangle.png"];
    assert_eq!(files(folder.path()), expected);
    for name in expected {
        let picture = image::open(folder.path().join(name)).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (32, 20), "{name}");
        let first = picture.get_pixel(0, 0);
        assert!(picture.pixels().any(|pixel| pixel != first), "{name} is of one colour");
    }
    let arguments = [&["render", "builtin:spheres", "-o", "a.exr"][..], &SMALL, &aovs].concat();
    let report = json(&folder, &[&arguments[..], &["--json"]].concat());
    assert_eq!(report["output"], serde_json::json!(["a.exr"]));
    assert!(report["paths"].as_u64().unwrap() >= 640);
    let linear = image::open(folder.path().join("a.exr")).unwrap().to_rgb32f();
    assert_eq!(linear.dimensions(), (32, 20));
    assert!(linear.pixels().all(|pixel| pixel.0.iter().all(|part| part.is_finite())));
}

#[test]
fn heat_maps() {
    let folder = folder();
    let heat = ["render", "builtin:spheres", "-o", "h.png", "--heatmap", "nodes"];
    let report = succeed(&folder, &[&heat[..], &SMALL].concat());
    let line = report.lines().find(|line| line.starts_with("cost")).unwrap();
    assert!(line.contains("nodes visited") && line.contains("mean"), "{line}");
    let picture = image::open(folder.path().join("h.png")).unwrap();
    assert!(picture.width() > 32, "the scale stands beside the map");
    let exr = [&["render", "builtin:spheres", "-o", "h.exr", "--heatmap", "nodes"][..], &SMALL];
    assert!(fail(&folder, 2, &exr.concat()).contains("heat maps are written as .png"));
    fail(&folder, 2, &[&heat[..], &["--aov", "depth"]].concat());
    fail(&folder, 2, &["render", "--heatmap-top", "5"]);
}

#[test]
fn lights_by_option_change_the_picture_and_bad_ones_are_refused() {
    let folder = folder();
    let render = |name: &str, options: &[&str]| {
        let arguments =
            [&["render", "builtin:cornell", "-q", "-o", name][..], &SMALL, options].concat();
        succeed(&folder, &arguments);
        image::open(folder.path().join(name)).unwrap().to_rgb8()
    };
    let own = render("own.png", &[]);
    let none = render("none.png", &["--no-lights"]);
    let lamp = render("lamp.png", &["--light", "2.7,4.5,4,1,0.5,0.2"]);
    let sun = render("sun.png", &["--sun", "-1,0.5,2"]);
    let black = render("black.png", &["--no-lights", "--environment", "black"]);
    assert!(own != none && none != lamp && lamp != sun);
    assert!(black.pixels().all(|pixel| pixel.0 == [0; 3]));
    for wrong in [
        &["--light", "1,2"][..],
        &["--sun", "0,0,0"],
        &["--light", "1,2,3", "--no-lights"],
        &["--lights", "9"],
        &["--samples", "65"],
        &["--depth", "17"],
        &["--ambient", "1.5"],
        &["--environment", "red"],
        &["--materials", "all"],
    ] {
        fail(&folder, 2, &[&["render", "builtin:cornell"], wrong].concat());
    }
    assert_eq!(files(folder.path()).len(), 5);
}

/// Light by paths is reproducible, and brightens what direct light leaves dark.
#[test]
fn light_by_paths_is_asked_for() {
    let folder = folder();
    let render = |name: &str, more: &[&str]| {
        let output = folder.path().join(name);
        let output = output.to_str().unwrap();
        let first =
            ["render", "builtin:cornell", "--size", "24x24", "--samples", "4", "-o", output];
        let text = succeed(&folder, &[&first[..], more].concat());
        (fs::read(output).unwrap(), text)
    };
    let (direct, _) = render("direct.png", &["--ambient", "0"]);
    let paths = ["--transport", "paths"];
    let (once, text) = render("once.png", &paths);
    let (again, _) = render("again.png", &[&paths[..], &["--threads", "1"]].concat());
    assert_eq!(once, again);
    assert_ne!(once, direct);
    assert!(text.contains("auto: the CPU, since") && !text.contains("shading"), "{text}");
    let (more, _) = render("more.png", &[&paths[..], &["--passes", "3"]].concat());
    assert_ne!(more, once);
    let mean = |file: &[u8]| {
        let picture = image::load_from_memory(file).unwrap().to_rgb8();
        picture.as_raw().iter().map(|&byte| f64::from(byte)).sum::<f64>()
            / picture.as_raw().len() as f64
    };
    assert!(mean(&once) > mean(&direct) + 20.0, "{} {}", mean(&once), mean(&direct));
    assert!((mean(&once) - mean(&more)).abs() < 4.0, "{} {}", mean(&once), mean(&more));
    let photons = ["--transport", "photons", "--photons", "20000"];
    for gather in ["maps", "final"] {
        let (photons, text) =
            render("photons.png", &[&photons[..], &["--gather", gather]].concat());
        assert!(text.contains(" of photons"), "{text}");
        assert_ne!(photons, once);
        assert!((mean(&photons) - mean(&once)).abs() < 4.0, "{gather}: {}", mean(&photons));
    }
    for (arguments, says) in [
        (["--transport", "paths", "--depth", "65"], "0 to 64"),
        (["--transport", "paths", "--passes", "0"], "passes"),
        (["--transport", "photons", "--photons", "63"], "64 to 16777216"),
        (["--transport", "photons", "--neighbours", "2000"], "8 to 1024"),
        (["--transport", "paths", "--ambient", "0"], "--ambient is of direct light"),
        (["--transport", "photons", "--headlight", "0"], "--headlight is of direct light"),
        (["--transport", "paths", "--min-weight", "0"], "--min-weight is of direct light"),
        (["--transport", "paths", "--gather", "maps"], "--gather needs --transport photons"),
        (["--photons", "100", "--neighbours", "9"], "--photons needs --transport photons"),
        (["--transport", "light", "--passes", "1"], "possible values: direct, paths, photons"),
    ] {
        let error = fail(&folder, 2, &[&["render", "builtin:cornell"], &arguments[..]].concat());
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn the_built_in_animation_writes_frames_and_movies() {
    let folder = folder();
    let base = ["animate", "builtin:carousel:4000", "--count", "3", "--size", "32x20"];
    let out = ["--out", "frames", "--movie", "m.png"];
    let report = json(&folder, &[&base[..], &out, &["--json"]].concat());
    assert_eq!(
        files(&folder.path().join("frames")),
        ["frame-0000.png", "frame-0001.png", "frame-0002.png"]
    );
    let frames = report["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 3);
    for name in ["update_ms", "build_frame_ms", "trace_ms", "total_ms", "frames_per_s"] {
        let times = &report[name];
        let [p50, p95, p99] = ["p50", "p95", "p99"].map(|p| times[p].as_f64().unwrap());
        assert!(p50 >= 0.0 && (p50 <= p95) == (name != "frames_per_s" || p50 == p95), "{name}");
        assert!(p99.is_finite());
    }
    for frame in frames {
        let ms = |name: &str| frame[name].as_f64().unwrap();
        let parts = ms("update_ms") + ms("build_ms") + ms("trace_ms");
        assert!((parts - ms("total_ms")).abs() < 1e-6 && ms("build_ms") > 0.0);
    }
    let first = fs::read(folder.path().join("frames/frame-0000.png")).unwrap();
    assert_ne!(first, fs::read(folder.path().join("frames/frame-0002.png")).unwrap());
    let movie = fs::read(folder.path().join("m.png")).unwrap();
    assert!(movie.windows(4).any(|bytes| bytes == b"acTL"), "it is not animated");
    succeed(&folder, &[&base[..], &["--movie", "m.gif", "-q"]].concat());
    assert!(fs::read(folder.path().join("m.gif")).unwrap().starts_with(b"GIF89a"));
    // What cannot be made leaves the old file as it was, and no other.
    let kept = fs::read(folder.path().join("m.gif")).unwrap();
    let wrong = [&base[..], &["--movie", "m.gif", "--fps", "60"]].concat();
    assert!(fail(&folder, 2, &wrong).contains("at most 50 frames a second"));
    fs::create_dir(folder.path().join("objs")).unwrap();
    fs::write(folder.path().join("objs/0.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    fs::write(folder.path().join("objs/1.obj"), "f 1 2 9\n").unwrap();
    fail(&folder, 3, &["animate", "objs/0.obj", "--frames", "objs", "--movie", "m.gif"]);
    assert_eq!(fs::read(folder.path().join("m.gif")).unwrap(), kept);
    assert_eq!(files(folder.path()), ["frames", "m.gif", "m.png", "objs"]);
    fail(&folder, 2, &["animate", "--count", "4294967295"]);
    let table = succeed(&folder, &base);
    assert!(table.contains("p50") && table.contains("written  nothing"), "{table}");
}

/// The same triangle three times, further to the right each time.
#[test]
fn frames_come_from_folders_and_raw_files() {
    let folder = folder();
    let obj =
        |x: f32| format!("v {x} 0 0\nv {} 0 0\nv {x} 1 0\nv -9 -9 -9\nv 9 9 9\nf 1 2 3\n", x + 1.0);
    let path = |name: &str| folder.path().join(name);
    fs::write(path("t.obj"), obj(0.0)).unwrap();
    fs::create_dir(path("objs")).unwrap();
    let mut raw = Vec::new();
    for (frame, x) in [0.0f32, 1.0, 2.0].into_iter().enumerate() {
        fs::write(path(&format!("objs/f{frame}.obj")), obj(x)).unwrap();
        for part in [x, 0., 0., x + 1.0, 0., 0., x, 1., 0., -9., -9., -9., 9., 9., 9.] {
            raw.extend(part.to_le_bytes());
        }
    }
    fs::write(path("t.frames.bin"), &raw).unwrap();
    fs::write(path("t.frames.json"), r#"{"vertices": 5, "frames": 3}"#).unwrap();
    let camera = ["--camera-eye", "1.5,0.5,6", "--camera-at", "1.5,0.5,0", "--size", "24x16", "-q"];
    for (frames, out) in [("objs", "a"), ("t.frames.bin", "b"), ("t.frames.json", "c")] {
        let base = ["animate", "t.obj", "--frames", frames, "--out", out];
        succeed(&folder, &[&base[..], &camera].concat());
    }
    for number in 0..3 {
        let read = |out: &str| fs::read(path(&format!("{out}/frame-000{number}.png"))).unwrap();
        assert_eq!(read("a"), read("b"), "{number}");
        assert_eq!(read("b"), read("c"), "{number}");
    }
    assert_ne!(
        fs::read(path("a/frame-0000.png")).unwrap(),
        fs::read(path("a/frame-0001.png")).unwrap()
    );
    // A file that ends too early, a scene that stands still, a movie of no kind.
    fs::write(path("t.frames.bin"), &raw[..100]).unwrap();
    let error = fail(&folder, 3, &["animate", "t.obj", "--frames", "t.frames.bin"]);
    assert!(error.contains("t.frames.bin") && error.contains("180"), "{error}");
    assert!(fail(&folder, 2, &["animate", "t.obj"]).contains("does not move"));
    assert!(fail(&folder, 2, &["animate", "--movie", "m.avi"]).contains("m.avi"));
    fail(&folder, 2, &["animate", "--fps", "0"]);
    fail(&folder, 2, &["animate", "--count", "0"]);
    fail(&folder, 3, &["animate", "t.obj", "--frames", "nothing"]);
}

/// Every option that the page about the program names is one of it.
#[test]
fn the_documents_name_options_that_exist() {
    let folder = folder();
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/cli.md");
    let page = fs::read_to_string(page).unwrap();
    let part = page.split("\n## Command line").nth(1).unwrap();
    let part = part.split("\n## ").next().unwrap();
    let mut help = String::new();
    for verb in [
        "render",
        "merge",
        "animate",
        "build",
        "stats",
        "query",
        "points",
        "distances",
        "convert",
        "verify",
        "adapters",
        "parity",
        "paper",
        "trade",
    ] {
        help += &succeed(&folder, &[verb, "--help"]);
    }
    // Those of the window, which the default build does not have.
    let elsewhere = ["--boxes", "--screenshot", "--stop-after", "--view"];
    let mut checked = 0;
    for line in part.lines().filter(|line| !line.starts_with("| `view`")) {
        for word in line.split("`").filter(|word| word.starts_with("--")) {
            let option = word.split([' ', '=']).next().unwrap();
            if elsewhere.contains(&option) {
                continue;
            }
            let known = help.lines().any(|line| {
                line.trim_start().split([' ', ',', '[', '<']).any(|word| word == option)
            });
            assert!(known, "{option} in `{line}`");
            checked += 1;
        }
    }
    assert!(checked > 40, "{checked}");
}

#[test]
fn small_pictures_of_much_glass_come_out_like_large_ones() {
    let folder = folder();
    let mut panes = String::from("mtllib g.mtl\nusemtl glass\n");
    for i in 0..24 {
        let z = f64::from(i) * 0.5;
        for [x, y] in [[-9, -9], [9, -9], [9, 9], [-9, 9]] {
            panes += &format!("v {x} {y} {z}\n");
        }
        panes += "f -4 -3 -2 -1\n";
    }
    fs::write(folder.path().join("g.obj"), panes).unwrap();
    fs::write(folder.path().join("g.mtl"), "newmtl glass\nillum 7\nNi 1.5\nd 0.1\n").unwrap();
    for size in ["2x1", "8x8"] {
        let options = ["--depth", "10", "--min-weight", "0", "--samples", "4", "-q"];
        let base = ["render", "g.obj", "--size", size, "-o", "g.png"];
        succeed(&folder, &[&base[..], &options].concat());
    }
}
